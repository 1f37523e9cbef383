"""Small matrices, one at a time within a kernel: products, Cholesky's inverse, eigenvectors."""

import numpy as np

from pnp_sci.accel.jit import loop, summing
from pnp_sci.accel.simd8 import multiply_16

SMALL = 1e-6  # least ridge in units of the sum of the eigenvalues: float32 cannot factorise less
SWEEPS = 30  # most sweeps of Jacobi's rotations; they converge quadratically, in some ten


@summing
def dot(a, b):
    """Inner product."""
    total = a.dtype.type(0)
    for x in range(a.size):
        total += a[x] * b[x]
    return total


@loop
def add_times(factor, v, out):
    """out += factor * v."""
    for x in range(out.size):
        out[x] += factor * v[x]


@loop
def gram_of(rows, gram):
    """gram <- rows @ rows.T."""
    for k in range(len(rows)):
        for m in range(k + 1):
            gram[k, m] = gram[m, k] = dot(rows[k], rows[m])


@loop
def times(factors, rows, out):
    """out <- factors @ rows."""
    count, width = rows.shape
    if count % 4 == 0 and width % 16 == 0:
        f, v, o = factors.reshape(-1), rows.reshape(-1), out.reshape(-1)
        for k in range(0, count, 4):
            for x in range(0, width, 16):
                multiply_16(f, k * count, count, v, x, width, o, k * width + x)
    else:
        out[:] = 0
        for k in range(count):
            for m in range(count):
                add_times(factors[k, m], rows[m], out[k])


@loop
def factorise(a):
    """Lower part of a <- that of its Cholesky factor, with the reciprocals of the diagonal."""
    for k in range(len(a)):
        for m in range(k):
            a[k, m] = (a[k, m] - dot(a[k, :m], a[m, :m])) * a[m, m]
        a[k, k] = 1 / np.sqrt(max(a[k, k] - dot(a[k, :k], a[k, :k]), a.dtype.type(SMALL)))


@loop
def inverse(a, half, out):
    """out <- the inverse of a, which is overwritten; half <- the inverse of its Cholesky factor, transposed."""
    count = len(a)
    factorise(a)
    for m in range(count):
        half[m, m] = a[m, m]
        for k in range(m + 1, count):
            half[m, k] = -dot(a[k, m:k], half[m, m:k]) * a[k, k]
    for k in range(count):
        for m in range(k + 1):
            out[k, m] = out[m, k] = dot(half[k, k:], half[m, k:])


@loop
def eigen(a, vectors):
    """Jacobi's rotations: the diagonal of a <- its eigenvalues, vectors <- eigenvectors, one a row."""
    count, one = len(a), a.dtype.type(1)
    least = a.dtype.type(1e-7) * np.trace(a) / count  # what is nothing beside the mean eigenvalue
    vectors[:] = 0
    for k in range(count):
        vectors[k, k] = 1
    for _ in range(SWEEPS):
        turned = False
        for p in range(count - 1):
            for q in range(p + 1, count):
                if abs(a[p, q]) <= least:
                    continue
                turned = True
                slope = (a[q, q] - a[p, p]) / (2 * a[p, q])
                t = one / (abs(slope) + np.sqrt(slope * slope + one)) * np.sign(slope) if slope != 0 else one
                c = one / np.sqrt(t * t + one)
                s = t * c
                for k in range(count):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for m in (a, vectors):
                    for k in range(count):
                        x, y = m[p, k], m[q, k]
                        m[p, k], m[q, k] = c * x - s * y, s * x + c * y
        if not turned:
            break
