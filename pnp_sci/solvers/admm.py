"""Alternating direction method of multipliers."""

from __future__ import annotations

from pnp_sci.accel.arrays import copied, library
from pnp_sci.solvers.state import Array, Denoise, Operator, State, missing


def admm_step(
    op: Operator,
    y: Array,
    denoise: Denoise,
    state: State,
    sigma: float,
    rho: float | Array = 0.0,
    saturated: Array | None = None,
) -> State:
    """One iteration of plug-and-play ADMM in scaled form.

    ``z <- argmin ||y - Phi z||^2 + rho ||z - (x - u)||^2;  x <- D_sigma(z + u);  u <- u + z - x``

    (Chan, Wang & Elgendy 2017; for SCI Yuan et al. 2020.) With ``rho = 0`` the first step is the projection onto
    ``Phi z = y``. Where y is saturated, ``||y - Phi z||`` counts only what Phi z falls short of y. Keeps a dual video u
    in `State.dual`, where GAP keeps one picture.
    """
    dual = state.dual if state.dual.ndim == 4 else library(state.x).zeros_like(state.x)
    v, target = state.x - dual, y
    if saturated is not None:
        measured = op.forward(v)
        target = measured + missing(y - measured, saturated)
    v = op.project(v, target, rho)
    v += dual
    x = denoise(copied(v), sigma)
    return State(state.iteration + 1, x, y - op.forward(x), v - x, sigma)
