"""OFaNet (Lu et al., arXiv:2109.05287): a network that decodes dual-view measurements or initialises the solvers."""
