"""Speed on this machine: compiled kernels, threads, and networks prepared for inference."""
