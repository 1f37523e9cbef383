"""Pixels of the sensor that do not follow the light: hot and dead ones."""

from __future__ import annotations

import numpy as np

WIDTH = 2.0  # pixels: standard deviation of the Gaussian mean that a pixel is first compared with
NEIGHBOURS = 12  # that measure anything: the window around a pixel holds so many on average
TAIL = 0.02  # part of the pixels, those that stand out most, from which the tail of a distribution is extrapolated
FEWEST = 50  # pixels in the tail, at least
PASSES = 4
LEAST = 1.5  # ratio to neighbours within two pixels, more for others: smaller ones harm no more than texture does
UNLIKELY = 6.0  # median steps from pixel to pixel, about as many standard deviations: noise makes none as dark
LINES = 5  # side by side that are 0: in fewer, single pixels are looked at
FEW = 0.1  # of the pixels: more that are negative are no outliers
BY_CHANCE = 0.01  # good pixels of a picture that are taken for outliers, on average


def outliers(y: np.ndarray, weight: np.ndarray, good: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Hot and dead pixels of y (H, W), bool; `weight` is the sum of the magnitudes of all masks.

    A pixel measures a mean of its frames: y over the weight. It is compared with the second largest (for dead pixels
    the second smallest) of those of its 24 neighbours: small highlights are in several pixels, and two bad pixels may
    be neighbours. The logarithm of the ratio has an exponential tail on natural scenes. Where it begins and how it
    falls are estimated from the 2 % of the pixels that stand out most, and a pixel is an outlier beyond the point
    that one picture in a hundred exceeds.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> y = scene.y.copy()
    >>> y[20, 30], y[40, 50] = 10 * y.max(), 0
    >>> hot, dead = outliers(y, scene.masks.sum((0, 1)).astype(float))
    >>> np.argwhere(hot).tolist(), np.argwhere(dead).tolist()
    ([[20, 30]], [[40, 50]])
    """
    usable = np.ones(y.shape, bool) if good is None else good
    hot, dead = np.zeros(y.shape, bool), np.zeros(y.shape, bool)
    for _ in range(PASSES):  # what is found no longer hides others, and no longer is part of the tail
        left = usable & ~hot & ~dead
        new_hot, new_dead = _beyond(y, weight, left, 1), _beyond(y, weight, left, -1)
        hot, dead = hot | new_hot, dead | new_dead
        if not (new_hot.any() or new_dead.any()):
            break
    left = usable & ~hot & ~dead
    for value in {0.0, float(y[left].min(initial=0))}:  # no light, and what a file has where there are no data
        dead |= _stuck(y, weight, left, value)
    return hot, dead


def negative(y: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Usable pixels of y (H, W) that are more negative than noise about 0 allows, if they are few."""
    spread = typical_step(y, usable)
    light = np.median(np.abs(y[usable])) if usable.any() else 0.0
    below = usable & (y < -(light + UNLIKELY * spread))
    return below & (below.sum() < FEW * usable.sum())


def typical_step(y: np.ndarray, usable: np.ndarray) -> float:
    """The median step from pixel to pixel of y (H, W), along rows or columns, whichever is larger."""
    steps = [np.abs(np.diff(y, axis=a))[np.delete(usable, 0, a) & np.delete(usable, -1, a)] for a in (0, 1)]
    return max((float(np.median(step)) for step in steps if step.size), default=0.0)


def _beyond(y: np.ndarray, weight: np.ndarray, usable: np.ndarray, sign: int) -> np.ndarray:
    """Usable pixels that are brighter (sign 1) or darker (-1) than the tail of the others allows."""
    beyond = np.zeros(y.shape, bool)
    count = tail_size(y.size)
    if usable.sum() < 4 * count:
        return beyond
    rows, columns, ratio, reach = most_unlike(y, weight, usable, 2 * count, sign)
    out = np.log(np.maximum(ratio, 1e-6)) if sign > 0 else 1 - ratio
    chosen = out > max(beyond_tail(out, count), np.log(LEAST * reach / 2))
    beyond[rows[chosen], columns[chosen]] = True
    return beyond


def most_unlike(
    y: np.ndarray, weight: np.ndarray, usable: np.ndarray, count: int, sign: int = 1, beside: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """The usable pixels that stand out most: rows, columns, and their ratios to what neighbours allow, each (count,).

    Neighbours are the usable pixels, or those in `beside`; the last value is how many pixels away they are, at most.
    With sign -1, the pixels are the darkest ones.
    """
    seen = (usable if beside is None else beside) & (weight > 0)
    floor, reach = _floor(y[seen if seen.any() else usable]), _reach(seen)
    rows, columns = _standing_out(y, weight, usable, floor, sign, count)
    mean = np.where(seen, sign * y / np.where(seen, weight, 1), -np.inf)
    around = np.partition(_neighbours(mean, rows, columns, reach), -2, 0)[-2]
    theirs = np.where(np.isfinite(around), sign * around, 0) * weight[rows, columns]
    return rows, columns, np.maximum(y[rows, columns] + floor, 0) / np.maximum(theirs + floor, 1e-6 * floor), reach


def tail_size(pixels: int) -> int:
    """How many of so many pixels are the tail of a distribution."""
    return max(int(TAIL * pixels), FEWEST)


def beyond_tail(values: np.ndarray, count: int, by_chance: float = BY_CHANCE) -> float:
    """The value that so many exceed by chance, if the tail, the largest `count` values, is exponential."""
    tail = np.sort(values, None)[-count:]
    fall = (np.quantile(tail, 0.25) - tail[0]) / np.log(4 / 3)  # the quartile, as outliers are above it
    return float(tail[0] + fall * np.log(count / by_chance))


def _stuck(y: np.ndarray, weight: np.ndarray, usable: np.ndarray, value: float) -> np.ndarray:
    """Usable pixels that are exactly `value` where more is expected than in any other pixel that is about as dark.

    Equal negative values do not occur by chance: if most of several such pixels are found, all of them are.
    """
    usable = usable & (weight > 0)
    others, stuck = usable & (y != value), usable & (y == value)
    by_chance = others.any() and np.mean(y[others] < 0) > FEW  # about 0, it is a value like others
    if stuck.sum() <= (value < 0) or not others.any() or by_chance:
        return np.zeros(y.shape, bool)
    light, size = expected(y, weight, others), np.abs(y)
    dark = others & (size <= np.quantile(size[others], TAIL / 2))
    found = stuck & (light > light[dark].max() * _reach(usable) / 2)
    return stuck if value < 0 and 2 * found.sum() > stuck.sum() else found


def lost_lines(y: np.ndarray, weight: np.ndarray, usable: np.ndarray, dead: np.ndarray) -> list[tuple[int, slice]]:
    """Axis (0 for rows) and range of five or more lines of y (H, W) that are exactly 0; some of each are `dead`."""
    lost, lit = [], usable & (weight > 0)
    for axis in (0, 1):
        zero = lit.any(1 - axis) & ~(lit & (y != 0)).any(1 - axis)
        edges = np.flatnonzero(np.diff(np.pad(zero, 1).astype(np.int8)))
        ranges = [slice(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
        lines = dead if axis == 0 else dead.T
        lost += [(axis, r) for r in ranges if r.stop - r.start >= LINES and lines[r].any()]
    return lost


def expected(y: np.ndarray, weight: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """What each pixel measures if the light is as around it, from the usable pixels."""
    from scipy.ndimage import gaussian_filter

    light, below = (gaussian_filter(a * usable, WIDTH, mode="nearest") for a in (np.abs(y), weight))
    return weight * np.divide(light, below, out=np.zeros_like(light), where=below > 0)


def _floor(y: np.ndarray) -> float:
    """A level below which ratios are noise: half of the median, or more if the noise makes values negative."""
    return max(
        float(np.median(np.abs(y))) / 2, -3 * float(np.quantile(y, 0.001)), 1e-3 * float(np.mean(np.abs(y))), 1e-30
    )


def _standing_out(y, weight, usable, floor, sign, count) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels that stand out most from the Gaussian mean around them."""
    around = expected(y, weight, usable)
    ratio = np.where(usable, sign * np.log(np.maximum(y + floor, 1e-6 * floor) / (around + floor)), -np.inf)
    most = np.argpartition(ratio, -count, None)[-count:]
    return np.unravel_index(most, y.shape)  # type: ignore[return-value]


def _reach(seen: np.ndarray) -> int:
    """Pixels either way in which a pixel is compared with others; `seen` are those that measure anything."""
    return int(np.clip(np.ceil((np.sqrt(1 + NEIGHBOURS / max(float(seen.mean()), 1e-3)) - 1) / 2), 2, 8))


def _neighbours(picture: np.ndarray, rows: np.ndarray, columns: np.ndarray, reach: int) -> np.ndarray:
    """The neighbours of each of the pixels, (neighbours, pixels), 24 for a reach of 2; minus infinity outside."""
    padded = np.pad(picture, reach, constant_values=-np.inf)
    steps = range(2 * reach + 1)
    return np.stack([padded[rows + i, columns + j] for i in steps for j in steps if (i, j) != (reach, reach)])
