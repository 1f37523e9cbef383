"""Priors and decoders: what they promise, how they are found by name, and how they are combined."""
