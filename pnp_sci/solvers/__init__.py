"""Solvers as pure steps: a state goes in, a state comes out; one loop in :mod:`pnp_sci.loop` serves all of them."""

from .admm import admm_step
from .gap import gap_step, plain_gap_step
from .state import State, Step, missing, start

ALGORITHMS: dict[str, Step] = {"gap": gap_step, "plain-gap": plain_gap_step, "admm": admm_step}

__all__ = ["ALGORITHMS", "State", "Step", "admm_step", "gap_step", "missing", "plain_gap_step", "start"]
