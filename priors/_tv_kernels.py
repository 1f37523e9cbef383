"""Chambolle's dual projection for total variation over rows, columns and, with a weight per pixel, time.

The dual field p holds one flat array of forward differences per axis, as whole multiples of 1 / `one` in a short integer
type: it is what passes through memory most. As p vanishes on the last row, column and frame, the difference that leads
to a pixel is always the one a row, column or frame before it in the flat array, across the edges too; zeros of one row,
column or frame in front serve the very first pixels.

A step takes a band of rows of one view through the frames: the primal variable of frame k + 1 is made from the old p
just before frame k of p is renewed, so each value is read once. The first row of every band is made beforehand: the
band above needs it, and p may have changed by then.
"""

import numba
import numpy as np

from pnp_sci._jit import kernel, loop

BAND = 32  # rows
CHUNK = 4  # rows that stay in the nearest cache between two loops


@loop
def _primal_in_space(v, weight, left, right, above, below, u):
    """u <- v + weight * div p, from the differences that lead to and away from each pixel."""
    real = v.dtype.type
    for j in range(v.size):
        u[j] = v[j] + weight * (real(right[j]) - real(left[j]) + real(below[j]) - real(above[j]))


@loop
def _primal(v, weight, left, right, above, below, time, before, after, u):
    """The same with differences along time, weighted."""
    real = v.dtype.type
    for j in range(v.size):
        space = real(right[j]) - real(left[j]) + real(below[j]) - real(above[j])
        u[j] = v[j] + weight * (space + time[j] * (real(after[j]) - real(before[j])))


@loop
def _dual_in_space(u, below, across, step, one, isotropic, a, b):
    """(a, b) <- projection of (a, b) + gradient of u; across is the part of the gradient along columns."""
    real = u.dtype.type
    for j in range(u.size):
        p = real(a[j]) + step * (below[j] - u[j])
        q = real(b[j]) + across[j]
        if isotropic:
            scale = one / np.sqrt(max(one * one, p * p + q * q))
            a[j], b[j] = np.rint(p * scale), np.rint(q * scale)
        else:
            a[j], b[j] = np.rint(max(-one, min(one, p))), np.rint(max(-one, min(one, q)))


@loop
def _dual(u, below, across, time, then, step, one, isotropic, a, b, c):
    """The same with differences c along time, weighted."""
    real = u.dtype.type
    for j in range(u.size):
        p = real(a[j]) + step * (below[j] - u[j])
        q = real(b[j]) + across[j]
        r = real(c[j]) + step * time[j] * (then[j] - u[j])
        if isotropic:
            scale = one / np.sqrt(max(one * one, p * p + q * q + r * r))
            a[j], b[j], c[j] = np.rint(p * scale), np.rint(q * scale), np.rint(r * scale)
        else:
            a[j], b[j] = np.rint(max(-one, min(one, p))), np.rint(max(-one, min(one, q)))
            c[j] = np.rint(max(-one, min(one, r)))


@loop
def _primal_rows(v, weight, time, p_rows, p_columns, p_time, k, start, stop, u):
    """u <- rows start ... stop - 1 of v + weight * div p, in frame k of all views' frames."""
    views, rows, columns = time.shape
    frames = v.size // time.size
    plane = rows * columns
    begin, end = k * plane + start * columns, k * plane + stop * columns
    left, right = p_columns[begin:end], p_columns[begin + 1 : end + 1]
    above, below = p_rows[begin:end], p_rows[begin + columns : end + columns]
    if p_time.size > 0:
        before, after = p_time[begin:end], p_time[begin + plane : end + plane]
        t = time[k // frames, start:stop].reshape(-1)
        _primal(v[begin:end], weight, left, right, above, below, t, before, after, u)
    else:
        _primal_in_space(v[begin:end], weight, left, right, above, below, u)


@kernel
def denoise(v, weight, steps, step, one, isotropic, time, p_rows, p_columns, p_time, out):
    pass
