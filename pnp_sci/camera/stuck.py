"""Columns and rows of the sensor, or parts of them, that are stuck at one value."""

from __future__ import annotations

import numpy as np

SMALL = 0.1  # of the median step from pixel to pixel: a stuck line may have some noise
SHORTEST = 9  # pixels of a run: fewer are no line
AROUND = 4  # columns on either side that tell how often steps are small
BY_CHANCE = 1e-6  # runs of a picture, at most, that would be so long by chance if steps were independent
FEW = 0.1  # of the pixels: more in such runs are no defects of a sensor
END = 1e-3  # of the pixels: if no more are beyond a value, it is an end of the range
ALIKE = 3  # other pixels that have the largest value if it is that of saturation


def stuck_lines(y: np.ndarray, sums: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Pixels of columns and rows of y (H, W) that are stuck above 0, bool; `sums` (V, H, W) are of each view's masks.

    Along a stuck line steps from pixel to pixel are small where those of the masks are not, in units of the pixels'
    values. The lines beside it give the probability p of so small a step; n in a row have p**n. The darkest values of y
    are those of dark parts of the scene. The largest ones are saturated if others have them, too.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> y = scene.y.copy()
    >>> y[10:50, 20] = y.max() / 2
    >>> stuck = stuck_lines(y, scene.masks.sum(1), np.ones(y.shape, bool))
    >>> int(stuck.sum()), int(stuck[10:50, 20].sum())
    (40, 40)
    """
    y, usable = y.astype(np.float64), usable & (y > 0)
    flipped = (pixels[::-1] for pixels in _runs(y.T, sums.swapaxes(1, 2), usable.T))
    runs = [*_runs(y, sums, usable), *flipped]
    stuck, others = np.zeros(y.shape, bool), usable.copy()
    for pixels in runs:
        others[pixels] = False
    if np.sum(usable & ~others) < FEW * usable.sum():
        for pixels in runs:
            stuck[pixels] |= not _is_end(y[pixels], y[others])
    return stuck


def _runs(y: np.ndarray, sums: np.ndarray, usable: np.ndarray) -> list[tuple[slice, int]]:
    """Rows and column of each run of small steps along a column that is not there by chance."""
    both = usable[1:] & usable[:-1]
    if not both.any():
        return []
    steps, of_masks = _steps(y[None], both), _steps(sums, both)
    limit = SMALL * np.median(steps[both])
    small, telling = both & (steps <= limit), both & (of_masks > limit)
    begin_or_end = np.diff(np.pad(small, ((1, 1), (0, 0))).astype(np.int8), axis=0).T
    (columns, first), (_, last) = np.nonzero(begin_or_end > 0), np.nonzero(begin_or_end < 0)
    found = []
    for run in np.flatnonzero(last - first >= SHORTEST - 1):
        column, rows = columns[run], slice(first[run], last[run])
        beside = rows, slice(max(column - AROUND, 0), column + AROUND + 1)
        count = telling[rows, column].sum()
        probability = (np.sum((small & telling)[beside]) - count + 1) / (telling[beside].sum() - count + 2)
        if y.size * probability**count < BY_CHANCE:
            found.append((slice(rows.start, rows.stop + 1), column))
    return found


def _steps(pictures: np.ndarray, both: np.ndarray) -> np.ndarray:
    """Steps of pictures (V, H, W) along columns, (H - 1, W), in units of the two values; 0 where not both are used."""
    size = np.sum(pictures[:, 1:] + pictures[:, :-1], 0)
    return np.sum(np.abs(np.diff(pictures, axis=1)), 0) / np.where(both & (size > 0), size, np.inf)


def _is_end(values: np.ndarray, others: np.ndarray) -> bool:
    """Whether hardly any others are darker than values of a line, or hardly any brighter while some have them."""
    low, high = values.min(), values.max()
    few = END * others.size
    alike = np.sum((others >= low) & (others <= high))
    return bool(np.sum(others < low) <= few or (np.sum(others > high) <= few and alike >= ALIKE))
