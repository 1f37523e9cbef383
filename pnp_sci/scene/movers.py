"""Small movers: does what a simple model leaves of y follow masks that it does not use, somewhere in the picture?

If a scene stands still, y depends on the masks only through their sum over time. Which frames of a pixel are open is
then chance beside the residual r of the model, whatever the scene. So ``r * (mask - mean of the masks)`` has mean 0,
and its variance under permutations of the frames is known (Pitman 1937). Where something passes, the mean is the change
of brightness times the variance of the masks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pnp_sci.scene.tracks import SIDE, follow
from pnp_sci.scene.unused import Free, free_masks
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.scene_model import SceneModel

ZOOMS = (1, 2, 4)  # factors on them
LONG = 10  # frames of a moving window's track, at most
ALARM = 0.01  # largest probability that chance alone looks like a mover somewhere in a picture
LOUD = 2.0  # root mean squares at which residuals are clipped, so that no few pixels decide
CELLS = 3  # smallest side of windows in cells of the masks: the sum over fewer is not normal
DIM = 1e-6  # of the mean variance, added to that of each window: where y is 0 nothing is to be seen


def shows_more(simple: SceneModel, op: SensingOperator, residual: np.ndarray) -> bool:
    """Whether the residual (H, W) of a simple model shows a mover, or a thing in a view that the model leaves out.

    The masks of still and dark views, freed of what the model uses of them, are correlated with the residual in windows
    of 8, 16 and 32 pixels a side: at rest in runs of frames, and along straight tracks of 10 frames. The largest score
    of each of the two kinds is compared with Bonferroni's limit for so many scores.
    """
    loud = LOUD * float(np.sqrt(np.mean(residual.astype(np.float64) ** 2)))
    clipped = np.clip(residual, -loud, loud)
    views = list(free_masks(simple, op))
    tracks = Tracks.of(op.shape[1], any(free.share == 0 for free in views))
    scores, places = np.zeros(len(tracks.speed)), 0
    for free in views:
        best, count = tracks.scores(free, clipped)
        scores, places = np.maximum(scores, best), places + count
    kinds = (tracks.moving, ~tracks.moving)
    return any(scores[kind].max(initial=0) > limit(places * int(kind.sum()), len(kinds)) for kind in kinds)


def limit(tried: int, kinds: int = 1) -> float:
    """Standard deviations that the largest of so many normal scores exceeds with a probability of 0.01, at most.

    Of several kinds of scores, each has its part of the probability.
    """
    from scipy.stats import norm

    return float(norm.isf(ALARM / 2 / kinds / max(tried, 1)))


class Tracks(NamedTuple):
    """Straight courses of windows through the frames.

    Attributes
    ----------
    speed : ndarray of int, (N, 2)
        Rows and columns from frame to frame.
    first, length : ndarray of int, (N,)
        First frame, and number of frames.
    """

    speed: np.ndarray
    first: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, frames: int, whole: bool) -> Tracks:
        """Half-overlapping runs at rest of 1, 2, 4 ... frames, and of 8 frames with steps of less than a window.

        All frames at rest are one more run if it says anything (`whole`).
        """
        shorter = [2**k for k in range((frames - 1).bit_length())]
        runs = [(start, length, (0, 0)) for length in shorter for start in _starts(frames, length)]
        runs += [(0, frames, (0, 0))] * whole
        speeds = [(y, x) for y in range(1 - SIDE, SIDE) for x in range(1 - SIDE, SIDE) if (y, x) != (0, 0)]
        long = min(frames, LONG)
        runs += [(start, long, speed) for start in _starts(frames, long) for speed in speeds if long > 1]
        first, length, speed = (np.array([run[field] for run in runs], np.int64) for field in range(3))
        return cls(speed.reshape(-1, 2), first, length)

    @property
    def moving(self) -> np.ndarray:
        """Which of them move, (N,)."""
        return np.any(self.speed, axis=1)

    def scores(self, free: Free, residual: np.ndarray) -> tuple[np.ndarray, int]:
        """The largest score of each track over all places and sizes of windows (N,), and how many places there are.

        Scores are in standard deviations, by permutation or by what is usual in the picture, whichever is more. A track
        that moves with the pattern of the masks has none: it sees one part of the pattern only.
        """
        best, places = np.zeros(len(self.speed)), 0
        rooted, shift = free.rooted(residual), free.shift
        parts, spread = residual * free.masks, rooted**2
        scale = _even(self.speed, self.length, free.share)
        for zoom in ZOOMS:
            if min(spread.shape) < SIDE or not spread.any():
                break
            if CELLS * free.cell <= SIDE * zoom:
                totals, variance = _windows(parts), _windows(spread)
                normal = (totals / np.sqrt(variance + DIM * variance.mean())).astype(np.float32)
                scores = follow(totals, normal, rooted, self, scale, free.share, shift, zoom)
                scores[self.moving & np.all(zoom * self.speed == shift, 1)] = 0
                best, places = np.maximum(best, scores), places + variance.size
            parts, spread = _halved(parts), _halved(spread)
        return best, places


def _starts(frames: int, length: int) -> list[int]:
    """First frames of half-overlapping runs, the last of which ends with the last frame."""
    last = frames - length
    return sorted({*range(0, last + 1, max(length // 2, 1)), last}) if last >= 0 else []


def _even(speed: np.ndarray, length: np.ndarray, share: float) -> np.ndarray:
    """The variance of one window over that of each track (N,), where all pixels have the same; 0 if it has none.

    Each frame adds a window; all pairs of frames lose their overlap, as often as `share` says.
    """
    own = lost = length * SIDE**2
    for apart in range(1, length.max(initial=0)):  # frames between two
        overlap = np.prod(np.maximum(SIDE - apart * np.abs(speed), 0), axis=1)
        lost = lost + 2 * np.maximum(length - apart, 0) * overlap
    variance = own - share * lost
    return np.where(variance > DIM, SIDE**2 / np.maximum(variance, DIM), 0)


def _windows(a: np.ndarray) -> np.ndarray:
    """Sums over all windows of SIDE pixels a side in the last two axes."""
    sums = np.pad(a, [(0, 0)] * (a.ndim - 2) + [(1, 0), (1, 0)]).cumsum(-1, dtype=np.float64).cumsum(-2)
    return sums[..., SIDE:, SIDE:] - sums[..., SIDE:, :-SIDE] - sums[..., :-SIDE, SIDE:] + sums[..., :-SIDE, :-SIDE]


def _halved(a: np.ndarray) -> np.ndarray:
    """Sums over blocks of 2 x 2 pixels in the last two axes; an odd last row or column is left out."""
    rows, columns = (n // 2 * 2 for n in a.shape[-2:])
    a = a[..., :rows, :columns]
    return a[..., ::2, ::2] + a[..., 1::2, ::2] + a[..., ::2, 1::2] + a[..., 1::2, 1::2]
