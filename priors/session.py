"""A network at work on the estimates of a solver, with a little total variation before it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pnp_sci._tuned import Tuned
from pnp_sci.plugins.protocols import Session
from priors.networks.along_motion import VideoNet
from priors.networks.image import ImageNet

MOST = 75 / 255  # largest sigma that a network is told: the largest of its training


@dataclass(frozen=True)
class SessionNumbers(Tuned):
    """What is done before the network."""

    beside: float = 0.3  # strength of TV before the network


TUNED = SessionNumbers()


class NetworkSession(Session):
    """A network with a little total variation before it, on one video.

    The network sees the frames turned or mirrored in another way in every call, so that its errors that depend on a
    direction average out.

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

    def __call__(self, v: Any, sigma: float, out: Any = None) -> Any:
        """Denoise v (V, B, H, W)."""
        if sigma == 0:
            return v
        told = self.stronger * sigma
        v = self.beside(v, max(1.0, told / MOST) * sigma)
        self.turn += 1
        return self.net(v, min(told, MOST), self.turn)

    def finish(self, x: Any, sigma: float) -> Any:
        """As the network does."""
        return self.net.finish(x, sigma)

    def facts(self) -> Mapping[str, Any]:
        """Hashes of the weights, and the part of each view that stands still."""
        return {"weights": self.net.hashes, "still": self.net.still}
