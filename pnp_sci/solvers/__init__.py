"""Solvers as pure steps: a state goes in, a state comes out; one loop in :mod:`pnp_sci.solvers.iterate` serves all of them."""

from pnp_sci.solvers.admm import admm_step
from pnp_sci.solvers.gap import gap_step, plain_gap_step
from pnp_sci.solvers.state import State, Step, missing, start

ALGORITHMS: dict[str, Step] = {"gap": gap_step, "plain-gap": plain_gap_step, "admm": admm_step}

__all__ = ["ALGORITHMS", "State", "Step", "admm_step", "gap_step", "missing", "plain_gap_step", "start"]
