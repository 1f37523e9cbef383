"""The fine detail of a measurement, explained by moved masks: in small blocks every view has a level of its own."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pnp_sci.camera.code import Code
from pnp_sci.camera.explained import BLOCK, fine_detail
from pnp_sci.camera.pile import pile
from pnp_sci.camera.warp import Transform, centre, known, spread, warped
from pnp_sci.sensing.noise import blocks

MARGIN = 2.0  # pixels from the border of the masks in which fine detail is not used: the width of its Gaussian
PROBE = 0.25  # pixels: half of the step of central differences; interpolated masks have kinks at whole pixels
FEW = 0.02  # part of the blocks in which noise alone is left unexplained
PARAMETERS = 5  # of a transform: shift along rows and columns, rotation, growth, blur


class LocalModel:
    """What masks, moved by a transform for each view, explain of measurements.

    In a block of 16 x 16 pixels, a view has a level, its slope along rows and columns, and a linear change in time.
    These are coefficients of columns made of the masks: their sum over frames, the sum times a ramp, and the sum
    weighted by time. The coefficients are fitted to the fine detail of y, which no constant offset of y reaches.

    Parameters
    ----------
    measurements : ndarray, (N, H, W)
    masks : ndarray, (V, B, H, W)
    interpolation : "linear" or "cubic"
    """

    def __init__(self, measurements: np.ndarray, masks: np.ndarray, interpolation: str):
        self.measurements = np.stack([tamed(y) for y in measurements])
        self.interpolation, self.shape = interpolation, masks.shape
        times = np.linspace(-1, 1, masks.shape[1])
        weights = [np.ones_like(times), times][: masks.shape[1]]  # one frame has no change in time
        self.planes = np.stack([np.einsum("b,vbhw->vhw", w, masks) for w in weights], 1)  # (V, 1 or 2, H, W)
        self.detail = np.stack([_blocked_detail(y) for y in self.measurements])  # (N, K, P)
        weight = np.abs(masks).sum((0, 1), dtype=np.float64)
        saturated = [blocks(y >= found[0], BLOCK).any(1) for y in measurements if (found := pile(y, weight))]
        self.exact = ~np.logical_or.reduce([np.zeros(self.detail.shape[1], bool), *saturated])[:, None]  # (K, 1)
        self.ramps = [np.arange(n) % BLOCK / (BLOCK - 1) - 0.5 for n in masks.shape[2:]]

    @cached_property
    def tells_light(self) -> bool:
        """Whether fine detail tells how much light there is, see :attr:`pnp_sci.camera.code.Code.tells_light`."""
        return Code(self.planes[:, 0].astype(np.float32)).tells_light

    def mirrored(self, mirror: Callable[[np.ndarray], np.ndarray]) -> LocalModel:
        """The model with other masks: a mirror takes planes (..., H, W)."""
        other = copy(self)
        other.planes = mirror(self.planes)
        return other

    def usable(self, transforms: list[Transform]) -> np.ndarray:
        """Pixels (K, P) whose mask elements are known and whose fine detail no border reaches, in exact blocks."""
        inside = [known(transform, self.shape, MARGIN) for transform in {*transforms, Transform()}]
        return blocks(np.logical_and.reduce(inside), BLOCK) & self.exact

    def fit(self, transforms: list[Transform], usable: np.ndarray | None = None) -> LocalFit:
        """Least squares in each block, on usable pixels: by default those of these transforms."""
        usable = self.usable(transforms) if usable is None else usable
        columns = self._columns(_moved(self.planes, transforms, self.interpolation))
        flat = columns.reshape(-1, *self.shape[2:])
        design = np.stack([_blocked_detail(column) for column in flat], -1) * usable[..., None]
        inverse = np.linalg.pinv(design.transpose(0, 2, 1) @ design, rcond=1e-6, hermitian=True)
        detail = self.detail * usable
        levels = np.einsum("kqr,kpr,nkp->nkq", inverse, design, detail, optimize=True)
        residual = detail - np.einsum("kpq,nkq->nkp", design, levels)
        return LocalFit(columns, usable, design, inverse, levels, detail, residual)

    def derivatives(self, transforms: list[Transform], fit: LocalFit) -> np.ndarray:
        """Change of what is explained, with the levels of the fit, by the parameters of each view: (V, 5, N, K, P).

        Per pixel: shift along rows, along columns, rotation and growth, both by a pixel at half of the longer side; and
        blur, per pixel squared. The change in time is left out: it makes little of a derivative.
        """
        slopes = self._slopes(transforms)
        radius = max(self.shape[2:]) / 2
        out = np.empty((self.shape[0], PARAMETERS, *self.detail.shape))
        levels = fit.levels.reshape(*fit.levels.shape[:2], self.shape[0], -1)
        for v, transform in enumerate(transforms):
            middle = centre(self.shape) + transform.shift
            down, right = (np.indices(self.shape[2:]) - middle[:, None, None]) / radius
            for n in range(len(self.detail)):
                level = self._level(levels[n, :, v])
                by_rows, by_columns, by_blur = (level * slope[v] for slope in slopes)
                turned, grown = down * by_columns - right * by_rows, down * by_rows + right * by_columns
                for j, picture in enumerate((by_rows, by_columns, turned, grown, by_blur)):
                    out[v, j, n] = _blocked_detail(picture)
        return out

    def _columns(self, planes: np.ndarray) -> np.ndarray:
        """The columns (V, Q, H, W) of moved planes: level, slopes, change in time."""
        down, right = self.ramps
        total = planes[:, :1]
        return np.concatenate([total, total * down[:, None], total * right, planes[:, 1:]], 1)

    def _slopes(self, transforms: list[Transform]) -> list[np.ndarray]:
        """Derivatives (V, H, W) of the moved sums by a shift along rows, along columns, and by blur."""

        def sums(rows: float, columns: float) -> np.ndarray:
            shifted = [replace(t, rows=t.rows + rows, columns=t.columns + columns) for t in transforms]
            return _moved(self.planes[:, 0], shifted, self.interpolation)

        sharp = _moved(self.planes[:, 0], [replace(t, blur=0.0) for t in transforms], self.interpolation)
        softer = np.stack([spread(view, t.blur, derivative=True) for view, t in zip(sharp, transforms)])
        steps = (PROBE, 0), (0, PROBE)
        return [*((sums(*step) - sums(*np.negative(step))) / (2 * PROBE) for step in steps), softer]

    def _level(self, levels: np.ndarray) -> np.ndarray:
        """The level of a view (H, W) from its coefficients (K, Q) in the blocks; 0 beyond the last whole block."""
        (rows, columns), (down, right) = self.shape[2:], self.ramps
        grid = levels.T.reshape(-1, rows // BLOCK, columns // BLOCK).repeat(BLOCK, 1).repeat(BLOCK, 2)
        grid = np.pad(grid, ((0, 0), (0, rows - grid.shape[1]), (0, columns - grid.shape[2])))
        return grid[0] + grid[1] * down[:, None] + grid[2] * right


@dataclass(frozen=True, eq=False)
class LocalFit:
    """A fit of K blocks of P pixels with Q coefficients, for N measurements."""

    columns: np.ndarray  # (V, Q / V, H, W)
    usable: np.ndarray  # (K, P)
    design: np.ndarray  # (K, P, Q): fine detail of the columns
    inverse: np.ndarray  # (K, Q, Q)
    levels: np.ndarray  # (N, K, Q)
    detail: np.ndarray  # (N, K, P): that of the measurements
    residual: np.ndarray  # (N, K, P)

    @property
    def share(self) -> float:
        """Share of the fine detail that is explained, less what as many columns explain by chance."""
        total = float(np.sum(self.detail**2))
        if total == 0:
            return 0.0
        pixels, coefficients = self.usable.sum(), self.design.shape[-1] * self.usable.any(1).sum()
        return 1 - float(np.sum(self.residual**2)) / total * float(pixels / max(pixels - coefficients, 1))

    @property
    def share_by_chance(self) -> float:
        """Standard error of the share of masks that have nothing to do with y: that of a chi-square variable."""
        coefficients = self.design.shape[-1] * self.usable.any(1).sum() * len(self.detail)
        return float(np.sqrt(2 * coefficients) / max(self.usable.sum() * len(self.detail), 1))

    @property
    def strong(self) -> np.ndarray:
        """Whether each view (V,) explains more than is left unexplained, apart from noise.

        What is left may mislead the transform of a view that explains less. The variance of the noise is that of the
        blocks with the least residual.
        """
        views = self.columns.shape[:2]
        design, levels = (a.reshape(*a.shape[:2], *views) for a in (self.design, self.levels))
        explained = (np.einsum("kpvq,nkvq->vnkp", design, levels) ** 2).sum((1, 2, 3))
        there = self.usable.any(1)
        left, pixels = (self.residual[:, there] ** 2).sum(-1), self.usable[there].sum(1)
        noise = np.quantile(left / pixels, FEW) if left.size else 0.0
        return explained > (left - noise * pixels).sum()

    def beyond(self, detail: np.ndarray) -> np.ndarray:
        """What the columns do not explain of other fine detail (..., K, P)."""
        detail = detail * self.usable
        levels = np.einsum("kqr,kpr,...kp->...kq", self.inverse, self.design, detail, optimize=True)
        return detail - np.einsum("kpq,...kq->...kp", self.design, levels)


def tamed(y: np.ndarray) -> np.ndarray:
    """y (H, W) clipped at three times the way from its median to its 1 and 99 % quantiles: hot pixels count little."""
    low, middle, high = np.quantile(y, (0.01, 0.5, 0.99))
    return np.clip(y, middle + 3 * (low - middle), middle + 3 * (high - middle))


def _moved(planes: np.ndarray, transforms: list[Transform], interpolation: str) -> np.ndarray:
    return np.stack([warped(view, transform, interpolation) for view, transform in zip(planes, transforms)])


def _blocked_detail(picture: np.ndarray) -> np.ndarray:
    return blocks(fine_detail(picture), BLOCK)
