"""Averages along motion: what a frame lacks, its neighbours may have seen."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np

from pnp_sci.errors import InputError
from priors.bm3d import BM3D
from priors.motion.measure import SMALLEST, Motion, finished, measure
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


class Flow:
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
        If a parameter is out of its range, or x is not (V, B, H, W).

    References
    ----------
    T. Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016.
    A. Buades, J.-L. Lisani & M. Miladinovic, "Patch-based video denoising with optical flow estimation", TIP 2016.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.zeros((1, 3, 32, 32), np.float32)
    >>> Flow()(x, 0.05).shape
    (1, 3, 32, 32)
    """

    thorough = True

    def __init__(
        self,
        neighbours: int = NEIGHBOURS,
        tolerance: float = TOLERANCE,
        drift: float = 1.5,
        first: int = FIRST,
        still: bool = True,
    ):
        if int(neighbours) != neighbours or neighbours < 1:
            raise InputError(f"neighbours is {neighbours}: a whole number >= 1 was expected")
        if not isinstance(first, Integral) or first < 0:
            raise InputError(f"first is {first!r}: a whole number >= 0 was expected")
        for name, value in (("tolerance", tolerance), ("drift", drift)):
            if not 0 < value < np.inf:
                raise InputError(f"{name} is {value}: a number > 0 was expected")
        self.neighbours, self.tolerance, self.drift = int(neighbours), float(tolerance), float(drift)
        self.first, self.still = int(first), bool(still)
        self._before, self._frames, self._patches = TV(still=still), TV(STRENGTH, time=0, inner=3), BM3D(first=0)
        self.reset()

    def __repr__(self) -> str:
        numbers = f"neighbours={self.neighbours}, tolerance={self.tolerance}, drift={self.drift}, first={self.first}"
        return f"{type(self).__name__}({numbers}, still={self.still})"

    def reset(self) -> None:
        """Forget the flow and what TV keeps: the next call starts a new video."""
        self._calls = 0
        self._fits: tuple[int, ...] | None = None
        self._motion: list[Motion] = []
        self._at_rest: list[float] = []
        self._left = np.empty(0, np.float32)  # of each pixel, what BM3D is told, in units of sigma
        for denoiser in (self._before, self._frames, self._patches):
            denoiser.reset()

    @property
    def restless(self) -> bool:
        """As BM3D says of itself."""
        return self._patches.restless

    @property
    def at_rest(self) -> list[float]:
        """The part of each view that stands still, as last measured."""
        return self._at_rest or self._before.at_rest

    def __call__(self, x: Any, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1]; see :class:`priors.tv.TV` for arguments and result."""
        shape = np.shape(x)
        if self._fits != shape:
            self.reset()
            self._fits = shape
        self._calls += 1
        if self._calls <= self.first or sigma > LOUD or self.tolerance * sigma < FAINT:
            return self._before(x, sigma)
        several = len(shape) == 4 and shape[1] > 1
        if several and min(shape[2:]) < SMALLEST:
            return self._before(x, sigma)
        if not several:
            return self._patches(x, sigma)
        mean = self._averaged(self._frames(x, sigma), sigma)
        return self._patches(mean, sigma * self._left)

    def _averaged(self, v: np.ndarray, sigma: float) -> np.ndarray:
        """Each frame of v (V, B, H, W) averaged with its neighbours along their motion."""
        if (self._calls - self.first) % RENEW == 1 or not self._motion:
            seeing = self.neighbours, self.tolerance * sigma, self.drift, self._rest(sigma)
            before = self._motion or [None] * len(v)
            self._motion = [measure(view, *seeing, motion) for view, motion in zip(v, before)]
            self._at_rest = [seen.at_rest for seen in self._motion]
            self._left = np.stack([GRAIN * seen.remaining for seen in self._motion])
        out = np.empty_like(v)
        for view, seen, averaged in zip(v, self._motion, out):
            seen.average(view, averaged)
        return out

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """The last estimate x (V, B, H, W) of a solver, averaged once more, along the motion that it shows itself.

        Where calls have measured no motion, x comes back as it is.
        """
        if not self._motion:
            return x
        self._motion, self._left = [], self._left[:0]  # a further call measures anew; until then they would take memory
        return finished(x, sigma, self.neighbours, self.drift, self._rest(sigma))

    def _rest(self, sigma: float) -> float:
        """Standard deviation along time at which a pixel counts 1/e as still; 0 where none may."""
        return min(REST * sigma, REST_MOST) if self.still else 0.0
