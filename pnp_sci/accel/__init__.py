"""Compiled kernels, numbers of threads, and networks prepared for inference."""
