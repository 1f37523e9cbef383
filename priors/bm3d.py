"""The prior "bm3d": block matching and 3-D filtering."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import whole
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.kernels import bm3d as kernels
from priors.tv import TUNED as TOTAL_VARIATION
from priors.tv import TV

THRESHOLD = 2.7  # standard deviations, as Dabov et al. have it
FAINT = 1e-6  # sigma below which nothing is left to do
LEAST, NOTHING = 1e-3, 1e-15  # least sigma of a group, in that of the noisiest one of its frame, and at all
MIDDLE = slice(kernels.SIDE // 2, 1 - kernels.SIDE // 2, kernels.STEP)  # pixels in the middle of patches


@dataclass(frozen=True)
class BM3DNumbers(Tuned):
    """How often patches are grouped, and how strongly the groups are filtered."""

    strength: float = 1.8  # noise that the filter is told from its second call on, in units of sigma
    renew: int = 15  # calls for which groups of patches serve


TUNED = BM3DNumbers()


@dataclass(frozen=True)
class BM3D(Prior):
    """Frame by frame, groups of similar patches are filtered together.

    Eight patches of 8 x 8 pixels form a cube. Its transform, cosines along rows and columns and Haar across patches, is
    shrunk, and the overlapping cubes are averaged. In the first call coefficients below 2.7 sigma are dropped; the
    result is the pilot of a Wiener filter. In every further call the last result is the pilot, and the filter is told
    1.8 sigma. Groups are searched anew in every fifteenth call.

    Parameters
    ----------
    first : int
        Calls at the beginning of a video that are left to :class:`priors.tv.TV`, >= 0.

    Raises
    ------
    InputError
        If `first` is not a whole number >= 0.

    References
    ----------
    K. Dabov, A. Foi, V. Katkovnik & K. Egiazarian, "Image denoising by sparse 3-D transform-domain collaborative
    filtering", IEEE TIP 16 (2007).

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> x = np.zeros((1, 1, 32, 32), np.float32); x[..., 16:] = 1
    >>> noisy = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape).astype(np.float32)
    >>> bool(np.std(pnp_sci.denoise(noisy, 0.1, BM3D()) - x) < 0.3 * np.std(noisy - x))
    True
    """

    first: int = TOTAL_VARIATION.warmup

    def __post_init__(self):
        whole("first", self.first, 0)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Strong after total variation; estimates change from groups to groups."""
        return Traits(strong=True, warmup=(TV(), self.first), average=True) if _has_patches(shape) else Traits()

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session without groups; of total variation where frames are smaller than a patch."""
        return BM3DSession() if _has_patches(shape) else TV().begin(shape, dtype)


def _has_patches(shape: tuple[int, ...]) -> bool:
    return min(shape[2:]) >= kernels.SIDE


class BM3DSession(Session):
    """Collaborative filtering of one video: the last result and the groups that it shows."""

    def __init__(self):
        self.calls = 0
        self.signal, self.groups = np.empty(0, np.float32), np.empty(0, np.int32)

    def __call__(self, v: np.ndarray, sigma: float | np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v (V, B, H, W), computed in float32.

        `sigma` may be that of each pixel (V, B, H, W): a group has that in the middle of its first patch, and a
        thousandth of the largest in its frame at least.
        """
        if not np.max(sigma, initial=0) >= FAINT:
            return v
        rows, columns = v.shape[2:]
        margins = ((0, 0), *((0, -n % kernels.STEP) for n in (rows, columns)))
        frames = np.pad(v.reshape(-1, rows, columns).astype(np.float32, copy=False), margins, mode="edge")
        level = sigma
        if np.ndim(sigma):
            level = np.pad(np.reshape(sigma, (-1, rows, columns)), margins, mode="edge")[:, MIDDLE, MIDDLE]
        strength = TUNED.strength if self.calls else 1
        if not self.calls:
            self.signal = filtered(frames, level, groups(frames))
        if self.calls % TUNED.renew == 0:
            self.groups = groups(self.signal)
        self.calls += 1
        self.signal = filtered(frames, strength * level, self.groups, self.signal)
        return self.signal[:, :rows, :columns].reshape(v.shape)


def groups(frames: np.ndarray) -> np.ndarray:
    """For patches of frames (N, H, W), every four pixels, those most alike: int32 (N, H / 4 - 1, W / 4 - 1, 8)."""
    count, rows, columns = frames.shape
    found = np.empty((count, rows // kernels.STEP - 1, columns // kernels.STEP - 1, kernels.SIDE), np.int32)
    kernels.match(frames, found)
    return found


def filtered(frames: np.ndarray, level: Any, found: np.ndarray, signal: np.ndarray | None = None) -> np.ndarray:
    """Frames (N, H, W) filtered in groups: by Wiener's filter for a `signal` (N, H, W), or by a threshold.

    `level` is the standard deviation of the noise, or that of each group (N, H / 4 - 1, W / 4 - 1).
    """
    out = np.empty_like(frames)
    of_groups = np.broadcast_to(np.float32(level), found.shape[:3])
    of_groups = np.maximum(
        of_groups, np.maximum(LEAST * of_groups.max((1, 2), keepdims=True), NOTHING), dtype=np.float32
    )
    pilot = frames[:0] if signal is None else signal
    kernels.collaborate(frames, pilot, of_groups, np.float32(THRESHOLD), found, out)
    return out
