"""The start of a registration: where tiles of the measurement find the pattern of the masks."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.explained import fine_detail
from pnp_sci.camera.warp import Transform, centre

TILE = 32  # pixels a side, less where a side would have fewer than 8 tiles: a rotation hardly shows within
FEWEST = 8
MIDDLE = 256  # pixels a side, around the centre, where rotation and scale move little
FARTHEST = 8  # the masks may have moved by this part of the middle: one eighth, 32 pixels


def coarse_transform(measurements: np.ndarray, sums: np.ndarray, lag: np.ndarray | None = None) -> Transform:
    """The transform, to about half a pixel, with which the sums of masks correlate best with y in small tiles.

    First the middle of the picture finds the best whole lag, by a Fourier transform. Then each tile is correlated with
    the sums at the lags around it. Shifts, rotations and scales are tried: each gives every tile a lag. The start is
    that with the largest sum of correlations. Rotation and scale may move the edges by 1/64 of the side: 0.9 degrees.

    Parameters
    ----------
    measurements : ndarray, (N, H, W)
    sums : ndarray, (V, H, W)
        Of the masks of each view.
    lag : ndarray, (2,), optional
        Whole pixels around which is sought, instead of the lag of the middle.
    """
    details = np.stack([fine_detail(y) for y in measurements])
    sums = np.stack([fine_detail(total) for total in sums])
    sums /= np.sqrt((sums**2).sum((1, 2), keepdims=True)) + np.finfo(float).tiny
    measured, pattern = details.sum(0), sums.sum(0)
    lag = _best_lag(measured, pattern) if lag is None else lag
    reach = 1 + -(-max(pattern.shape) // 64)
    scores, centres = _tile_scores(measured, pattern, lag, reach)
    return _best_transform(scores, centres, lag, reach, pattern.shape)


def _best_lag(measured: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """Whole lag (2,) at which the middle of the measurement (H, W) correlates best with the pattern (H, W)."""
    from numpy.fft import irfft2, rfft2

    middle = tuple(slice((n - min(n, MIDDLE)) // 2, (n + min(n, MIDDLE)) // 2) for n in pattern.shape)
    shape = pattern[middle].shape
    scores = irfft2(rfft2(measured[middle]) * rfft2(pattern[middle]).conj(), shape)
    reach = [n // FARTHEST for n in shape]
    near = np.roll(scores, reach, (0, 1))[: 2 * reach[0] + 1, : 2 * reach[1] + 1]
    return np.array(np.unravel_index(near.argmax(), near.shape)) - reach


def _tile_scores(
    measured: np.ndarray, pattern: np.ndarray, lag: np.ndarray, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """Correlations (T, L, L) of tiles with the pattern, at lags up to `reach` from `lag`, and their centres (T, 2)."""
    from numpy.fft import irfft2, rfft2

    rows, columns = (min(TILE, n // FEWEST) for n in pattern.shape)
    corners = np.indices((pattern.shape[0] // rows, pattern.shape[1] // columns)).reshape(2, -1).T * (rows, columns)
    pad = reach + int(np.abs(lag).max())
    pattern = np.pad(pattern, pad)
    size = rows + 2 * reach, columns + 2 * reach
    scores = []
    for top, left in corners:
        above, before = np.array([top, left]) - lag - reach + pad
        window = pattern[above : above + size[0], before : before + size[1]]
        tile = measured[top : top + rows, left : left + columns]
        scores.append(irfft2(rfft2(window) * rfft2(tile, size).conj(), size)[2 * reach :: -1, 2 * reach :: -1])
    return np.stack(scores), corners + (np.array([rows, columns]) - 1) / 2


def _best_transform(
    scores: np.ndarray, centres: np.ndarray, lag: np.ndarray, reach: int, shape: tuple[int, ...]
) -> Transform:
    """The similarity that gives the tiles the lags with the largest sum of scores (T, L, L): by pixels, then halves."""
    from scipy.ndimage import map_coordinates

    away, radius = centres - centre(shape), max(shape) / 2
    down, right = away.T[:, None] / radius
    bends, shifts = np.arange(1.0 - reach, reach), np.arange(-1.0, 2.0)
    axes = bends, bends, shifts, shifts
    best = np.zeros(4)
    for step in (1.0, 0.5):
        turns, growths, downs, rights = (a.reshape(-1, 1) for a in np.meshgrid(*axes, indexing="ij"))
        rows = downs + growths * down - turns * right
        columns = rights + growths * right + turns * down
        tiles = np.broadcast_to(np.arange(len(scores)), rows.shape)
        votes = map_coordinates(scores, [tiles, rows + reach, columns + reach], order=1, mode="nearest").sum(1)
        chosen = int(votes.argmax())
        best = np.array([a[chosen, 0] for a in (turns, growths, downs, rights)])
        axes = tuple(value + step * np.array([-1, -0.5, 0, 0.5, 1]) for value in best)
    turn, growth, *shift = best
    rows, columns = lag + np.array(shift)
    return Transform(float(rows), float(columns), float(np.rad2deg(turn / radius)), 1 + float(growth / radius))
