"""The kernel that adds up small windows along the tracks of possible movers."""

import numba
import numpy as np

from pnp_sci.accel.jit import device_function, kernel

LEAST = 16.0  # squared score: smaller ones are chance in any picture
NEARLY = 0.7  # of the best square so far: less, by the fast estimate, is not worked out exactly
SOME = 8  # one row of so many counts in the mean of all scores
TINY = 1e-12  # smallest divisor
MOST = 9.0  # squared score above which it counts no more in the mean: movers are few


@device_function
def _reach(steps):
    """Smallest and largest row and column of steps (L, 2)."""
    low, high = np.empty(2, np.int64), np.empty(2, np.int64)
    for axis in range(2):
        low[axis] = high[axis] = steps[0, axis]
        for k in range(len(steps)):
            low[axis], high[axis] = min(low[axis], steps[k, axis]), max(high[axis], steps[k, axis])
    return low, high


@device_function
def track_variance(rooted, top, left, steps, first, frames, side, share, shift, shifting):
    """Variance of a track's sum.

    rooted (H, W): standard deviation of residual times mask; steps (L, 2): windows of `side` beside (top, left), from
    frame `first`. All frames lose `share` of what each frame adds, as their masks are freed of their mean. If the masks
    are one pattern that is shifted from frame to frame, places that see the same part of it add up.
    """
    low, high = _reach(steps)
    times = np.zeros((high[0] - low[0] + side, high[1] - low[1] + side), np.int64)
    for k in range(len(steps)):
        for i in range(side):
            for j in range(side):
                times[steps[k, 0] - low[0] + i, steps[k, 1] - low[1] + j] += 1
    far = (frames - 1) * np.abs(shift) * shifting
    parts = np.zeros((times.shape[0] + far[0], times.shape[1] + far[1]))
    total = 0.0
    for i in range(times.shape[0]):
        for j in range(times.shape[1]):
            if times[i, j] == 0:
                continue
            value = rooted[top + low[0] + i, left + low[1] + j]
            for b in range(frames):
                weight = -share * times[i, j]
                if first <= b < first + len(steps):
                    y, x = i + low[0] - steps[b - first, 0], j + low[1] - steps[b - first, 1]
                    weight += 0 <= y < side and 0 <= x < side
                if shifting:
                    y = i - b * shift[0] + (far[0] if shift[0] > 0 else 0)
                    x = j - b * shift[1] + (far[1] if shift[1] > 0 else 0)
                    parts[y, x] += value * weight
                else:
                    total += (value * weight) ** 2
    for i in range(parts.shape[0]):
        for j in range(parts.shape[1]):
            total += parts[i, j] ** 2
    return total


@kernel
def follow(totals, scores, rooted, speed, first, length, side, zoom, scale, share, shift, shifting, best, energy):
    """best, energy (N,) <- the largest squared score of each of N tracks over all positions, and the mean one.

    totals, scores (B, h, w): sums over windows of `side`, and the same in standard deviations, in a picture reduced by
    `zoom`; rooted (H, W) as for the variance, not reduced. speed (N, 2): rows and columns of a window from frame to
    frame, for `length` frames from `first`. `scale` (N,) makes of the squared sum of scores a square of variance 1 on
    even ground: a fast estimate, which tells where the exact one is worth its time.
    """
    frames, rows, columns = scores.shape
    for n in numba.prange(len(speed)):
        steps = np.empty((length[n], 2), np.int64)
        for k in range(length[n]):
            steps[k] = k * speed[n]
        low, high = _reach(steps)
        sums = np.empty(max(columns - high[1] + low[1], 0), np.float32)
        top, total, count = 0.0, 0.0, 0
        for i in range(-low[0], rows - high[0]):
            sums[:] = 0
            for k in range(len(steps)):
                start = steps[k, 1] - low[1]
                row = scores[first[n] + k, i + steps[k, 0], start : start + len(sums)]
                for j in range(len(sums)):
                    sums[j] += row[j]
            if i % SOME == 0:
                count += len(sums)
                for j in range(len(sums)):
                    total += min(sums[j] ** 2 * scale[n], MOST)
            much = np.float32(np.sqrt(max(NEARLY * top, LEAST) / max(scale[n], TINY)))
            for j in range(len(sums)):
                if sums[j] > much or sums[j] < -much:
                    whole = 0.0
                    for k in range(len(steps)):
                        whole += totals[first[n] + k, i + steps[k, 0], j + steps[k, 1] - low[1]]
                    at = zoom * i, zoom * (j - low[1])
                    variance = track_variance(
                        rooted, at[0], at[1], zoom * steps, first[n], frames, zoom * side, share, shift, shifting
                    )
                    if variance > 0:
                        top = max(top, whole * whole / variance)
        best[n] = top
        energy[n] = total / max(count, 1)
