"""Motion of each pixel of a view from frame to frame, and its confidence."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.accel.threads import Pool
from priors.kernels import average as averages
from priors.kernels import match as matches
from priors.kernels.still import HARDLY, mean_and_variance, sureness, tie
from priors.motion.credit import credit
from priors.motion.pairs import adjacent, neighbouring, reverse, steady

SMALLEST = 32  # pixels: smallest height and width for optical flow


@dataclass(frozen=True)
class MotionNumbers(Tuned):
    """Parameters of the flow search and of the weights."""

    neighbours: int = 4  # frames on either side that a frame is averaged with
    drift: float = 1.5  # pixels: forward-backward error of the flow at which the weight is 1/e
    blur: float = 0.7  # pixels: standard deviation of the Gaussian before the flow search
    steps: int = 8  # iterations of gradient descent per patch
    smoothings: int = 1  # iterations of variational refinement of the flow
    stride: int = 4  # pixels from patch to patch
    halved: float = 0.7  # factor on the tolerance for frames of half the height and width
    smooth: float = 1.3  # ratio of squared differences up to which the smoothed flow replaces the pixel's own
    certain: float = 0.3  # factor on tolerance and rest limit, in units of sigma, for a solver's last estimate
    moves: float = 9  # weight of the evidence from slow motion, relative to the variance along time


TUNED = MotionNumbers()


@dataclass(frozen=True, eq=False)
class Motion:
    """The flow between neighbouring frames of one view, and the weights of averages along it.

    Attributes
    ----------
    pairs : ndarray of int, (P, 2)
        Frames (b, n), sorted: n is a neighbour of b. The pairs of frame b are ``pairs[first[b]:first[b + 1]]``.
    first : ndarray of int, (B + 1,)
    flow : ndarray of int16, (P, ceil(H / 2), ceil(W / 2), 2)
        Displacement (columns, rows) of each block of 2 x 2 pixels from frame b to frame n, in 1/64 pixel. Where H or W
        is odd, the block is up to one pixel off, as the flow is that of frames of half the size.
    weights : ndarray of uint8, (P, H, W)
        Weight of frame n in the average of frame b, whose own weight is 255.
    still : ndarray of float32, (H, W)
        Probability that a pixel is constant in time, 0 to 1.
    """

    pairs: np.ndarray
    first: np.ndarray
    flow: np.ndarray
    weights: np.ndarray
    still: np.ndarray

    def average(self, view: np.ndarray, out: np.ndarray) -> None:
        """Average each frame of a view (B, H, W), C-ordered, with its neighbours along the motion, into out (B, H, W).

        Still pixels are blended with the mean of all frames; the weight of the mean is `still`.
        """
        averages.average(view, self.flow, self.weights, self.pairs, self.first, out)
        tie(view, self.still, out)

    def spread(self, g: np.ndarray, out: np.ndarray) -> None:
        """The transpose of :meth:`average`, which is linear, applied to g (B, H, W), into out (B, H, W)."""
        still = np.where(self.still.max(1, keepdims=True) < HARDLY, 0, self.still)
        averages.spread((1 - still) * g, self.flow, self.weights, self.pairs, self.first, out)
        out += still * g.mean(0)

    @cached_property
    def remaining(self) -> np.ndarray:
        """Factor of the averages along motion on the standard deviation of white noise, float32 (B, H, W).

        It is 1 where no neighbour had a weight. Still pixels are not taken into account, because their noise may be
        equal in all frames, as in a view that is modelled by one frame.
        """
        left = np.empty((len(self.first) - 1, *self.weights.shape[1:]), np.float32)
        averages.remaining(self.weights, self.first, left)
        return left

    @property
    def at_rest(self) -> float:
        """Fraction of the pixels that are still, 0 to 1."""
        return float(self.still.mean())


def may_show_motion(shape: tuple[int, ...]) -> bool:
    """Whether a video of this shape (V, B, H, W) has several frames, large enough for optical flow."""
    return shape[1] > 1 and min(shape[2:]) >= SMALLEST


def measure(
    view: np.ndarray, neighbours: int, tolerance: float, drift: float, rest: float, before: Motion | None = None
) -> Motion:
    """Estimate the motion of a view.

    Parameters
    ----------
    view : ndarray, (B, H, W)
        C-ordered, values about [0, 1].
    neighbours : int
        Largest distance in frames between a frame and its neighbours, >= 1.
    tolerance : float
        Difference between a frame and a warped neighbour at which the weight is 1/e, > 0. The weights of a pair also
        have a common factor, see :func:`priors.motion.credit.credit`.
    drift : float
        Forward-backward error of the flow, in pixels, at which the weight is 1/e.
    rest : float
        Standard deviation along time at which a pixel counts 1/e as still; with 0 no pixel is still.
    before : Motion, optional
        Motion of an earlier estimate of the view; the flow search starts from it if it has as many pairs.

    Returns
    -------
    Motion
    """
    import cv2

    frames, height, width = view.shape
    pairs, first = neighbouring(frames, neighbours)
    if before is not None and len(before.pairs) != len(pairs):
        before = None
    small = np.stack([cv2.resize(f, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA) for f in view])
    close = view.dtype.type(TUNED.halved * tolerance)

    start = None if before is None else _rescaled(before.flow, (height, width), small.shape[1:])
    flow = searched(view, pairs, start)
    distance = _chosen(small, pairs, close, flow)
    trust, weights = np.empty(distance.shape, np.uint8), np.empty(distance.shape, np.uint8)
    beside = adjacent(pairs)

    def weigh() -> None:
        matches.weigh(distance, trust, credit(distance.mean((1, 2)), beside, close), close, weights)

    matches.consistency(flow, pairs, np.array(reverse(pairs)), drift / 2, trust)
    weigh()
    pilot = np.empty_like(small)  # averaged frames have less noise, so their differences are more reliable
    of_blocks = np.ascontiguousarray(flow[:, ::2, ::2])  # one vector for 2 x 2 pixels
    averages.average(small, of_blocks, weights, pairs, first, pilot)
    matches.differ(pilot, flow, pairs, distance)
    weigh()
    still = _at_rest(pilot, pairs, distance, rest)
    return _enlarged(Motion(pairs, first, flow, weights, still), height, width)


def searched(view: np.ndarray, pairs: np.ndarray, start: np.ndarray | None) -> np.ndarray:
    """Flow of each pair of frames by dense inverse search, from frames of half the height and width.

    Result and first guess `start` are int16 (P, ceil(H / 2), ceil(W / 2), 2), in 1/64 pixel of those frames.
    """
    import cv2

    size = (view.shape[2] + 1) // 2, (view.shape[1] + 1) // 2
    blurred = [cv2.GaussianBlur(np.clip(f, 0, 1), (0, 0), TUNED.blur) for f in view.astype(np.float32)]
    pictures = [np.round(255 * cv2.resize(f, size, interpolation=cv2.INTER_AREA)).astype(np.uint8) for f in blurred]
    flow = np.empty((len(pairs), *size[::-1], 2), np.int16)

    def search(b: int) -> None:
        dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        dis.setFinestScale(0)
        dis.setPatchStride(TUNED.stride)
        dis.setGradientDescentIterations(TUNED.steps)
        dis.setVariationalRefinementIterations(TUNED.smoothings)
        for p in np.flatnonzero(pairs[:, 0] == b):
            begin = None if start is None else start[p] / np.float32(averages.FRACTION)
            found = dis.calc(pictures[b], pictures[pairs[p, 1]], begin)  # type: ignore[call-overload, arg-type]
            flow[p] = np.clip(np.rint(averages.FRACTION * found), -matches.LIMIT, matches.LIMIT)

    _for_each(len(view), search)
    return flow


def _chosen(small: np.ndarray, pairs: np.ndarray, close: np.floating, flow: np.ndarray) -> np.ndarray:
    """Replace the flow of each pair by better candidates, in place; return the squared differences (P, h, w).

    The candidates of a pixel are the flow of a steady motion and the smoothed flow. The steady flow is that of the
    opposite neighbour or of the farthest one on the same side, scaled. The smoothed flow weighs pixels by how well
    frames of `small` match, in units of `close`; it is chosen even if it matches slightly worse.
    """
    candidate, distance = np.empty_like(flow), np.empty(flow.shape[:3], small.dtype)
    matches.differ(small, flow, pairs, distance)
    for source, factors in steady(pairs):
        matches.steady(flow, np.array(source), factors.astype(np.float32), candidate)
        matches.choose(small, candidate, small.dtype.type(1), pairs, flow, distance)
    matches.smooth(flow, distance, close, candidate)
    matches.choose(small, candidate, small.dtype.type(TUNED.smooth), pairs, flow, distance)
    return distance


def _at_rest(pilot: np.ndarray, pairs: np.ndarray, distance: np.ndarray, rest: float) -> np.ndarray:
    """Probability that each pixel of averaged frames `pilot` (B, H, W) is constant in time, (H, W), 0 to 1.

    It is ``exp(-(s^2 + moves e) / rest^2)`` with the standard deviation s along time. The term e is the decrease of the
    squared difference between distant frames along the flow, from `distance` (P, H, W); it detects slow motion.
    Dark pixels have a lower limit, see :func:`priors.kernels.still.sureness`. With ``rest = 0`` no pixel is still.
    """
    import cv2

    if rest == 0:
        return np.zeros(pilot.shape[1:], np.float32)
    steps = pairs[:, 1] - pairs[:, 0]
    far = int(steps.max())
    apart = cv2.GaussianBlur(np.mean((pilot[far:] - pilot[:-far]) ** 2, 0), (0, 0), 1.2)  # as `distance`, roughly
    gained = cv2.GaussianBlur(apart - distance[np.abs(steps) == far].mean(0), (0, 0), 1.0)
    brightness, variance = np.empty((2, *pilot.shape[1:]), pilot.dtype)
    mean_and_variance(pilot, brightness, variance)
    brightness, variance = (cv2.GaussianBlur(a, (0, 0), width) for a, width in ((brightness, 1.5), (variance, 0.75)))
    return sureness(variance + TUNED.moves * np.maximum(gained, 0), brightness, rest).astype(np.float32)


def _enlarged(motion: Motion, height: int, width: int) -> Motion:
    """The motion of frames of this height and width, from that of frames of half the size."""
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
    """Convert a flow (..., 2) from pixels of frames of one `size` to pixels of an `other` size, as int16."""
    scale = np.array([other[1] / size[1], other[0] / size[0]], np.float32)
    return np.clip(np.rint(flow * scale), -matches.LIMIT, matches.LIMIT).astype(np.int16)


def _hold_opencv(threads: int) -> Callable[[], None]:
    import cv2

    own = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    return partial(cv2.setNumThreads, own)


_opencv = Pool(_hold_opencv)


def _for_each(count: int, work: Callable[[int], None]) -> None:
    """Call `work` with 0..count-1 in a pool with numba's number of threads; OpenCV uses one thread per call."""
    import numba

    with _opencv.at_most(1):  # parallel over pairs, as one picture is too small
        list(_threads(numba.get_num_threads()).map(work, range(count)))


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.cache_clear)  # threads do not follow into the child
