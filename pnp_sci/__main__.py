"""``python -m pnp_sci`` is ``pnp-sci``."""

from .cli import main

main(prog_name="pnp-sci")
