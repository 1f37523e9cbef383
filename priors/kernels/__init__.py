"""Compiled (numba) kernels of the priors."""
