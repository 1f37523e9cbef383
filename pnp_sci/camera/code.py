"""The code that masks leave in a measurement: how much of the light follows it, and where it lies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pnp_sci.camera.explained import WIDTH

BLOCK = 16  # pixels a side of the blocks whose spread gives standard errors; half of it for pictures below 64 a side
FEWEST = 9  # blocks: fewer give no standard error
FAINT = 1e-6  # of the mean square of the sums of masks: a fainter code is none
WEAK = 0.05  # detail of a combination of views, as part of what independent ones have: less tells nothing of it
UNTOLD = 0.05  # part of the light that may be in such combinations
LAGS = 8  # pixels either way in which another position of the masks is looked for


@dataclass(frozen=True)
class Estimate:
    """A number with its standard error, and what it explains as part of what the masks explain."""

    value: tuple[float, ...]
    errors: float  # how many standard errors it is away from 0, the largest of several numbers
    gain: float = 0.0


@dataclass(frozen=True, eq=False)
class Match:
    """What one measurement shows of the code.

    Attributes
    ----------
    follows, error : float
        Light that follows the code over the mean light, 1 for masks that fit, and its standard error.
    light, light_error : float
        The inverse: mean light over the light that follows the code, and its standard error. They tell more where too
        much has been subtracted from y, so that its mean is small.
    share : float
        Part of the variance of the fine detail of y that the masks explain.
    contrast : float
        Variance of the fine detail over the least that a code like this one leaves.
    level : Estimate
        Mean level of each view.
    off : Estimate
        Shift of the masks in rows and columns that would explain more, to first order in pixels.
    turn : Estimate
        Rotation and growth of the masks that would explain more, to first order in pixels at half of the longer side.
    blur : Estimate
        Weight of the masks' Laplacian that would explain more: positive where y is less sharp than they are.
    lag : Estimate
        The shift in whole pixels, of at most eight, whose masks explain most.
    """

    follows: float
    error: float
    light: float
    light_error: float
    share: float
    contrast: float
    level: Estimate
    off: Estimate
    turn: Estimate
    blur: Estimate
    lag: Estimate


class Code:
    """The fine detail of each view's sum of masks, which no scene follows.

    Parameters
    ----------
    sums : ndarray of float32, (V, H, W)
        Sums of each view's masks over its frames.
    good : ndarray of bool, (H, W), optional
        Pixels that are used; all by default.
    """

    def __init__(self, sums: np.ndarray, good: np.ndarray | None = None):
        self.sums, self.good, shape = sums, good, sums.shape[1:]
        self.block = BLOCK if min(shape) >= 4 * BLOCK else BLOCK // 2
        rows, columns = (n // self.block * self.block for n in shape)
        self.used = np.zeros(shape, np.float32)
        self.used[:rows, :columns] = 1 if good is None else good[:rows, :columns]
        self.detail = np.stack([self.fine(total) for total in sums]) * self.used
        self.normal = np.einsum("vij,wij->vw", self.detail, self.detail).astype(np.float64)
        self.inverse = np.linalg.pinv(self.normal, rcond=1e-6, hermitian=True)
        self.blocks = self.in_blocks(self.used) > 0
        energy = float(np.einsum("vhw,vhw,hw->", sums, sums, self.used))
        self.present = bool(self.blocks.sum() >= FEWEST and np.trace(self.normal) > FAINT * energy)

    @cached_property
    def tells_light(self) -> bool:
        """Whether the details of the views tell how much light follows the code.

        Where the masks of two views complement each other, as those of a mirror that reflects to either side, the sum
        of both is the same in all pixels: details tell only by how much the views differ.
        """
        scale = np.sqrt(np.diagonal(self.normal))
        scale = np.where(scale > 1e-3 * scale.max(), scale, 1)  # the same limit as that of the inverse
        values, directions = np.linalg.eigh(self.normal / np.outer(scale, scale))
        parts = np.square(directions.T @ (np.einsum("vhw,hw->v", self.sums, self.used) / scale))
        return bool(parts[values < WEAK].sum() <= UNTOLD * parts.sum())

    @cached_property
    def spectra(self) -> np.ndarray:
        """Conjugate spectra of the views' details, (V, H, W / 2 + 1)."""
        from scipy.fft import rfft2

        return np.conj(np.asarray(rfft2(self.detail)))

    @cached_property
    def from_centre(self) -> np.ndarray:
        """Rows and columns from the centre, as parts of half of the longer side, (2, H, W)."""
        down, right = (np.arange(n, dtype=np.float32) - (n - 1) / 2 for n in self.used.shape)
        return np.stack(np.meshgrid(down, right, indexing="ij")) / np.float32(max(self.used.shape) / 2)

    def mean(self, picture: np.ndarray) -> np.ndarray:
        """Gaussian mean of a picture (H, W) over the good pixels."""
        from scipy.ndimage import gaussian_filter

        if self.good is None:
            return gaussian_filter(picture, WIDTH, mode="nearest")
        weight = gaussian_filter(self.good.astype(np.float32), WIDTH, mode="nearest")
        return gaussian_filter(picture * self.good, WIDTH, mode="nearest") / np.maximum(weight, np.float32(1e-6))

    def fine(self, picture: np.ndarray) -> np.ndarray:
        """A picture (H, W) less its mean."""
        return picture - self.mean(picture)

    def in_blocks(self, pictures: np.ndarray) -> np.ndarray:
        """Sums over each block of pictures (..., H, W) that are 0 where nothing is used, (..., K)."""
        *several, height, width = pictures.shape
        rows, columns = height // self.block, width // self.block
        cut = pictures[..., : rows * self.block, : columns * self.block]
        split = cut.reshape(*several, rows, self.block, columns, self.block)
        return split.sum((-3, -1)).astype(np.float64).reshape(*several, -1)

    def around(self, pixels: np.ndarray) -> np.ndarray:
        """The blocks that hold one of the pixels (H, W), and what is beyond whole blocks, (H, W)."""
        touched = self.in_blocks(pixels).astype(bool)
        rows, columns = (n // self.block for n in pixels.shape)
        large = touched.reshape(rows, columns).repeat(self.block, 0).repeat(self.block, 1)
        out = np.ones(pixels.shape, bool)
        out[: large.shape[0], : large.shape[1]] = large
        return out

    def match(self, y: np.ndarray) -> Match:
        """How y (H, W) matches the code, which must be present."""
        mean = self.mean(y)
        detail = (y - mean) * self.used
        products = self.products(detail)
        levels = self.inverse @ products.sum(1)
        predicted = np.einsum("v,vhw->hw", levels.astype(np.float32), self.detail)
        left_over = detail - predicted
        explained, total = float(levels @ products.sum(1)), float(np.einsum("hw,hw->", detail, detail))
        follows, error, light, light_error = self._follows(products, self.in_blocks(y * self.used)[self.blocks])
        by_rows, by_columns = (_slope(predicted, axis) for axis in (0, 1))
        down, right = self.from_centre
        turned, grown = down * by_columns - right * by_rows, down * by_rows + right * by_columns
        rows, columns, rotation, growth = (
            self._beside(term, left_over, explained) for term in (by_rows, by_columns, turned, grown)
        )
        return Match(
            follows,
            error,
            light,
            light_error,
            explained / total if total else 0.0,
            total / max(self._least(mean), 1e-30),
            self._level(levels, left_over),
            _together(rows, columns),
            _together(rotation, growth),
            self._beside(_laplacian(predicted), left_over, explained),
            self._lag(detail, predicted, explained),
        )

    def products(self, detail: np.ndarray) -> np.ndarray:
        """Products of the fine detail of y (H, W) with each view's, summed over each block that is used, (V, K)."""
        return self.in_blocks(self.detail * detail)[:, self.blocks]

    def coded(self, products: np.ndarray) -> np.ndarray:
        """The light (K,) of each block that follows the code, from products (V, K).

        The filter ``w = sum over v of mean(S_v) (A^-1 s)_v``, with A the products of the details s, passes what follows
        the sums S, so that ``n sum(w y)`` is the sum of y unless y holds what the masks do not explain.
        """
        return np.einsum("vhw,hw->v", self.sums, self.used).astype(np.float64) @ self.inverse @ products

    def _follows(self, products: np.ndarray, light: np.ndarray) -> tuple[float, float, float, float]:
        """The part of the light that follows the code, its error and their inverse, from sums over each block.

        The errors are infinite where the light cannot be told.
        """
        if not self.tells_light:
            return 0.0, float("inf"), 0.0, float("inf")
        coded = self.coded(products)
        inverse = _ratio(light, coded) if (self.sums >= 0).all() else (0.0, float("inf"))
        if abs(light.sum()) <= np.abs(light).sum() / 2:  # masks that cancel each other: there is no mean light
            return 0.0, float("inf"), *inverse
        return *_ratio(coded, light), *inverse

    def _least(self, mean: np.ndarray) -> float:
        """Energy of the code if all views were equally bright: more light in one of them leaves more."""
        total = self.sums.sum(0)
        below = self.mean(total)
        level = np.divide(mean, below, out=np.zeros_like(mean), where=np.abs(below) > 1e-3 * np.abs(below).max())
        code = level * self.detail.sum(0)
        return float(np.einsum("hw,hw->", code, code))

    def _level(self, levels: np.ndarray, left_over: np.ndarray) -> Estimate:
        errors = _error(self.in_blocks(self.detail * left_over)[:, self.blocks])
        spread = np.sqrt(np.square(self.inverse) @ np.square(errors))
        return Estimate(tuple(map(float, levels)), float(np.max(np.abs(levels) / np.maximum(spread, 1e-30))))

    def _beside(self, term: np.ndarray, left_over: np.ndarray, explained: float) -> Estimate:
        """Least squares of what is left over on a further term (H, W)."""
        term = term * self.used
        products, squares = (self.in_blocks(term * other)[self.blocks] for other in (left_over, term))
        if squares.sum() == 0 or explained <= 0:
            return Estimate((0.0,), 0.0)
        value = products.sum() / squares.sum()
        error = _error(products - value * squares)
        gain = value * products.sum() / explained
        return Estimate((float(value),), float(abs(products.sum()) / max(error, 1e-30)), float(gain))

    def _lag(self, detail: np.ndarray, predicted: np.ndarray, explained: float) -> Estimate:
        """The whole pixels by which the masks explain most, and what beside."""
        reach = [min(LAGS, n // 4) for n in self.used.shape]
        near = tuple(np.arange(-r, r + 1) for r in reach)
        correlations = self.correlations(detail)[:, near[0][:, None], near[1]]
        explains = np.einsum("vij,vw,wij->ij", correlations, self.inverse, correlations)
        best = np.unravel_index(int(np.argmax(explains)), explains.shape)
        lag = tuple(int(n[b]) for n, b in zip(near, best))
        if lag == (0, 0) or explained <= 0:
            return Estimate((0, 0), 0.0)
        levels = self.inverse @ correlations[(slice(None), *best)]
        moved = np.einsum("v,vhw->hw", levels.astype(np.float32), np.roll(self.detail, lag, (1, 2))) * self.used
        gains = self.in_blocks((2 * detail - moved) * moved - (2 * detail - predicted) * predicted)[self.blocks]
        return Estimate(lag, float(gains.sum() / max(_error(gains - gains.mean()), 1e-30)), gains.sum() / explained)

    def correlations(self, detail: np.ndarray) -> np.ndarray:
        """Products of the fine detail of y (H, W) with each view's, moved by all shifts modulo the size, (V, H, W)."""
        from scipy.fft import irfft2, rfft2

        return np.asarray(irfft2(np.asarray(rfft2(detail)) * self.spectra, s=detail.shape))


def _error(blocks: np.ndarray) -> np.ndarray:
    """Standard error of the sum over blocks, (...), from their squares: blocks may differ in variance."""
    count = blocks.shape[-1]
    return np.sqrt(np.square(blocks).sum(-1) * count / max(count - 1, 1))


def _ratio(over: np.ndarray, under: np.ndarray) -> tuple[float, float]:
    """The ratio of the sums over blocks (K,), and its standard error."""
    ratio = over.sum() / under.sum()
    return float(ratio), float(_error(over - ratio * under) / abs(under.sum()))


def _together(one: Estimate, other: Estimate) -> Estimate:
    return Estimate(one.value + other.value, max(one.errors, other.errors), one.gain + other.gain)


def _slope(picture: np.ndarray, axis: int) -> np.ndarray:
    """What a shift by one pixel along the axis adds to the picture, to first order."""
    return (np.roll(picture, 1, axis) - np.roll(picture, -1, axis)) / 2


def _laplacian(picture: np.ndarray) -> np.ndarray:
    return sum(np.roll(picture, step, axis) for step in (-1, 1) for axis in (0, 1)) - 4 * picture
