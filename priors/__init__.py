"""Priors that plug into :mod:`pnp_sci`: each is one file and one entry point of the group ``pnp_sci.priors``."""
