"""The command ``pnp-sci``."""
