"""Views that may be dark, from the level of each view in the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator


@dataclass(frozen=True)
class DarkNumbers(Tuned):
    """When a view may be absent."""

    dark: float = 0.08  # level of a view, in units of the brightest one's


TUNED = DarkNumbers()


def lit_views(op: SensingOperator, y: np.ndarray) -> tuple[bool, ...]:
    """Which views are bright enough to be modelled in any case."""
    levels = view_levels(op, y)
    return tuple(bool(v) for v in levels > TUNED.dark * levels.max())


def view_levels(op: SensingOperator, y: np.ndarray) -> np.ndarray:
    """The mean level of each view (V,): least squares of y on the sum of each view's masks, local means subtracted.

    The sums vary from pixel to pixel by the random pattern only. No scene follows that pattern, so that the part of y
    that does belongs to the view.
    """
    from scipy.ndimage import gaussian_filter

    sums = op.masks.sum(1, dtype=np.float64)
    fine = np.stack([s - gaussian_filter(s, 4, mode="nearest") for s in sums]).reshape(len(sums), -1)
    detail = (y - gaussian_filter(y.astype(np.float64), 4, mode="nearest")).reshape(-1)
    normal = np.einsum("vp,wp->vw", fine, fine)  # einsum does not start threads, which would disturb the kernels
    # eigenvalues below 1e-10 of the largest are rounding: such views cannot be told apart, and share the light
    return np.abs(np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ np.einsum("vp,p->v", fine, detail))
