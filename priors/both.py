"""The prior "both": flow and video together, whose errors differ."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.plugins.combine import Joint
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.flow import Flow
from priors.motion.measure import may_show_motion
from priors.tv import TUNED as TOTAL_VARIATION
from priors.video import Video


@dataclass(frozen=True)
class BothNumbers(Tuned):
    """Weights of the two."""

    flow: float = 0.3  # weight of flow in the mean; the rest is that of video


TUNED = BothNumbers()


@dataclass(frozen=True)
class Both(Prior):
    """Means, 3 parts to 7, of what the priors `flow` and `video` make of frames that move; else `video` alone.

    Their errors differ: they measure the motion in different pictures, and artefacts of one are absent in the other.
    Single frames, and frames below 32 pixels a side, show no motion: there a mean is no better.

    Parameters
    ----------
    weights, device
        As for :class:`priors.video.Video`.
    first : int
        Calls at the beginning of a video that are left to total variation, >= 0.

    Raises
    ------
    InputError
        If `first` is not a whole number >= 0.

    References
    ----------
    Those of :class:`priors.flow.Flow` and :class:`priors.video.Video`.

    Examples
    --------
    >>> import pnp_sci
    >>> pnp_sci.denoise(np.full((1, 2, 32, 32), 0.5), 0.05, Both()).shape
    (1, 2, 32, 32)
    """

    weights: str | Path | None = None
    device: str | None = None
    first: int = TOTAL_VARIATION.warmup

    def __post_init__(self):
        self._serving((1, 1, 1, 1))  # which checks the fields

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Those of both, or of `video` alone."""
        return self._serving(shape).traits(shape)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """Sessions of both, or one of `video` alone."""
        return self._serving(shape).begin(shape, dtype)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Session | None:
        """The same on tensors, where they can."""
        return self._serving(shape).begin_on(shape, dtype, device)

    def _serving(self, shape: tuple[int, ...]) -> Joint | Video:
        video = Video(self.weights, self.device, self.first)
        return Joint([Flow(first=self.first), video], (TUNED.flow, 1 - TUNED.flow)) if may_show_motion(shape) else video
