"""Chambolle's dual projection for total variation over rows, columns and, with a weight per pixel, time.

The dual field p holds one video of forward differences per axis; it vanishes on the last row, column and frame, so that
its divergence needs no special case there. A step takes a band of rows of one view through the frames: the primal
variable of frame k + 1 is made from the old p just before frame k of p is renewed, so each value is read once. The
first row of every band is made beforehand: the band above needs it, and p may have changed by then.
"""

import numba
import numpy as np

from pnp_sci._jit import device_function, kernel

BAND = 32  # rows


@device_function
def _primal(v, weight, time, p_rows, p_columns, p_time, n, k, start, stop, u):
    """u <- rows start ... stop - 1 of frame k, view n of v + weight * div p."""
    columns = v.shape[3]
    for i in range(start, stop):
        o = u[i - start]
        o[0] = v[n, k, i, 0] + weight * (p_columns[n, k, i, 0] + p_rows[n, k, i, 0])
        for j in range(1, columns):
            o[j] = v[n, k, i, j] + weight * (p_columns[n, k, i, j] - p_columns[n, k, i, j - 1] + p_rows[n, k, i, j])
        if i > 0:
            for j in range(columns):
                o[j] -= weight * p_rows[n, k, i - 1, j]
        if p_time.size > 0:
            if k > 0:
                for j in range(columns):
                    o[j] += weight * time[n, i, j] * (p_time[n, k, i, j] - p_time[n, k - 1, i, j])
            else:
                for j in range(columns):
                    o[j] += weight * time[n, i, j] * p_time[n, k, i, j]


@device_function
def _dual(here, after, step, time, isotropic, p_rows, p_columns, p_time, n, k, start, stop):
    """Renew rows start ... stop - 1 of p, frame k, from the primal rows of this frame and the one after it."""
    frames, rows, columns = p_rows.shape[1:]
    one = here.dtype.type(1)
    for i in range(start, stop):
        u = here[i - start]
        a, b = p_rows[n, k, i], p_columns[n, k, i]
        if i < rows - 1:
            below = here[i - start + 1]
            for j in range(columns):
                a[j] += step * (below[j] - u[j])
        for j in range(columns - 1):
            b[j] += step * (u[j + 1] - u[j])
        if p_time.size > 0:
            c = p_time[n, k, i]
            if k < frames - 1:
                then = after[i - start]
                for j in range(columns):
                    c[j] += step * time[n, i, j] * (then[j] - u[j])
            if isotropic:
                for j in range(columns):
                    scale = one / np.sqrt(max(one, a[j] * a[j] + b[j] * b[j] + c[j] * c[j]))
                    a[j] *= scale
                    b[j] *= scale
                    c[j] *= scale
            else:
                for j in range(columns):
                    c[j] = min(one, max(-one, c[j]))
        elif isotropic:
            for j in range(columns):
                scale = one / np.sqrt(max(one, a[j] * a[j] + b[j] * b[j]))
                a[j] *= scale
                b[j] *= scale
        if not isotropic:
            for j in range(columns):
                a[j] = min(one, max(-one, a[j]))
                b[j] = min(one, max(-one, b[j]))


@kernel
def denoise(v, weight, steps, step, isotropic, time, p_rows, p_columns, p_time, out):
    """`steps` dual steps from the given p on v (V, B, H, W), then out <- v + weight * div p.

    time (V, H, W) weighs the differences along time; p_time may be empty, then there are none. out may be v.
    """
    views, frames, rows, columns = v.shape
    bands = (rows + BAND - 1) // BAND
    first = np.empty((views, bands, frames, 1, columns), v.dtype)
    for _ in range(steps):
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top = band * BAND
            for k in range(frames):
                _primal(v, weight, time, p_rows, p_columns, p_time, n, k, top, top + 1, first[n, band, k])
        for job in numba.prange(views * bands):
            n, band = job // bands, job % bands
            top = band * BAND
            bottom = min(top + BAND, rows)
            here = np.empty((BAND + 1, columns), v.dtype)
            after = np.empty((BAND + 1, columns), v.dtype)
            for k in range(-1, frames):
                if k + 1 < frames:
                    after[0] = first[n, band, k + 1, 0]
                    _primal(v, weight, time, p_rows, p_columns, p_time, n, k + 1, top + 1, bottom, after[1:])
                    if bottom < rows:
                        after[bottom - top] = first[n, band + 1, k + 1, 0]
                if k >= 0:
                    _dual(here, after, step, time, isotropic, p_rows, p_columns, p_time, n, k, top, bottom)
                here, after = after, here
    for job in numba.prange(views * frames):
        n, k = job // frames, job % frames
        row = np.empty((1, columns), v.dtype)  # out may be v itself, which would keep the loops from being vectorised
        for i in range(rows):
            _primal(v, weight, time, p_rows, p_columns, p_time, n, k, i, i + 1, row)
            out[n, k, i] = row[0]
