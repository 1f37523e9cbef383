"""``python -m pnp_sci`` is ``pnp-sci``."""

from pnp_sci.cli.main import main

main(prog_name="pnp-sci")
