"""The networks that the paper compares OFaNet with: U-net, ADMM-net and BIRNAT, for any number of views."""
