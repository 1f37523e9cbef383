"""Displacement of frames: where the data pull an estimate apart from where its content is.

A prior that averages along the motion keeps content where it is, also if it is wrong there by a fraction of a pixel.
The data then pull at the estimate x, call after call, by ``b = v - x``. To a prior b looks like noise, most of which it
removes. But a pull that displaces the content by -d is ``b = d . grad x``, with nearly the same d in all pixels of a
small window, and that can be found in noise. Each frame is displaced by the most probable d before the prior is called.
Record 20 in docs/decisions has the measurements behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.accel.jit import device_function, kernel
from pnp_sci.solvers.state import Array

REACH = 2  # blocks of 2 x 2 pixels: half width of a box; applied twice, about a Gaussian of 4 pixels
VARIANCE = 2 / 3 * ((2 * REACH + 1) ** 2 - 1)  # squared pixels: of the two boxes
WINDOW = 4 * np.pi * VARIANCE  # pixels: a mean weighted by such a Gaussian divides the variance of white noise by it
FARTHEST = 1.0  # pixels: largest displacement in one call; the gradient of x holds no farther
FAINT = 1e-4  # sigma below which priors return frames as they are
LOUDEST = 1.0  # largest noise: the range of x


@dataclass(frozen=True)
class DisplacementNumbers(Tuned):
    """How far content is expected to be displaced."""

    expected: float = 0.15  # pixels: standard deviation of a displacement


TUNED = DisplacementNumbers()


def displace(x: Array, v: Array, noise: float) -> None:
    """Displace each frame of v (V, B, H, W), in place, as the pull ``v - x`` at the estimate x says.

    ``v <- v + d . grad x`` with ``d = (S[g g^T] + noise^2 / (WINDOW expected^2) I)^-1 S[g (v - x)]`` and g = grad x.
    S is a mean over a window of about 4 pixels (standard deviation). d is the mean of the posterior for white noise of
    standard deviation `noise` and a Gaussian prior (Lucas & Kanade 1981, with a regulariser). It is bounded by
    `FARTHEST`, and equal in each block of 2 x 2 pixels. What it adds to a pixel is bounded by `noise`: a prior removes
    little of a stronger pull, and if that were doubled, the solver would go too far, again and again.

    Parameters
    ----------
    x, v : ndarray or Tensor, (V, B, H, W)
        C-ordered, values about [0, 1].
    noise : float
        Standard deviation of what v - x holds beside a displacement, in the same units.
    """
    noise = min(noise, LOUDEST)
    ridge = noise**2 / (WINDOW * TUNED.expected**2)
    if not isinstance(x, np.ndarray):
        from pnp_sci.solvers.torch_displacement import displace_tensors

        displace_tensors(x, v, ridge, noise, REACH, FARTHEST)
        return
    planes = (-1, *x.shape[2:])
    _displace(x.reshape(planes), v.reshape(planes), x.dtype.type(ridge), x.dtype.type(noise))


@device_function
def _slope(x, i, j):
    """Gradient of a frame, down and across, by central differences of a frame with replicated edges."""
    rows, columns = x.shape
    half = x.dtype.type(0.5)
    down = half * (x[min(i + 1, rows - 1), j] - x[max(i - 1, 0), j])
    return down, half * (x[i, min(j + 1, columns - 1)] - x[i, max(j - 1, 0)])


@device_function
def _products(x, v, sums):
    """sums (5, h, w) <- mean over blocks of a^2, a c, c^2, a b, c b, for gradients (a, c) of x and b = v - x."""
    rows, columns = x.shape
    quarter = x.dtype.type(0.25)
    sums[:] = 0
    for i in range(rows):
        o = sums[:, i // 2]
        for j in range(columns):
            a, c = _slope(x, i, j)
            b, k = quarter * (v[i, j] - x[i, j]), j // 2
            o[0, k] += quarter * a * a
            o[1, k] += quarter * a * c
            o[2, k] += quarter * c * c
            o[3, k] += a * b
            o[4, k] += c * b


@device_function
def _box(picture, scratch):
    """Mean over a square of 2 REACH + 1 elements, in place, with edges replicated."""
    rows, columns = picture.shape
    part = picture.dtype.type(1 / (2 * REACH + 1))
    for i in range(rows):
        o = scratch[i]
        o[:] = 0
        for d in range(-REACH, REACH + 1):
            k = min(max(i + d, 0), rows - 1)
            for j in range(columns):
                o[j] += part * picture[k, j]
    for i in range(rows):
        o = picture[i]
        for j in range(columns):
            total = scratch[i, j]
            for d in range(1, REACH + 1):
                total += scratch[i, max(j - d, 0)] + scratch[i, min(j + d, columns - 1)]
            o[j] = part * total


@kernel
def _displace(x, v, ridge, most):
    """v (K, H, W) <- v + d . grad x, frame by frame, which adds at `most` that; see :func:`displace`."""
    planes, rows, columns = x.shape
    real = x.dtype.type
    for k in numba.prange(planes):
        sums = np.empty((5, (rows + 1) // 2, (columns + 1) // 2), x.dtype)
        scratch = np.empty_like(sums[0])
        _products(x[k], v[k], sums)
        for part in sums:
            _box(part, scratch)
            _box(part, scratch)
        for i in range(sums.shape[1]):
            for j in range(sums.shape[2]):
                aa, ac, cc = sums[0, i, j] + ridge, sums[1, i, j], sums[2, i, j] + ridge
                ab, cb = sums[3, i, j], sums[4, i, j]
                below = aa * cc - ac * ac
                inverse = real(1) / below if below > 0 else real(0)
                down, across = (cc * ab - ac * cb) * inverse, (aa * cb - ac * ab) * inverse
                far = max(real(1), np.sqrt(down * down + across * across) / real(FARTHEST))
                sums[3, i, j], sums[4, i, j] = down / far, across / far
        for i in range(rows):
            for j in range(columns):
                a, c = _slope(x[k], i, j)
                more = a * sums[3, i // 2, j // 2] + c * sums[4, i // 2, j // 2]
                v[k, i, j] += min(max(more, -most), most)
