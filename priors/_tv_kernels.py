"""Chambolle's dual projection for total variation over rows, columns and, with a weight per pixel, time.

The dual field p has one flat array per axis, for the forward differences along it, as whole multiples of 1 / `one` in a
short integer type: memory is what a step takes longest for. As p vanishes on the last row, column and frame, its value
one row, column or frame back in the flat array is right across all edges; zeros in front of it serve the first ones.

A step takes a band of rows of one view through the frames: the primal variable of frame k + 1 is made from the old p
just before frame k of p is renewed, so each value is read once. The first row of every band is made beforehand: the
band above needs it, and p may have changed by then.
"""

import numba
import numpy as np

from pnp_sci._jit import kernel, loop

BAND = 64  # rows; at 256 x 256 quickest of 8 ... 128, beyond that 32 and 64 are alike
CHUNK = 4  # rows of the result; 8 takes as long


@loop
def _primal_of_frame(v, weight, left, right, above, below, u):
    """u <- v + weight * div p."""
    real = v.dtype.type
    for j in range(v.size):
        u[j] = v[j] + weight * (real(right[j]) - real(left[j]) + real(below[j]) - real(above[j]))


@loop
def _primal_of_video(v, weight, left, right, above, below, time, before, after, u):
    """u <- v + weight * div p, p with differences along time."""
    real = v.dtype.type
    for j in range(v.size):
        space = real(right[j]) - real(left[j]) + real(below[j]) - real(above[j])
        u[j] = v[j] + weight * (space + time[j] * (real(after[j]) - real(before[j])))


@loop
def _dual_of_frame(u, below, across, step, one, isotropic, a, b):
    """(a, b) <- (a, b) + step * gradient of u, projected; `across` is that of the columns, times step."""
    real = u.dtype.type
    for j in range(u.size):
        p = real(a[j]) + step * (below[j] - u[j])
        q = real(b[j]) + across[j]
        if isotropic:
            scale = one / np.sqrt(max(one * one, p * p + q * q))
            a[j] = np.rint(p * scale)
            b[j] = np.rint(q * scale)
        else:
            a[j] = np.rint(max(-one, min(one, p)))
            b[j] = np.rint(max(-one, min(one, q)))


@loop
def _dual_of_video(u, below, across, then, time, step, one, isotropic, a, b, c):
    """The same with differences along time."""
    real = u.dtype.type
    for j in range(u.size):
        p = real(a[j]) + step * (below[j] - u[j])
        q = real(b[j]) + across[j]
        r = real(c[j]) + step * time[j] * (then[j] - u[j])
        if isotropic:
            scale = one / np.sqrt(max(one * one, p * p + q * q + r * r))
            a[j] = np.rint(p * scale)
            b[j] = np.rint(q * scale)
            c[j] = np.rint(r * scale)
        else:
            a[j] = np.rint(max(-one, min(one, p)))
            b[j] = np.rint(max(-one, min(one, q)))
            c[j] = np.rint(max(-one, min(one, r)))


@loop
def _along_columns(u, step, across):
    """across <- step * (next pixel - pixel)."""
    for j in range(across.size):
        across[j] = step * (u[j + 1] - u[j])


@loop
def _primal(v, weight, time, p, n, k, start, stop, u):
    """u <- rows start ... stop - 1 of frame k, view n of v + weight * div p."""
    p_rows, p_columns, p_time = p
    _, frames, rows, columns = v.shape
    plane = rows * columns
    at = (n * frames + k) * plane + start * columns
    end = at + (stop - start) * columns
    frame = v.reshape(-1)[at:end]
    left, right = p_columns[at:end], p_columns[at + 1 : end + 1]
    above, below = p_rows[at:end], p_rows[at + columns : end + columns]
    if p_time.size > 0:
        t, before, after = time[n, start:stop].reshape(-1), p_time[at:end], p_time[at + plane : end + plane]
        _primal_of_video(frame, weight, left, right, above, below, t, before, after, u)
    else:
        _primal_of_frame(frame, weight, left, right, above, below, u)


@loop
def _dual(here, after, frames, step, one, isotropic, time, p, n, k, start, stop, across):
    """Renew rows start ... stop - 1 of p, frame k, view n, from the primal rows of this frame and the one after it."""
    p_rows, p_columns, p_time = p
    _, rows, columns = time.shape
    plane, size = rows * columns, (stop - start) * columns
    at = (n * frames + k) * plane + start * columns
    u, below = here[:size], here[columns : columns + size]
    _along_columns(here, step, across[:size])
    across[columns - 1 : size : columns] = 0
    a, b = p_rows[columns + at : columns + at + size], p_columns[1 + at : 1 + at + size]
    if p_time.size > 0 and k < frames - 1:
        t, c = time[n, start:stop].reshape(-1), p_time[plane + at : plane + at + size]
        _dual_of_video(u, below, across, after, t, step, one, isotropic, a, b, c)
    else:
        _dual_of_frame(u, below, across, step, one, isotropic, a, b)


@kernel
def denoise(v, steps, weight, step, one, isotropic, time, p, out):
    """`steps` dual steps from the given p on v (V, B, H, W), then out <- v + weight * div p.

    p holds the differences along rows, columns and time, the last empty where there are none; time (V, H, W) weighs
    them. `one` is what stands for 1 in p, and weight and step are in its units: a divergence of `one` changes v by
    ``one * weight``. out may be v. Values that are not finite stay in p.
    """
    views, frames, rows, columns = v.shape
    bands = (rows + BAND - 1) // BAND
    first = np.empty((views, bands, frames, columns), v.dtype)
    result = out.reshape(-1)
    for _ in range(steps):
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top = band * BAND
            for k in range(frames):
                _primal(v, weight, time, p, n, k, top, top + 1, first[n, band, k])
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top, bottom = band * BAND, min(band * BAND + BAND, rows)
            size = (bottom - top) * columns
            here, after = np.empty(size + columns, v.dtype), np.empty(size + columns, v.dtype)  # and one row below
            across = np.empty(size, v.dtype)
            for k in range(-1, frames):
                if k + 1 < frames:
                    after[:columns] = first[n, band, k + 1]
                    _primal(v, weight, time, p, n, k + 1, top + 1, bottom, after[columns:])
                    last = first[n, band + 1, k + 1] if bottom < rows else after[size - columns : size]
                    after[size:] = last
                if k >= 0:
                    _dual(here, after, frames, step, one, isotropic, time, p, n, k, top, bottom, across)
                here, after = after, here
    for job in numba.prange(views * frames):
        n, k = job // frames, job % frames
        u = np.empty(CHUNK * columns, v.dtype)  # out may be v itself, which would keep the loop from being vectorised
        for top in range(0, rows, CHUNK):
            bottom = min(top + CHUNK, rows)
            at, size = (job * rows + top) * columns, (bottom - top) * columns
            _primal(v, weight, time, p, n, k, top, bottom, u)
            result[at : at + size] = u[:size]


@kernel
def activity(view, space, change):
    """Mean length of the gradient (H, W) of a view (B, H, W), and mean change from frame to frame, over time."""
    frames, rows, columns = view.shape
    for i in numba.prange(rows):
        for k in range(frames):
            here, below, then = view[k, i], view[k, min(i + 1, rows - 1)], view[min(k + 1, frames - 1), i]
            for j in range(columns):
                right = here[min(j + 1, columns - 1)]
                space[i, j] += np.sqrt((below[j] - here[j]) ** 2 + (right - here[j]) ** 2) / frames
                change[i, j] += abs(then[j] - here[j]) / max(frames - 1, 1)
