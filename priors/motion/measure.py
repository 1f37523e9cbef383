"""Where each pixel of a view goes from frame to frame, and how far to believe it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np

from pnp_sci.accel.threads import Pool
from priors.kernels import average as averages
from priors.kernels import match as matches
from priors.kernels.still import mean_and_variance, sureness, tie

SMALLEST = 32  # pixels a side that optical flow needs
BLUR = 0.7  # pixels: of the pictures that flow is estimated from
# Steps of gradient descent for each patch, then smoothings of the whole flow. On validation clips 3 smoothings are
# slower and no better for `video`, 0.1 dB worse for `flow`.
STEPS, SMOOTHINGS = 8, 1
STRIDE = 4  # pixels from patch to patch: a third quicker than 3, and as accurate here; 5 loses 0.05 dB with `flow`
# Part of a difference that is left when frames are halved. Of 0.6 to 1 best for `flow` on validation clips; `video` is
# as good with 0.8 to 0.9 of 0.75, the TOLERANCE it had, as with 0.7 of 0.85.
HALVED = 0.7
# Squared difference along the flow of a pixel's surroundings, in units of that along its own, up to which that replaces
# it: what matches best in a solver's estimate has followed the estimate's errors. On validation clips `video` gains 0.1
# dB (two views of 10 frames) and 0.25 (one of 8) over 1, most where scenes are simple, and with noise of 0.05 of max(y)
# nothing; 1.2 and 1.5 gain less. For a steady motion 1.3 in the place of 1 loses 0.1 dB.
SMOOTH = 1.3
# Difference, in units of the solver's sigma, at which neighbours count 1/e for a frame of a last estimate, which shows
# finer ones than what comes from a measurement. Six cases of validation clips gain with `video` 0.08 dB (two views of
# 10 frames), 0.15 (one of 8), 0.04 (noise of 0.03 of max(y)); with half of it less; with 0.75 cases lose up to 0.16.
CERTAIN = 0.3
# What a slow motion explains of the differences between frames speaks so many times more than a spread along time
# against standing still. Chosen together with REST of the priors on 18 videos of 192 x 192 pixels, 11 of the validation
# and 7 of the training, of cameras that stand still and that move. `flow` gains 0.2 dB in the mean, `video` 0.08; up to
# 1.5 and 0.9 where most stands still, 2.7 with one view of 8 frames; none lost more than 0.02, and with SMOOTH one
# 0.1 (before dark pixels had lower limits). 4 and 25 are nearly as good.
MOVES = 9


@dataclass(frozen=True, eq=False)
class Motion:
    """The flow between near frames of one view and the weights for averaging along it.

    Attributes
    ----------
    pairs : ndarray of int, (P, 2)
        Frames (b, n): n helps b. Sorted; those of frame b are ``pairs[first[b]:first[b + 1]]``.
    first : ndarray of int, (B + 1,)
    flow : ndarray of int16, (P, ceil(H / 2), ceil(W / 2), 2)
        Columns and rows from a pixel of frame b to its place in frame n, in 64ths of a pixel, for each 2 x 2 of them.
        (It is that of pictures half as large, whose pixels lie up to one apart from these where H or W is odd.)
    weights : ndarray of uint8, (P, H, W)
        What n counts for b, 255 being as much as b itself.
    still : ndarray of float32, (H, W)
        How surely a pixel shows the same in all frames, 0 to 1.
    """

    pairs: np.ndarray
    first: np.ndarray
    flow: np.ndarray
    weights: np.ndarray
    still: np.ndarray

    def average(self, view: np.ndarray, out: np.ndarray) -> None:
        """out (B, H, W) <- each frame of view (B, H, W), C-ordered, averaged with its neighbours along their motion.

        Pixels that stand still become, by as much as they surely do, the mean of all frames.
        """
        averages.average(view, self.flow, self.weights, self.pairs, self.first, out)
        tie(view, self.still, out)

    @cached_property
    def remaining(self) -> np.ndarray:
        """What averaging along motion leaves of the standard deviation of white noise, float32 (B, H, W).

        It is 1 where nothing helped. That pixels stand still does not count: on still clips that would be as good, but
        the frames of a view that is modelled by one are the same, and their noise is the same too.
        """
        left = np.empty((len(self.first) - 1, *self.weights.shape[1:]), np.float32)
        averages.remaining(self.weights, self.first, left)
        return left

    @property
    def at_rest(self) -> float:
        """The part of the picture that stands still."""
        return float(self.still.mean())


def may_show_motion(shape: tuple[int, ...]) -> bool:
    """Whether a video (V, B, H, W) of this shape has neighbouring frames, large enough for optical flow."""
    return shape[1] > 1 and min(shape[2:]) >= SMALLEST


def measure(
    view: np.ndarray, neighbours: int, tolerance: float, drift: float, rest: float, before: Motion | None = None
) -> Motion:
    """The motion of a view (B, H, W), C-ordered, values about [0, 1], from each frame to those up to `neighbours` away.

    `tolerance` is the difference, `drift` the distance in pixels between there and back, at which the weight is 1/e;
    `rest` is the standard deviation along time at which pixels count 1/e as still, see :func:`_at_rest`.
    The search for the flow begins with the motion `before`, if any: of an earlier estimate of the view, with as many
    neighbours.
    """
    import cv2

    frames, height, width = view.shape
    near = [(b, n) for b in range(frames) for n in range(frames) if 0 < abs(b - n) <= neighbours]
    pairs = np.array(near, np.int64)
    if before is not None and len(before.pairs) != len(pairs):
        before = None
    first = np.searchsorted(pairs[:, 0], np.arange(frames + 1)).astype(np.int64)
    small = np.stack([cv2.resize(f, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA) for f in view])
    close = view.dtype.type(HALVED * tolerance)

    flow = _searched(view, pairs, small.shape[1:], before)
    distance = _chosen(small, near, neighbours, close, flow)
    trust, weights = np.empty(distance.shape, np.uint8), np.empty(distance.shape, np.uint8)
    place = {pair: p for p, pair in enumerate(near)}
    matches.consistency(flow, pairs, np.array([place[n, b] for b, n in near]), drift / 2, trust)
    matches.weigh(distance, trust, close, weights)
    pilot = np.empty_like(small)  # frames already averaged are cleaner, and tell better which of them are alike
    of_blocks = np.ascontiguousarray(flow[:, ::2, ::2])  # that of every second pixel will do
    averages.average(small, of_blocks, weights, pairs, first, pilot)
    matches.differ(pilot, flow, pairs, distance)
    matches.weigh(distance, trust, close, weights)
    still = _at_rest(pilot, pairs, distance, rest)
    return _enlarged(Motion(pairs, first, flow, weights, still), height, width)


def _searched(view: np.ndarray, pairs: np.ndarray, half: tuple[int, ...], before: Motion | None) -> np.ndarray:
    """The flow of each pair of frames as dense inverse search finds it, for pictures of `half` the height and width."""
    import cv2

    pictures = [cv2.GaussianBlur(np.clip(f, 0, 1), (0, 0), BLUR) for f in view.astype(np.float32)]
    pictures = [np.round(255 * p).astype(np.uint8) for p in pictures]
    flow = np.empty((len(pairs), *half, 2), np.int16)

    def search(b: int) -> None:
        dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        scale, side = dis.getFinestScale(), dis.getPatchSize()
        dis.setGradientDescentIterations(STEPS)
        dis.setVariationalRefinementIterations(SMOOTHINGS)
        for p in np.flatnonzero(pairs[:, 0] == b):
            dis.setFinestScale(scale)  # on small pictures it changes these three, and keeps them
            dis.setPatchSize(side)
            dis.setPatchStride(STRIDE)
            begin = None
            if before is not None:
                begin = cv2.resize(before.flow[p] / np.float32(averages.FRACTION), view.shape[:0:-1])
            found = dis.calc(pictures[b], pictures[pairs[p, 1]], begin)  # type: ignore[call-overload, arg-type]
            found = cv2.resize(found, half[::-1], interpolation=cv2.INTER_AREA)
            flow[p] = _rescaled(averages.FRACTION * found, view.shape[1:], half)

    _for_each(len(view), search)
    return flow


def _chosen(
    small: np.ndarray, near: list[tuple[int, int]], neighbours: int, close: np.floating, flow: np.ndarray
) -> np.ndarray:
    """How frames of `small` differ along the flow of each pair in `near`, which gives way to others.

    In each pixel that is the flow of a motion as steady as between other frames, one as far on the other side or the
    farthest on the same; or the flow of its surroundings, where frames differ by less than `close` above all, even if
    that matches a little worse.
    """
    last, place = len(small) - 1, {pair: p for p, pair in enumerate(near)}
    opposite = [place.get((b, 2 * b - n), p) for p, (b, n) in enumerate(near)]
    farthest = [place[b, min(b + neighbours, last) if n > b else max(b - neighbours, 0)] for b, n in near]
    pairs, candidate = np.array(near, np.int64), np.empty_like(flow)
    distance = np.empty(flow.shape[:3], small.dtype)
    matches.differ(small, flow, pairs, distance)
    steps = pairs[:, 1] - pairs[:, 0]
    for source in (opposite, farthest):
        matches.steady(flow, np.array(source), (steps / steps[source]).astype(np.float32), candidate)
        matches.choose(small, candidate, small.dtype.type(1), pairs, flow, distance)
    matches.smooth(flow, distance, close, candidate)
    matches.choose(small, candidate, small.dtype.type(SMOOTH), pairs, flow, distance)
    return distance


def _at_rest(pilot: np.ndarray, pairs: np.ndarray, distance: np.ndarray, rest: float) -> np.ndarray:
    """How surely each pixel of frames that have been averaged (B, H, W) shows the same in all of them, 0 to 1.

    ``exp(-(s^2 + 9 e) / rest^2)``, s the standard deviation along time; e is by how much squared differences of frames
    far apart are smaller along the flow, `distance` (P, H, W): a slow motion shows there before it does in s. Dark
    pixels need to be stiller, see :func:`priors.kernels.still.sureness`. With ``rest = 0`` nothing is still.
    """
    import cv2

    if rest == 0:
        return np.zeros(pilot.shape[1:], np.float32)
    steps = pairs[:, 1] - pairs[:, 0]
    far = int(steps.max())
    apart = cv2.GaussianBlur(np.mean((pilot[far:] - pilot[:-far]) ** 2, 0), (0, 0), 1.2)  # much as `distance` is
    gained = cv2.GaussianBlur(apart - distance[np.abs(steps) == far].mean(0), (0, 0), 1.0)
    brightness, variance = np.empty((2, *pilot.shape[1:]), pilot.dtype)
    mean_and_variance(pilot, brightness, variance)
    brightness, variance = (cv2.GaussianBlur(a, (0, 0), width) for a, width in ((brightness, 1.5), (variance, 0.75)))
    return sureness(variance + MOVES * np.maximum(gained, 0), brightness, rest).astype(np.float32)


def _enlarged(motion: Motion, height: int, width: int) -> Motion:
    """The motion of pictures of this size, from that of pictures half as large."""
    import cv2

    half = motion.flow.shape[1:3]
    flow, weights = np.empty_like(motion.flow), np.empty((len(motion.pairs), height, width), np.uint8)

    def enlarge(p: int) -> None:
        flow[p] = _rescaled(motion.flow[p], half, (height, width))
        weights[p] = cv2.resize(motion.weights[p], (width, height), interpolation=cv2.INTER_LINEAR)

    _for_each(len(flow), enlarge)
    still = cv2.resize(motion.still, (width, height), interpolation=cv2.INTER_LINEAR)
    return Motion(motion.pairs, motion.first, flow, weights, still)


def _rescaled(flow: np.ndarray, size: tuple[int, ...], other: tuple[int, ...]) -> np.ndarray:
    """The flow (..., 2) in pictures of this height and width in pixels of pictures of another, as int16."""
    scale = np.array([other[1] / size[1], other[0] / size[0]], np.float32)
    return np.clip(np.rint(flow * scale), -matches.LIMIT, matches.LIMIT).astype(np.int16)


def finished(x: np.ndarray, sigma: float, neighbours: int, drift: float, rest: float) -> np.ndarray:
    """A solver's last estimate (V, B, H, W), averaged along the motion that it shows itself.

    `sigma` is the solver's, the other arguments are those of :func:`measure` in its calls. Done in every iteration it
    is worth as much as done once, in the end.
    """
    out = np.empty_like(x)
    for view, mean in zip(x, out):
        measure(view, neighbours, CERTAIN * sigma, drift, CERTAIN * rest).average(view, mean)
    return out


def _hold_opencv(threads: int) -> Callable[[], None]:
    import cv2

    own = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    return partial(cv2.setNumThreads, own)


_opencv = Pool(_hold_opencv)


def _for_each(count: int, work: Callable[[int], None]) -> None:
    """Call `work` with 0..count-1, shared among as many threads as numba may use; OpenCV then stays in its own."""
    import numba

    with _opencv.at_most(1):  # one picture is too small to share out; the pairs are not
        list(_threads(numba.get_num_threads()).map(work, range(count)))


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)
