"""Other arrangements of the masks that a measurement may follow: flipped, transposed, far away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pnp_sci.camera.code import Code

BY_CHANCE = 75.0  # variances: the largest of a million squared correlations reaches about 40
MEDIANS = (0.4549, 1.3863, 2.366)  # of the chi-square distributions of 1, 2 and 3 degrees of freedom

ARRANGEMENTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as they are": lambda s: s,
    "upside down": lambda s: s[..., ::-1, :],
    "left to right": lambda s: s[..., ::-1],
    "turned by 180 degrees": lambda s: s[..., ::-1, ::-1],
    "transposed": lambda s: s.swapaxes(-1, -2),
    "turned by 90 degrees": lambda s: s.swapaxes(-1, -2)[..., ::-1, :],
    "turned by 270 degrees": lambda s: s.swapaxes(-1, -2)[..., ::-1],
    "transposed along the other diagonal": lambda s: s.swapaxes(-1, -2)[..., ::-1, ::-1],
}


def in_pairs(sums: np.ndarray, axis: int) -> np.ndarray:
    """Sums of masks (V, H, W) with lines along an axis swapped in pairs, as by a wrong order of two fields.

    Their number must be even.

    >>> in_pairs(np.arange(4).reshape(1, 4, 1), 1).ravel().tolist()
    [1, 0, 3, 2]
    """
    return np.take(sums, np.arange(sums.shape[axis]) ^ 1, axis)


@dataclass(frozen=True)
class Arrangement:
    """How the masks must be arranged to fit: the name, then a shift in pixels, and whether 1 - masks fit instead."""

    name: str
    shift: tuple[int, int]
    inverted: bool

    def arranged(self, sums: np.ndarray) -> np.ndarray:
        """Sums of masks (V, H, W) in this arrangement; what leaves at one side comes in at the other."""
        return np.roll(ARRANGEMENTS[self.name](sums), self.shift, (1, 2))


def search(code: Code, y: np.ndarray) -> Arrangement | None:
    """The arrangement of masks that y (H, W) follows beyond chance, of all turns, flips and shifts; None if none.

    For each, the products of the fine details of y and of the sums of masks are computed for all shifts at once. What
    they explain is compared with its median over the shifts, which is chance.
    """
    detail = code.fine(y) * code.used
    best, found = BY_CHANCE, None
    for name, arranged in ARRANGEMENTS.items():
        if arranged(code.sums).shape != code.sums.shape:
            continue
        other = Code(np.ascontiguousarray(arranged(code.sums)), code.good)
        products = other.correlations(detail)
        explains = np.einsum("vij,vw,wij->ij", products, other.inverse, products)
        views = len(code.sums)
        typical = MEDIANS[views - 1] if views <= len(MEDIANS) else views * (1 - 2 / (9 * views)) ** 3
        chance = max(float(np.median(explains)) / typical, np.finfo(np.float32).tiny)
        place = np.unravel_index(int(np.argmax(explains)), explains.shape)
        if explains[place] > best * chance and (name, *place) != ("as they are", 0, 0):
            best = explains[place] / chance
            levels = other.inverse @ products[(slice(None), *place)]
            shift = tuple(int(p) if p <= n // 2 else int(p) - n for p, n in zip(place, explains.shape))
            found = Arrangement(name, shift, bool(levels[np.argmax(np.abs(levels))] < 0))  # type: ignore[arg-type]
    return found
