"""Comparing what two models of a scene predict of pixels that neither has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.scene_model import SceneModel

FLOOR = 0.3  # of the mean squared error, added to that of every window: keeps ratios of small errors meaningful
SURELY = 1.645  # standard errors: a mean gain of that many is beyond chance, one-sided at 5 %


@dataclass(frozen=True)
class TileNumbers(Tuned):
    """Where models are compared."""

    tile: int = 96  # pixels a side of the crop on which models are compared


TUNED = TileNumbers()


def at_most(share: float, simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the squared errors of the simple model are at most such a share of the other's, beyond the noise."""
    return bool(other.mean() > 0 and simple.mean() <= share * other.mean())


def always(simple: np.ndarray, other: np.ndarray) -> bool:
    """No condition on the errors."""
    return True


def beyond_chance(simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the simple model predicts better by some standard errors, and the other's errors exceed the noise."""
    gain = other - simple
    return bool(other.mean() > 0 and gain.mean() >= SURELY * gain.std() / np.sqrt(gain.size) > 0)


def beyond(simple: SceneModel, other: SceneModel, op: SensingOperator, x: np.ndarray) -> np.ndarray:
    """The part of y, view by view (V, H, W), that only the other model can explain, from its estimate x.

    What uniform masks of the same mean would show is subtracted: errors of both models correlate with that.
    """
    video = other.expand(x, op.shape)
    beyond = video - simple.expand(simple.restrict(video), op.shape)
    even = np.einsum("vb,vbhw->vhw", op.masks.mean((2, 3), dtype=np.float64), beyond)
    return np.einsum("vbhw,vbhw->vhw", op.masks, beyond) - even


def evidence(errors: np.ndarray, shown: np.ndarray, hidden: np.ndarray) -> float:
    """The largest coefficient of `shown` (V, H, W) in the errors (H, W) of the hidden pixels, in standard errors.

    Least squares with White's variance (a score test): errors may be larger in some places than in others. The value is
    at most the root of the number of pixels that show something: motion in few pixels cannot be detected.
    """
    errors, shown = errors[hidden].astype(np.float64), shown[:, hidden].astype(np.float64)
    shown = shown[shown.any(1)]
    normal = np.linalg.pinv(np.einsum("vp,wp->vw", shown, shown), hermitian=True)
    parts = normal @ np.einsum("vp,p->v", shown, errors)
    weighed = shown * errors
    variance = np.diagonal(normal @ np.einsum("vp,wp->vw", weighed, weighed) @ normal)
    return float(np.max(parts / np.sqrt(np.maximum(variance, np.finfo(np.float64).tiny)), initial=0))


def contested_tile(simple: np.ndarray, other: np.ndarray, side: int) -> tuple[slice, slice]:
    """The tile around the window where a model's squared errors (H, W) are largest, relative to those of another one.

    `side` is that of the tile in pixels; the window is the same for all.

    Absolute errors are largest in fine texture, which may well stand still.
    """
    from scipy.ndimage import uniform_filter

    window = tuple(min(TUNED.tile // 2, n) for n in simple.shape)
    inside = tuple(slice(w // 2, n - (w - 1) // 2) for n, w in zip(simple.shape, window))
    of_simple, of_other = (
        uniform_filter(errors, window, np.float64)[inside] + FLOOR * errors.mean()  # type: ignore[arg-type]
        for errors in (simple, other)
    )
    ratio = of_simple / np.maximum(of_other, np.finfo(np.float64).tiny)
    middle = np.unravel_index(np.argmax(ratio), ratio.shape)
    return tuple(_around(int(m) + i.start, n, side) for m, i, n in zip(middle, inside, simple.shape))  # type: ignore[return-value]


def _around(middle: int, length: int, side: int) -> slice:
    """`side` pixels around the middle one, within `length`; all of them if there are fewer."""
    start = max(min(middle - side // 2, length - side), 0)
    return slice(start, min(start + side, length))
