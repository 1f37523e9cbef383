"""Fused kernels of the sensing operator and of the GAP multiplier.

Pixels are flattened: masks and x are (K, P) with K = V * B planes and P = H * W pixels; y and weight are (P,). The
kernels process blocks of pixels. All K planes of a block stay in the cache between the sum over planes and the update,
so x passes through memory once.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import device_function, kernel

BLOCK = 2048  # pixels of a block


@device_function
def _measured(masks, x, here):
    """Sum over planes of masks * x for the pixels `here`; two planes at a time halve the traffic of the sum."""
    planes = len(x)
    real = x.dtype.type
    total = np.zeros(here.stop - here.start, x.dtype)
    for k in range(0, planes - 1, 2):
        m, v, m_next, v_next = masks[k, here], x[k, here], masks[k + 1, here], x[k + 1, here]
        for p in range(total.size):
            total[p] += real(m[p]) * v[p] + real(m_next[p]) * v_next[p]
    if planes % 2:
        m, v = masks[planes - 1, here], x[planes - 1, here]
        for p in range(total.size):
            total[p] += real(m[p]) * v[p]
    return total


@kernel
def forward(masks, x, y):
    """y <- sum over planes of masks * x."""
    pixels = x.shape[1]
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        y[here] = _measured(masks, x, here)


@kernel
def adjoint(masks, y, x):
    """x <- masks * y for each plane."""
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
    """out <- x + masks * weight * (y - sum over planes of masks * x); `in_place` is whether out is x."""
    planes, pixels = x.shape
    real = x.dtype.type
    for block in numba.prange((pixels + BLOCK - 1) // BLOCK):
        here = slice(block * BLOCK, min((block + 1) * BLOCK, pixels))
        r = (y[here] - _measured(masks, x, here)) * weight[here]
        for k in range(planes - 1, -1, -1):  # backwards, as the last planes are in the cache
            m, v, w = masks[k, here], x[k, here], out[k, here]
            if in_place:  # one array fewer, which speeds up the loop
                for p in range(r.size):
                    w[p] += real(m[p]) * r[p]
            else:
                for p in range(r.size):
                    w[p] = v[p] + real(m[p]) * r[p]


@kernel
def multiplier(dual, residual, gram, pace, rho, saturated, after, move):
    """after <- (dual + pace residual) gram / (gram + pace rho);  move <- (after - dual) / pace.

    Arrays are flat, (P,). `after` is 0 where gram is 0 or denormal, and >= 0 where `saturated` is true. `saturated` may
    be empty for no pixel. rho has one value for all pixels or one for each.
    """
    tiny, zero = np.finfo(gram.dtype).tiny, gram.dtype.type(0)
    for p in numba.prange(gram.size):
        leak = pace * (rho[p] if rho.size > 1 else rho[0])
        new = (dual[p] + pace * residual[p]) * (gram[p] / (gram[p] + leak)) if gram[p] >= tiny else zero
        if saturated.size > 0 and saturated[p]:
            new = max(new, zero)
        after[p], move[p] = new, (new - dual[p]) / pace
