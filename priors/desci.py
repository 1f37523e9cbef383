"""The prior "desci": groups of similar patches along the motion have low rank."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numba
import numpy as np

from pnp_sci._validate import finite_number, positive_number, true_or_false, whole
from pnp_sci.accel.arrays import single
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import Stages
from pnp_sci.plugins.protocols import Prior, Session, Traits
from pnp_sci.solvers.schedule import TUNED as SCHEDULE
from priors.flow import Flow
from priors.kernels import lowrank as kernels
from priors.kernels.similar import match
from priors.motion.measure import TUNED as MOTION
from priors.motion.measure import Motion, may_show_motion, measure
from priors.motion.pairs import neighbouring
from priors.tv import TUNED as TOTAL_VARIATION
from priors.tv import TV

FAINT = 1e-6  # sigma below which nothing is left to do
LOUDEST = 1e3  # largest sigma of a group, where x spans about [0, 1]; it leaves the mean of the group
FALL = 15  # calls in which the strength falls from its first to its last value
ROUNDS = 3  # reweightings in the first call, which has no last result
KAISER = 2  # parameter of the window of the aggregation, as for BM3D
PUBLISHED = (100, 9, 140), (50, 8, 120), (25, 7, 90), (12, 6, 70), (6, 6, 70)  # sigma of 255, side, patches


@dataclass(frozen=True)
class DeSCI(Prior):
    """Groups of similar patches, within a frame and along the motion, are brought to low rank.

    A group is a matrix X with a patch in each row, without the mean of its patches. Its weighted nuclear norm is
    minimised,

    ``min_Z ||X - Z||^2 / 2 + C sum_i log(s_i(Z))``  with  ``C = 2 sqrt(2 patches) (strength sigma)^2``

    for the singular values s_i: they become ``(s + sqrt(s^2 - 4 C)) / 2``, or 0. By default the minimum is approached
    by reweighting: with the Gram matrix G of the group in the last result, ``Z = G (G + C)^-1 X``, one small system of
    equations a group. Overlapping patches are averaged.

    Total variation serves the first 60 calls, unless a decoder gives the start. Patches are searched in the frame, and
    in its neighbours around where the optical flow leads; the groups are renewed in every sixth call. Frames smaller
    than a patch are left to total variation.

    Parameters
    ----------
    patches : int
        Patches of a group, >= 2.
    side : int
        Pixels per side of a patch, >= 2.
    step : int
        Pixels between patches that begin a group, 1 to `side`.
    reach : int
        Radius in pixels of the search within the frame, >= 0.
    near : int
        Radius in pixels of the search in a neighbouring frame, >= 0.
    neighbours : int
        Frames either side that are searched, >= 0.
    motion : bool
        Whether the search in a neighbouring frame follows the flow, or begins at the same place.
    renew : int
        Calls for which groups serve, >= 1.
    strength, begin_strength : float
        Noise that groups are told, in units of sigma, > 0. It falls from `begin_strength` to `strength` in 15 calls.
    beside : float
        Strength of total variation before the groups, >= 0.
    exact : bool
        Minimise in closed form, by eigenvectors, with the singular values of the group itself; many times slower.
    first : int
        Calls at the beginning of a video that are left to :class:`priors.tv.TV`, >= 0.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    References
    ----------
    Y. Liu, X. Yuan, J. Suo, D. J. Brady & Q. Dai, "Rank minimization for snapshot compressive imaging", IEEE TPAMI 41
    (2019).
    S. Gu, L. Zhang, W. Zuo & X. Feng, "Weighted nuclear norm minimization with application to image denoising", CVPR
    2014.
    M. Lebrun, A. Buades & J.-M. Morel, "A nonlocal Bayesian image denoising algorithm", SIAM Journal on Imaging
    Sciences 6 (2013).
    T. Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016.
    Those of :class:`priors.tv.TV`.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> x = np.zeros((1, 3, 32, 32), np.float32); x[..., 16:] = 1
    >>> noisy = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape).astype(np.float32)
    >>> bool(np.std(pnp_sci.denoise(noisy, 0.1, DeSCI()) - x) < 0.4 * np.std(noisy - x))
    True
    """

    patches: int = 64
    side: int = 8
    step: int = 8
    reach: int = 5
    near: int = 2
    neighbours: int = MOTION.neighbours
    motion: bool = True
    renew: int = 6
    strength: float = 2.9
    begin_strength: float = 9.0
    beside: float = 0.25
    exact: bool = False
    first: int = TOTAL_VARIATION.warmup

    def __post_init__(self):
        for name, least in (("patches", 2), ("side", 2), ("step", 1), ("renew", 1)):
            whole(name, getattr(self, name), least)
        for name in ("reach", "near", "neighbours", "first"):
            whole(name, getattr(self, name), 0)
        if self.step > self.side:
            raise InputError(f"step is {self.step}: at most the side of a patch was expected, which is {self.side}")
        for name in ("strength", "begin_strength"):
            positive_number(name, getattr(self, name))
        finite_number("beside", self.beside)
        for name in ("motion", "exact"):
            true_or_false(name, getattr(self, name))

    @staticmethod
    def published() -> Stages:
        """The parameters of the authors' code: 60 calls each of five noise levels, 100 to 6 of 255, without warm-up.

        The levels are those of a solver whose sigma is 0.05, as it is by default without noise for 20 frames or fewer
        and masks of random pixels; give ``sigma=0.05`` otherwise. Patches have 9 x 9 to 6 x 6 pixels. All frames are
        searched 30 pixels around the same place. Groups serve 20 calls. Singular values are shrunk in closed form.
        Frames of 256 x 256 take many hours.
        """
        stages = []
        for level, side, patches in PUBLISHED:
            noise = level / 255 / SCHEDULE.sigma
            prior = DeSCI(
                patches, side, max(side // 2 - 1, 1), reach=30, near=30, neighbours=sys.maxsize, motion=False, renew=20,
                strength=noise, begin_strength=noise, beside=0, exact=True, first=0,
            )  # fmt: skip
            stages.append((prior, 60))
        return Stages(stages)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Strong after total variation; estimates change from groups to groups: averaged, if not `exact`."""
        if not self._has_patches(shape):
            return Traits()
        return Traits(strong=True, warmup=(TV(), self.first), average=not self.exact)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session without groups; of total variation where frames are smaller than a patch."""
        return DeSCISession(self, shape) if self._has_patches(shape) else TV().begin(shape, dtype)

    def _has_patches(self, shape: tuple[int, ...]) -> bool:
        return min(shape[2:]) >= self.side


class DeSCISession(Session):
    """Groups of one video, and the last result."""

    def __init__(self, prior: DeSCI, shape: tuple[int, ...]):
        self.prior, self.calls = prior, 0
        self.frames = TV(prior.beside, time=0).begin(shape, np.dtype(np.float32)) if prior.beside else None
        self.views = [Groups(prior, shape[1:]) for _ in range(shape[0])]
        self.signal: np.ndarray | None = None

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v (V, B, H, W), computed in float32."""
        if sigma < FAINT:
            return v
        x = single(v) if self.frames is None else self.frames(single(v), sigma)
        signal = np.empty_like(x)
        for n, groups in enumerate(self.views):
            if self.calls % self.prior.renew == 0:
                groups.search(x[n] if self.signal is None else self.signal[n], sigma)
            groups.filter(x[n], None if self.signal is None else self.signal[n], self._told(sigma), signal[n])
        self.signal = signal
        self.calls += 1
        return signal

    def _told(self, sigma: float) -> float:
        """Noise that groups are told."""
        still_falls = max(1 - self.calls / FALL, 0)
        strength = self.prior.strength + (self.prior.begin_strength - self.prior.strength) * still_falls
        return min(strength * sigma, LOUDEST)


class Groups:
    """The groups of patches of one view (B, H, W)."""

    def __init__(self, prior: DeSCI, shape: tuple[int, ...]):
        self.prior = prior
        frames, *size = shape
        self.reach = min(prior.neighbours, frames - 1)
        self.tops, self.lefts = (grid(n, prior.side, prior.step) for n in size)
        self.edge = np.kaiser(prior.side, KAISER).astype(np.float32)
        kind = np.int32 if math.prod(shape) < 2**31 else np.int64
        self.found = np.empty((frames, self.tops.size, self.lefts.size, prior.patches), kind)
        self.seen: Motion | None = None

    def search(self, view: np.ndarray, sigma: float) -> None:
        """Find the groups in an estimate of the view."""
        prior, (frames, rows, columns) = self.prior, view.shape
        if prior.motion and self.reach and may_show_motion((1, *view.shape)):
            tolerance = Flow.tolerance * sigma
            self.seen = measure(view, self.reach, tolerance, MOTION.drift, 0.0, self.seen)
            flow, pairs, first = self.seen.flow, self.seen.pairs, self.seen.first
        else:
            pairs, first = neighbouring(frames, self.reach)
            flow = np.zeros((len(pairs), (rows + 1) // 2, (columns + 1) // 2, 2), np.int16)
        reach, near = (min(radius, max(rows, columns)) for radius in (prior.reach, prior.near))
        match(view, prior.side, self.tops, self.lefts, flow, pairs, first, reach, near, self.found)

    def filter(self, view: np.ndarray, pilot: np.ndarray | None, noise: float, out: np.ndarray) -> None:
        """out <- the view with its groups at low rank, for this standard deviation of the noise."""
        prior = self.prior
        weight = np.float32(2 * np.sqrt(2 * prior.patches) * noise**2)
        rounds = 0 if prior.exact else ROUNDS if pilot is None else 1
        guide = view[:0] if pilot is None or prior.exact else pilot
        threads = numba.get_num_threads()
        kernels.collaborate(view, guide, weight, rounds, prior.side, self.edge, self.found, self.reach, threads, out)


def grid(length: int, side: int, step: int) -> np.ndarray:
    """First pixels of patches, `step` apart, that cover a line of pixels; the last patch ends with the line."""
    return np.append(np.arange(0, length - side, step), length - side)
