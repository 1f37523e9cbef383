"""3 x 3 convolutions by Winograd's algorithm F(4 x 4, 3 x 3), with a fourth of the multiplications, for AVX2.

A job computes 4 lines of up to 64 pixels from 6 lines of input. The columns of the input are grouped modulo 4, so that
column k of all tiles is contiguous. The transforms along lines and columns are then loops over long rows. The transform
of the result is 36 matrix products of (tiles, channels) and (channels, channels).

A. Lavin & S. Gray, "Fast algorithms for convolutional neural networks", CVPR 2016.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel, loop
from pnp_sci.accel.simd8 import LINES, multiply_16, multiply_24

OUT, IN = 4, 6  # pixels of a tile of the output and of the input, along either axis
TILES = 16  # largest number of tiles of a job
COLUMNS = 8  # divisor of the number of output channels, which is at least 16
# transform of a filter along an axis
FILTER = np.array([[6, 0, 0], [-4, -4, -4], [-4, 4, -4], [1, 2, 4], [1, -2, 4], [0, 0, 24]]) / 24
TWO, FOUR, FIVE, EIGHT = (np.float32(n) for n in (2, 4, 5, 8))  # integers would make numba use float64


def spectra(weight: np.ndarray) -> np.ndarray:
    """Transforms (36, C, K) of filters (K, C, 3, 3), float32."""
    transformed = np.einsum("ai,bj,kcij->abck", FILTER, FILTER, weight, dtype=np.float64)
    return np.ascontiguousarray(transformed.reshape(IN * IN, *weight.shape[1::-1]), np.float32)


@loop
def _transform(a, b, c, d, e, f, out):
    """out (6, N) <- the input transform of six rows of at least N values."""
    p, q, r, s, t, u = out[0], out[1], out[2], out[3], out[4], out[5]
    for k in range(p.size):
        even, odd = e[k] - FOUR * c[k], d[k] - FOUR * b[k]
        near, twice = e[k] - c[k], TWO * (d[k] - b[k])
        p[k], u[k] = FOUR * a[k] - FIVE * c[k] + e[k], FOUR * b[k] - FIVE * d[k] + f[k]
        q[k], r[k], s[k], t[k] = even + odd, even - odd, near + twice, near - twice


@loop
def _result(v, out):
    """out (4, N) <- the output transform of v (6, N)."""
    a, b, c, d, e, f = v[0], v[1], v[2], v[3], v[4], v[5]
    p, q, r, s = out[0], out[1], out[2], out[3]
    for k in range(p.size):
        sum_near, near, sum_far, far = b[k] + c[k], b[k] - c[k], d[k] + e[k], d[k] - e[k]
        p[k], q[k] = a[k] + sum_near + sum_far, near + TWO * far
        r[k], s[k] = sum_near + FOUR * sum_far, near + EIGHT * far + f[k]


@loop
def _fetch(line, left, apart):
    """apart[k % 4, k // 4] <- pixel (C,) at left + k of a line (W, C), 0 outside."""
    for k in range(OUT * apart.shape[1]):
        pixel = apart[k % OUT, k // OUT]
        if 0 <= left + k < len(line):
            given = line[left + k]
            for c in range(pixel.size):
                pixel[c] = given[c]
        else:
            pixel[:] = 0


@loop
def _put(apart, bias, slope, added, line):
    """line (W, K) <- activation(apart + bias) + added; columns of `apart` are grouped modulo 4, added may be empty."""
    for j in range(len(line)):
        given, pixel = apart[j % OUT, j // OUT], line[j]
        for k in range(pixel.size):
            value = given[k] + bias[k]
            pixel[k] = value if value > 0 else slope * value
        if len(added) > 0:
            more = added[j]
            for k in range(pixel.size):
                pixel[k] += more[k]


@kernel
def convolve(x, filters, bias, slope, added, out):
    """out (N, H, W, K) <- activation(convolution of x (N, H, W, C) + bias (K,)) + added, with zero padding.

    filters: :func:`spectra` of the filters; slope: negative slope of the leaky ReLU, 1 for none; added: of the shape of
    out, or (0, H, W, K) for none. All are float32; K is a multiple of 8 and at least 16.
    """
    count, height, width, depth = x.shape
    outputs = out.shape[3]
    tiles = min(TILES, (width + OUT * LINES - 1) // (OUT * LINES) * LINES)
    lines, parts = (height + OUT - 1) // OUT, (width + OUT * tiles - 1) // (OUT * tiles)
    flat_filters, rest = filters.reshape(-1), 24 if outputs % 16 > 0 else 0
    for job in numba.prange(count * lines * parts):
        n, top, left = job // (lines * parts), job // parts % lines * OUT, job % parts * OUT * tiles
        apart = np.empty((IN, OUT, tiles + 1, depth), x.dtype)
        for i in range(IN):
            if 0 <= top - 1 + i < height:
                _fetch(x[n, top - 1 + i], left - 1, apart[i])
            else:
                apart[i] = 0
        given, along = apart.reshape(IN, -1), np.empty((IN, OUT, (tiles + 1) * depth), x.dtype)
        _transform(given[0], given[1], given[2], given[3], given[4], given[5], along.reshape(IN, -1))
        v, products = np.empty((IN, IN, tiles * depth), x.dtype), np.empty((IN, IN, tiles * outputs), x.dtype)
        for i in range(IN):
            a = along[i]
            _transform(a[0], a[1], a[2], a[3], a[0, depth:], a[1, depth:], v[i])
        flat, flat_products = v.reshape(-1), products.reshape(-1)
        for p in range(IN * IN):
            for t in range(0, tiles, LINES):
                at, to, of = (p * tiles + t) * depth, (p * tiles + t) * outputs, p * depth * outputs
                for k in range(0, outputs - rest, 16):
                    multiply_16(flat, at, depth, flat_filters, of + k, outputs, flat_products, to + k)
                if rest > 0:
                    k = outputs - rest
                    multiply_24(flat, at, depth, flat_filters, of + k, outputs, flat_products, to + k)
        across, done = np.empty((IN, OUT, tiles * outputs), x.dtype), np.empty((OUT, OUT, tiles, outputs), x.dtype)
        for i in range(IN):
            _result(products[i], across[i])
        _result(across.reshape(IN, -1), done.reshape(OUT, -1))
        right = min(left + OUT * tiles, width)
        for i in range(min(OUT, height - top)):
            more = added[n, top + i, left:right] if len(added) > 0 else added.reshape(-1, outputs)
            _put(done[i], bias, slope, more, out[n, top + i, left:right])
