"""Fused passes of the sensing operator over blocks of pixels.

Arrays are flat in the pixels: masks and x are (K, P) with K = V * B planes and P = H * W pixels, y and weight are (P,).
A block of all K planes stays in the cache between the sum over planes and the update, so x passes through memory once.
"""

import numba
import numpy as np

from ._jit import kernel

BLOCK = 1024  # pixels; measured best of 256 ... 4096 against an in-place pass over x, at 20 planes


@kernel
def forward(masks, x, y):
    """y <- sum over planes of masks * x."""
    planes, pixels = x.shape
    real = x.dtype.type
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        total = np.zeros(here.stop - here.start, x.dtype)
        for k in range(planes):
            m, v = masks[k, here], x[k, here]
            for p in range(total.size):
                total[p] += real(m[p]) * v[p]
        y[here] = total


@kernel
def adjoint(masks, y, x):
    """x <- masks * y, plane by plane."""
    planes, pixels = x.shape
    real = x.dtype.type
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        r = y[here]
        for k in range(planes):
            m, v = masks[k, here], x[k, here]
            for p in range(v.size):
                v[p] = real(m[p]) * r[p]


@kernel
def gram(masks, total):
    """total <- sum over planes of masks**2."""
    planes, pixels = masks.shape
    real = total.dtype.type
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        square = np.zeros(here.stop - here.start, total.dtype)
        for k in range(planes):
            m = masks[k, here]
            for p in range(square.size):
                square[p] += real(m[p]) * real(m[p])
        total[here] = square


@kernel
def project(masks, x, y, weight, out, in_place):
    """out <- x + masks * weight * (y - sum(masks * x)); `in_place` says that out is x."""
    planes, pixels = x.shape
    real = x.dtype.type
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        r = y[here].copy()
        for k in range(planes):
            m, v, w = masks[k, here], x[k, here], out[k, here]
            for p in range(r.size):
                r[p] -= real(m[p]) * v[p]
            if not in_place:
                w[:] = v
        r *= weight[here]
        for k in range(planes):
            m, w = masks[k, here], out[k, here]
            for p in range(r.size):
                w[p] += real(m[p]) * r[p]
