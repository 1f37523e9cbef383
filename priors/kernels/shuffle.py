"""Frames into what a network sees, and its noise back into frames: blocks of 2 x 2 pixels are channels."""

from __future__ import annotations

import numba

from pnp_sci.accel.jit import kernel


@kernel
def unshuffle(frames, level, rows, columns, out):
    """out (N, h, w, 5) <- the blocks of 2 x 2 pixels of frames (N, H, W), and the mean level (N, H, W) of each.

    rows (2 h,) and columns (2 w,) are the indices of the pixels, which continue the frames beyond their borders.
    """
    count, height, width = out.shape[:3]
    for k in numba.prange(count * height):
        n, i = k // height, k % height
        up, down = rows[2 * i], rows[2 * i + 1]
        for j in range(width):
            left, right = columns[2 * j], columns[2 * j + 1]
            out[n, i, j, 0], out[n, i, j, 1] = frames[n, up, left], frames[n, up, right]
            out[n, i, j, 2], out[n, i, j, 3] = frames[n, down, left], frames[n, down, right]
            total = level[n, up, left] + level[n, up, right] + level[n, down, left] + level[n, down, right]
            out[n, i, j, 4] = total / 4


@kernel
def shuffle(noise, level, limit, out):
    """out (N, H, W) <- noise (N, h, w, 4) of blocks of 2 x 2 pixels, clipped to `limit` times the level (N, H, W)."""
    count, height, width = out.shape
    for k in numba.prange(count * height):
        n, i = k // height, k % height
        for j in range(width):
            most = limit * level[n, i, j]
            out[n, i, j] = min(max(noise[n, i // 2, j // 2, 2 * (i % 2) + j % 2], -most), most)
