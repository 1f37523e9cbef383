"""The kernel that adds up small windows along the tracks of possible movers."""

import numba
import numpy as np

from pnp_sci.accel.jit import device_function, kernel

SIDE = 8  # pixels a side of the smallest windows
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
def track_variance(rooted, corners, first, frames, side, share, shift):
    """Variance of a track's sum.

    rooted (H, W): standard deviation of residual times mask; corners (L, 2): first row and column of a window of `side`
    in each frame from `first`. All frames lose `share` of what each frame adds, as their masks are freed of their mean.
    If the masks are one pattern that moves by `shift` from frame to frame, places that see the same part of it add up.
    """
    low, high = _reach(corners)
    times = np.zeros((high[0] - low[0] + side, high[1] - low[1] + side), np.int64)
    for k in range(len(corners)):
        for i in range(side):
            for j in range(side):
                times[corners[k, 0] - low[0] + i, corners[k, 1] - low[1] + j] += 1
    one_pattern = shift[0] != 0 or shift[1] != 0
    far = (frames - 1) * np.abs(shift)
    parts = np.zeros((times.shape[0] + far[0], times.shape[1] + far[1]))
    total = 0.0
    for i in range(times.shape[0]):
        for j in range(times.shape[1]):
            if times[i, j] == 0:
                continue
            value = rooted[low[0] + i, low[1] + j]
            for b in range(frames):
                weight = -share * times[i, j]
                if first <= b < first + len(corners):
                    y, x = i + low[0] - corners[b - first, 0], j + low[1] - corners[b - first, 1]
                    weight += 0 <= y < side and 0 <= x < side
                if one_pattern:
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
def follow(totals, normal, rooted, tracks, scale, share, shift, zoom):
    """The largest score of each of N tracks over all positions, in units of their root mean square if that exceeds 1.

    totals, normal (B, h, w): sums over windows of SIDE pixels a side, and the same in standard deviations, in a picture
    reduced by `zoom`; rooted (H, W), share and shift as for the variance, not reduced. tracks: speed (N, 2), first and
    length (N,), see :class:`pnp_sci.scene.movers.Tracks`. `scale` (N,) makes of the squared sum of scores a square of
    variance 1 on even ground: a fast estimate, which tells where the exact one is worth its time.
    """
    speed, first, length = tracks
    frames, rows, columns = normal.shape
    scores = np.zeros(len(speed))
    for n in numba.prange(len(speed)):
        steps = np.empty((length[n], 2), np.int64)
        for k in range(length[n]):
            steps[k] = k * speed[n]
        low, high = _reach(steps)
        sums = np.empty(max(columns - high[1] + low[1], 0), np.float32)
        corners = np.empty_like(steps)
        top, total, count = 0.0, 0.0, 0
        for i in range(-low[0], rows - high[0]):
            sums[:] = 0
            for k in range(len(steps)):
                start = steps[k, 1] - low[1]
                row = normal[first[n] + k, i + steps[k, 0], start : start + len(sums)]
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
                        y, x = i + steps[k, 0], j + steps[k, 1] - low[1]
                        whole += totals[first[n] + k, y, x]
                        corners[k, 0], corners[k, 1] = zoom * y, zoom * x
                    variance = track_variance(rooted, corners, first[n], frames, zoom * SIDE, share, shift)
                    if variance > 0:
                        top = max(top, whole * whole / variance)
        scores[n] = np.sqrt(top / max(total / max(count, 1), 1.0))
    return scores
