"""A network at work on the estimates of a solver: with a little total variation before it, and a bound on its input."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import copied
from pnp_sci.plugins.protocols import Session
from priors.networks.along_motion import VideoNet
from priors.networks.image import ImageNet

MOST = 75 / 255  # largest sigma that a network is told: the largest of its training


@dataclass(frozen=True)
class SessionNumbers(Tuned):
    """Bounds on what a network is given."""

    beside: float = 0.3  # strength of TV before the network
    demand: float = 2.8  # root mean square, in sigmas, of what may be new in a view of the input


TUNED = SessionNumbers()


class NetworkSession(Session):
    """A network with a little total variation before it, on one video.

    The network sees the frames turned or mirrored in another way in every call, so that its errors that depend on a
    direction average out. What x brings anew in a view, beside the last result, may have 2.8 sigma, root mean square.
    Detail that the network removes accumulates in the multiplier and returns as an artefact; the bound holds it back.

    Parameters
    ----------
    net : ImageNet or VideoNet
    beside : Session
        Of total variation. It is told more than sigma where the network cannot be told enough.
    stronger : float
        Sigma that the network is told, in units of the solver's, > 0.
    turn : int
        How the network sees the frames at first, see :class:`priors.networks.image.ImageNet`.
    """

    def __init__(self, net: ImageNet | VideoNet, beside: Session, stronger: float, turn: int):
        self.net, self.beside, self.stronger, self.turn = net, beside, stronger, turn
        self.last: Any = None

    def __call__(self, v: Any, sigma: float, out: Any = None) -> Any:
        """Denoise v (V, B, H, W)."""
        if sigma == 0:
            return v
        if self.last is not None:
            v = within(TUNED.demand * sigma, v, self.last)
        told = self.stronger * sigma
        v = self.beside(v, max(1.0, told / MOST) * sigma)
        self.turn += 1
        self.last = self.net(v, min(told, MOST), self.turn)
        return self.last

    def finish(self, x: Any, sigma: float) -> Any:
        """As the network does."""
        self.last = None
        return self.net.finish(x, sigma)

    def facts(self) -> Mapping[str, Any]:
        """Hashes of the weights, and the part of each view that stands still."""
        return {"weights": [self.net.sha256], "still": self.net.still}


def within(reach: float, x: Any, last: Any) -> Any:
    """x, each view of it no further from `last`, both (V, B, H, W), than `reach` (> 0) root mean square."""
    out = copied(x)
    for view, before in zip(out, last):
        step = view - before
        distance = math.sqrt(float((step**2).mean()))
        if distance > reach:
            view[:] = before + step * (reach / distance)
    return out
