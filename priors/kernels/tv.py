"""Chambolle's dual projection for total variation over rows, columns and, with a weight per pixel, time.

The dual field p has one flat array per axis, for the forward differences along it. Its values are multiples of
1 / `one` in a short integer type, because memory bandwidth limits the speed. As p is 0 on the last row, column and
frame, the previous value in the flat array is right across all edges. Zeros precede the first value.

A step processes a band of rows of one view, frame by frame. It computes the primal variable of frame k + 1 from the old
p, then updates frame k of p; the last step then computes frame k of the result. So each value is read once.
The first row of each band is computed before the step, because the band above reads it. Its result is computed after
the step, because it reads the band above.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel, loop

BAND = 64  # rows that a job processes


@loop
def _add_of_frame(weight, left, right, above, below, u):
    """u <- u + weight * div p."""
    real = u.dtype.type
    for j in range(u.size):
        u[j] += weight * (real(right[j]) - real(left[j]) + real(below[j]) - real(above[j]))


@loop
def _add_of_video(weight, left, right, above, below, time, before, after, u):
    """u <- u + weight * div p for p with differences along time."""
    real = u.dtype.type
    for j in range(u.size):
        space = real(right[j]) - real(left[j]) + real(below[j]) - real(above[j])
        u[j] += weight * (space + time[j] * (real(after[j]) - real(before[j])))


@loop
def _dual_of_frame(u, below, across, step, one, isotropic, a, b):
    """(a, b) <- projection of (a, b) + step * gradient of u; `across` is step * the difference along columns."""
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
    """(a, b, c) <- projection of (a, b, c) + step * gradient of u, with differences along time in c."""
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
def _add_divergence(weight, time, p, frames, n, k, start, stop, u):
    """u <- u + weight * div p for rows start to stop - 1 of frame k, view n."""
    p_rows, p_columns, p_time = p
    _, rows, columns = time.shape
    plane = rows * columns
    at = (n * frames + k) * plane + start * columns
    end = at + u.size
    left, right = p_columns[at:end], p_columns[at + 1 : end + 1]
    above, below = p_rows[at:end], p_rows[at + columns : end + columns]
    if p_time.size > 0:
        t, before, after = time[n, start:stop].reshape(-1), p_time[at:end], p_time[at + plane : end + plane]
        _add_of_video(weight, left, right, above, below, t, before, after, u)
    else:
        _add_of_frame(weight, left, right, above, below, u)


@loop
def _dual(here, after, frames, step, one, isotropic, time, p, n, k, start, stop, across):
    """Update rows start to stop - 1 of p, frame k, view n, from the primal rows of this frame and the next one."""
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
def denoise(x, steps, weight, step, one, isotropic, time, p):
    """x <- x + weight * div p after `steps` dual steps that start from p, on x (V, B, H, W).

    p is a tuple of three flat arrays: differences along rows, columns and time. The last one is empty without
    differences along time, whose weights are time (V, H, W). The integer `one` represents 1 in p, and weight and step
    are in these units: a divergence of `one` changes x by ``one * weight``. Values that are not finite stay in p.
    """
    views, frames, rows, columns = x.shape
    bands = (rows + BAND - 1) // BAND
    first = np.empty((views, bands, frames, columns), x.dtype)
    for i in range(steps):
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top = band * BAND
            for k in range(frames):
                u = first[n, band, k]
                u[:] = x[n, k, top]
                _add_divergence(weight, time, p, frames, n, k, top, top + 1, u)
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top, bottom = band * BAND, min(band * BAND + BAND, rows)
            size = (bottom - top) * columns
            here, after = np.empty(size + columns, x.dtype), np.empty(size + columns, x.dtype)  # with one row below
            across = np.empty(size, x.dtype)
            for k in range(-1, frames):
                if k + 1 < frames:
                    after[:columns] = first[n, band, k + 1]
                    u = after[columns:size]
                    u[:] = x[n, k + 1, top + 1 : bottom].reshape(-1)
                    _add_divergence(weight, time, p, frames, n, k + 1, top + 1, bottom, u)
                    last = first[n, band + 1, k + 1] if bottom < rows else after[size - columns : size]
                    after[size:] = last
                if k >= 0:
                    _dual(here, after, frames, step, one, isotropic, time, p, n, k, top, bottom, across)
                    if i == steps - 1:
                        result = x[n, k, top + 1 : bottom].reshape(-1)
                        _add_divergence(weight, time, p, frames, n, k, top + 1, bottom, result)
                here, after = after, here
    for job in numba.prange(views * bands * frames):
        n, band, k = job // (bands * frames), job // frames % bands, job % frames
        top = band * BAND
        _add_divergence(weight, time, p, frames, n, k, top, top + 1, x[n, k, top])


@kernel
def activity(view, space, change):
    """space, change (H, W) += means over time of the gradient's norm and of the change of a view (B, H, W)."""
    frames, rows, columns = view.shape
    for i in numba.prange(rows):
        for k in range(frames):
            here, below, then = view[k, i], view[k, min(i + 1, rows - 1)], view[min(k + 1, frames - 1), i]
            for j in range(columns):
                right = here[min(j + 1, columns - 1)]
                space[i, j] += np.sqrt((below[j] - here[j]) ** 2 + (right - here[j]) ** 2) / frames
                change[i, j] += abs(then[j] - here[j]) / max(frames - 1, 1)
