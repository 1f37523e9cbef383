"""Compiled kernels of the priors."""
