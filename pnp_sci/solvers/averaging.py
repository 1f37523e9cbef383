"""The mean of iterates that fluctuate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pnp_sci._tuned import Tuned
from pnp_sci.solvers.state import State


@dataclass(frozen=True)
class AveragingNumbers(Tuned):
    """Weights of a mean of iterates."""

    power: int = 5  # the n-th iterate of a mean weighs about n to this power


TUNED = AveragingNumbers()


class RunningMean:
    """The mean of all iterates since averaging began, the n-th weighted with n (n + 1) ... (n + 4).

    Each new measurement of motion, grouping of patches or shift of the wavelets moves the iterates; the mean is nearer
    to the truth than the last of them (O. Shamir & T. Zhang, "Stochastic gradient descent for non-smooth
    optimization", ICML 2013).
    """

    def __init__(self):
        self.count, self.mean = 0, None

    def __call__(self, state: State, averages: bool) -> State:
        """The state with the mean instead of its estimate; the state itself while nothing is averaged."""
        self.count = self.count + 1 if averages else 0
        if self.mean is None or self.count <= 1:
            self.mean = state
        else:
            self.mean = _mixed(self.mean, state, (TUNED.power + 1) / (self.count + TUNED.power))
        return self.mean


def _mixed(before: State, state: State, share: float) -> State:
    """`state` with ``(1 - share) before + share state`` as its estimate and residual."""
    x, residual = before.x - state.x, before.residual - state.residual
    for mean, newest in ((x, state.x), (residual, state.residual)):
        mean *= 1 - share
        mean += newest
    return replace(state, x=x, residual=residual)
