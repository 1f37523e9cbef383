"""OFaNet (Lu, Zhang, Shi et al.): decoder of dual-view measurements by a network, and warm start of the solvers."""
