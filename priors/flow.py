"""Averages along motion: what a frame lacks, its neighbours may have seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._validate import whole
from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.bm3d import BM3D, BM3DSession
from priors.motion.measure import Motion, finished, may_show_motion, measure
from priors.tv import TV

# Calls of TV alone, cheap beside the others. On validation clips, 128 x 128, and with 30 calls after them, 60 gain 0.1
# and 0.4 dB in the place of 30 with two views of 10 and 14 frames, with noise of 0.02 0.2 dB, with more noise or one
# view nothing.
FIRST = 60
# Frames either side that help a frame, and the difference, in units of sigma, at which one of them counts 1/e. On 16
# cases of validation clips of 256 x 256 pixels 3 and 2.6 gain 0.3 dB (two views of 10 frames, and one of 8) over 2 and
# 3.0, of which 3 neighbours are two thirds; on crops of 128 x 128 they gain nothing. 4 are no better than 3.
NEIGHBOURS, TOLERANCE = 3, 2.6
# Standard deviation along time, in units of sigma, at which a pixel counts 1/e as still, and the largest: where noise
# has raised sigma, TV hides what moves slowly, and without that bound moving clips lose 0.3 dB with noise of 0.1.
REST, REST_MOST = 0.8, 0.04
RENEW = 4  # calls between two estimates of the flow
# Strength of TV beside the averages, which take off noise themselves. On 18 cases of validation clips 0.25 gains 0.05
# dB over 0.5, with 6 and 14 frames 0.1, and loses 0.04 with noise of 0.03.
STRENGTH = 0.25
LOUD = 0.35  # sigma above which noise hides the motion: on validation clips better than TV at 0.26, worse at 0.45
# Noise that BM3D is told, in units of what the averages leave of sigma. On 17 cases of validation clips, 128 x 128, in
# the place of one sigma everywhere it gains 0.3 dB (two views of 6 and 10 frames), 0.15 (14) and 0.5 (one of 8), and
# nothing with noise of 0.03; on none it loses. 1.3 is as good with one view, 0.2 dB worse with two.
GRAIN = np.float32(1.6)
FAINT = 1e-4  # of the range of x: smaller differences than that are not worth an average


@dataclass(frozen=True)
class Flow(Prior):
    """Each frame of a view averaged with its neighbours along their motion, on top of total variation.

    The first 60 calls are those of :class:`priors.tv.TV`, and so are all with a sigma above 0.35. Then every fourth
    call estimates the optical flow from each frame straight to each of its neighbours (never chained: chains drift) and
    how far to trust it: where the flow there and the flow back do not cancel, or where the warped neighbour differs
    from the frame, it counts little. A steady motion takes the place of what was found where frames match better by it,
    that of the surroundings where they match hardly worse. Pixels that stand still, where neither the frames change nor
    a flow explains what little they do, share all frames. Every call denoises the frames on their own, by TV, and
    averages each with its neighbours, warped onto it, by these weights; :class:`priors.bm3d.BM3D`, told 1.6 times the
    noise that this leaves in each pixel, filters what comes of it, and has clips of one frame for itself. Clips below
    32 pixels a side show no motion and are left to TV.

    Parameters
    ----------
    neighbours : int
        Frames either side that help a frame, >= 1.
    tolerance : float
        Difference between a frame and its warped neighbour, both averaged once, at which the weight falls to 1/e, > 0,
        in units of sigma.
    drift : float
        Distance in pixels between going there and back along the flow at which the weight falls to 1/e, > 0.
    first : int
        Calls at the beginning of a video that are left to TV, >= 0.
    still : bool
        Whether pixels that hardly change along time become, by as much as they surely stand still, the mean of all
        frames.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    References
    ----------
    T. Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016.
    A. Buades, J.-L. Lisani & M. Miladinovic, "Patch-based video denoising with optical flow estimation", TIP 2016.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> pnp_sci.denoise(np.zeros((1, 3, 32, 32)), 0.05, Flow()).shape
    (1, 3, 32, 32)
    """

    neighbours: int = NEIGHBOURS
    tolerance: float = TOLERANCE
    drift: float = 1.5
    first: int = FIRST
    still: bool = True

    def __post_init__(self):
        whole("neighbours", self.neighbours, 1)
        whole("first", self.first, 0)
        for name, value in (("tolerance", self.tolerance), ("drift", self.drift)):
            if not 0 < value < np.inf:
                raise InputError(f"{name} is {value}: a number > 0 was expected")

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Strong after total variation; estimates change with the motion and the groups."""
        average = shape[1] == 1 or may_show_motion(shape)
        return Traits(strong=True, warmup=(TV(still=self.still), self.first), serves_below=LOUD, average=average)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session without motion; of BM3D for single frames, of total variation for small ones."""
        if shape[1] == 1:
            return BM3D().begin(shape, dtype)
        if not may_show_motion(shape):
            return TV(still=self.still).begin(shape, dtype)
        return FlowSession(self, shape, dtype)


class FlowSession(Session):
    """Averages along the motion of one video, then BM3D."""

    def __init__(self, prior: Flow, shape: tuple[int, ...], dtype: np.dtype):
        self.prior, self.calls = prior, 0
        self.frames, self.patches = TV(STRENGTH, time=0, inner=3).begin(shape, dtype), BM3DSession()
        self.motion: list[Motion] = []
        self.still: list[float] = []
        self.left = np.empty(0, np.float32)  # of each pixel, what BM3D is told, in units of sigma

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v (V, B, H, W)."""
        if self.prior.tolerance * sigma < FAINT:
            return v
        self.calls += 1
        mean = self._averaged(self.frames(v, sigma), sigma)
        return self.patches(mean, sigma * self.left)

    def _averaged(self, v: np.ndarray, sigma: float) -> np.ndarray:
        """Each frame of v (V, B, H, W) averaged with its neighbours along their motion."""
        if self.calls % RENEW == 1 or not self.motion:
            seeing = self.prior.neighbours, self.prior.tolerance * sigma, self.prior.drift, self._rest(sigma)
            before = self.motion or [None] * len(v)
            self.motion = [measure(view, *seeing, motion) for view, motion in zip(v, before)]
            self.still = [seen.at_rest for seen in self.motion]
            self.left = np.stack([GRAIN * seen.remaining for seen in self.motion])
        out = np.empty_like(v)
        for view, seen, averaged in zip(v, self.motion, out):
            seen.average(view, averaged)
        return out

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """The last estimate x (V, B, H, W), averaged once more, along the motion that it shows itself."""
        if not self.motion:
            return x
        self.motion, self.left = [], self.left[:0]  # their memory is needed no more
        return finished(x, sigma, self.prior.neighbours, self.prior.drift, self._rest(sigma))

    def facts(self) -> Mapping[str, Any]:
        """The part of each view that stands still, as last measured."""
        return {"still": self.still}

    def _rest(self, sigma: float) -> float:
        """Standard deviation along time at which a pixel counts 1/e as still; 0 where none may."""
        return min(REST * sigma, REST_MOST) if self.prior.still else 0.0
