"""Comparing what two models of a scene predict of pixels that neither has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.scene_model import SceneModel

SURELY = 2.0  # standard errors: a mean gain of that many is beyond chance


@dataclass(frozen=True)
class TileNumbers(Tuned):
    """Where models are compared."""

    tile: int = 96  # pixels a side of the crop on which models are compared
    window: int = 48  # pixels a side of what lies in its middle
    everywhere: float = 0.3  # floor of a window's error, in units of the mean: keeps ratios of small errors meaningful


TUNED = TileNumbers()


def view_levels(op: SensingOperator, y: np.ndarray) -> np.ndarray:
    """The mean level of each view (V,): least squares of y on the sums of each view's masks, freed of their means.

    The sums differ from pixel to pixel by the random pattern only, which no scene follows, so that the part of y that
    follows them is the view's own. A constant and both views' common part stay out of it.
    """
    from scipy.ndimage import gaussian_filter

    sums = op.masks.sum(1, dtype=np.float64)
    fine = np.stack([s - gaussian_filter(s, 4, mode="nearest") for s in sums]).reshape(len(sums), -1)
    detail = (y - gaussian_filter(y.astype(np.float64), 4, mode="nearest")).reshape(-1)
    normal = np.einsum(
        "vp,wp->vw", fine, fine
    )  # by einsum: threads of BLAS go on spinning and keep the kernels waiting
    # below 1e-10 of the largest eigenvalue there is rounding: such views cannot be told apart, and share what there is
    return np.abs(np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ np.einsum("vp,p->v", fine, detail))


def at_most(share: float, simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the squared errors of the simple model are such a share of the other's, which are no mere noise."""
    return bool(other.mean() > 0 and simple.mean() <= share * other.mean())


def whatever(simple: np.ndarray, other: np.ndarray) -> bool:
    """Where errors are not compared."""
    return True


def beyond_chance(simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the simple model predicts better, beyond chance, where the errors of the other are no mere noise."""
    gain = other - simple
    return bool(other.mean() > 0 and gain.mean() >= SURELY * gain.std() / np.sqrt(gain.size) > 0)


def beyond(simple: SceneModel, other: SceneModel, op: SensingOperator, x: np.ndarray) -> np.ndarray:
    """What each view of y (V, H, W) has from an estimate x of the other model that the simple one cannot show.

    Freed of what it would have through masks of their mean everywhere, which errors may follow without any chance.
    """
    video = other.expand(x, op.shape)
    beyond = video - simple.expand(simple.restrict(video), op.shape)
    even = np.einsum("vb,vbhw->vhw", op.masks.mean((2, 3), dtype=np.float64), beyond)
    return np.einsum("vbhw,vbhw->vhw", op.masks, beyond) - even


def evidence(errors: np.ndarray, shown: np.ndarray, hidden: np.ndarray) -> float:
    """How much speaks for any of what is `shown` (V, H, W), as part of the errors (H, W) of what is hidden.

    In standard errors of least squares, if nothing of it is in the errors, which may be larger in some places than in
    others (the score test with White's variance). At most the root of the number of pixels that it shows in: what moves
    in a few of the hidden ones has no voice.
    """
    errors, shown = errors[hidden].astype(np.float64), shown[:, hidden].astype(np.float64)
    shown = shown[shown.any(1)]
    normal = np.linalg.pinv(np.einsum("vp,wp->vw", shown, shown), hermitian=True)
    parts = normal @ np.einsum("vp,p->v", shown, errors)
    weighed = shown * errors
    variance = np.diagonal(normal @ np.einsum("vp,wp->vw", weighed, weighed) @ normal)
    return float(np.max(parts / np.sqrt(np.maximum(variance, np.finfo(np.float64).tiny)), initial=0))


def contested_tile(simple: np.ndarray, other: np.ndarray) -> tuple[slice, slice]:
    """The tile around the window where a model's squared errors (H, W) are largest beside those of another one.

    Where they are largest in themselves it is fine texture that they show, which may well stand still.
    """
    from scipy.ndimage import uniform_filter

    window = tuple(min(TUNED.window, n) for n in simple.shape)
    inside = tuple(slice(w // 2, n - (w - 1) // 2) for n, w in zip(simple.shape, window))
    of_simple, of_other = (
        uniform_filter(errors, window, np.float64)[inside] + TUNED.everywhere * errors.mean()  # type: ignore[arg-type]
        for errors in (simple, other)
    )
    ratio = of_simple / np.maximum(of_other, np.finfo(np.float64).tiny)
    middle = np.unravel_index(np.argmax(ratio), ratio.shape)
    return tuple(_around(int(m) + i.start, n) for m, i, n in zip(middle, inside, simple.shape))  # type: ignore[return-value]


def _around(middle: int, length: int) -> slice:
    """TUNED.tile pixels around the middle one, within so many; all of them if there are fewer."""
    start = max(min(middle - TUNED.tile // 2, length - TUNED.tile), 0)
    return slice(start, start + TUNED.tile)
