"""Where each pixel of a view goes from frame to frame, and how far to believe it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from . import _flow_kernels as averages
from . import _match_kernels as matches

SMALLEST = 32  # pixels a side that optical flow needs
BLUR = 0.7  # pixels: of the pictures that flow is estimated from
HALVED = 0.8  # part of a difference that is left when frames are halved
# Difference, in units of the solver's sigma, at which neighbours count 1/e for a frame of a last estimate, which shows
# finer ones than what comes from a measurement. Six cases of validation clips gain with `video` 0.08 dB (two views of
# 10 frames), 0.15 (one of 8), 0.04 (noise of 0.03 of max(y)); with half of it less; with 0.75 cases lose up to 0.16.
CERTAIN = 0.3


@dataclass(frozen=True, eq=False)
class Motion:
    """The flow between near frames of one view and the weights for averaging along it.

    Attributes
    ----------
    pairs : ndarray of int, (P, 2)
        Frames (b, n): n helps b. Sorted; those of frame b are ``pairs[first[b]:first[b + 1]]``.
    first : ndarray of int, (B + 1,)
    flow : ndarray of int16, (P, H, W, 2)
        Columns and rows from a pixel of frame b to its place in frame n, in 64ths of a pixel.
    weights : ndarray of uint8, (P, H, W)
        What n counts for b, 255 being as much as b itself.
    """

    pairs: np.ndarray
    first: np.ndarray
    flow: np.ndarray
    weights: np.ndarray

    def average(self, view: np.ndarray, out: np.ndarray) -> None:
        """out (B, H, W) <- each frame of view (B, H, W), C-ordered, averaged with its neighbours along their motion."""
        averages.average(view, self.flow, self.weights, self.pairs, self.first, out)

    @cached_property
    def remaining(self) -> np.ndarray:
        """What averaging leaves of the standard deviation of white noise, float32 (B, H, W), 1 where nothing helped."""
        left = np.empty((len(self.first) - 1, *self.weights.shape[1:]), np.float32)
        averages.remaining(self.weights, self.first, left)
        return left


@dataclass(frozen=True)
class Search:
    """How hard flow is looked for: steps of gradient descent for each patch, then smoothings of the whole."""

    steps: int
    smoothings: int


def measure(
    view: np.ndarray, neighbours: int, tolerance: float, drift: float, search: Search, before: Motion | None = None
) -> Motion:
    """The motion of a view (B, H, W), C-ordered, values about [0, 1], from each frame to those up to `neighbours` away.

    `tolerance` is the difference, `drift` the distance in pixels between there and back, at which the weight is 1/e;
    `search` says how hard the flow is looked for, from the motion `before`, if any: of an earlier estimate of the view.
    In each pixel the flow found may give way to a steady motion, or to its surroundings', where frames match better by
    that. They are compared twice, at half their size: as they are, and averaged by the weights that come of it.
    """
    import cv2

    frames, height, width = view.shape
    near = [(b, n) for b in range(frames) for n in range(frames) if 0 < abs(b - n) <= neighbours]
    pairs = np.array(near, np.int64)
    first = np.searchsorted(pairs[:, 0], np.arange(frames + 1)).astype(np.int64)
    half = (width + 1) // 2, (height + 1) // 2
    scale = averages.FRACTION * np.divide(half, (width, height), dtype=np.float32)  # of flow as stored, in full pixels
    small = np.stack([cv2.resize(f, half, interpolation=cv2.INTER_AREA) for f in view])
    pictures = [cv2.GaussianBlur(np.clip(f, 0, 1), (0, 0), BLUR) for f in view.astype(np.float32)]
    pictures = [np.round(255 * p).astype(np.uint8) for p in pictures]
    flow = np.empty((len(near), half[1], half[0], 2), np.int16)

    def estimate(p: int) -> None:
        b, n = near[p]
        # Dense inverse search made anew each time: on small pictures it changes its scales, and it keeps them.
        dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        dis.setPatchStride(4)  # a third quicker than 3 pixels, and as accurate here
        dis.setGradientDescentIterations(search.steps)
        dis.setVariationalRefinementIterations(search.smoothings)
        begin = None if before is None else before.flow[p] / np.float32(averages.FRACTION)
        there = dis.calc(pictures[b], pictures[n], begin)  # type: ignore[call-overload, arg-type]
        flow[p] = _stored(cv2.resize(there, half, interpolation=cv2.INTER_AREA) * scale)

    _for_each(len(near), estimate)
    distance = np.empty(flow.shape[:3], view.dtype)
    matches.differ(small, flow, pairs, distance)
    real = view.dtype.type
    close = real(HALVED * tolerance)
    candidate = np.empty_like(flow)
    for source, share in (_opposite(near), _farthest(near)):
        matches.steady(flow, source, share, candidate)
        matches.choose(small, candidate, pairs, flow, distance)
    matches.smooth(flow, distance, close, candidate)
    matches.choose(small, candidate, pairs, flow, distance)

    trust, weights = np.empty(flow.shape[:3], np.uint8), np.empty(flow.shape[:3], np.uint8)
    place = {pair: p for p, pair in enumerate(near)}
    matches.consistency(flow, pairs, np.array([place[n, b] for b, n in near], np.int64), drift / 2, trust)
    matches.weigh(distance, trust, close, weights)
    pilot = np.empty_like(small)  # frames already averaged are cleaner, and tell better which of them are alike
    averages.average(small, flow, weights, pairs, first, pilot)
    matches.differ(pilot, flow, pairs, distance)
    matches.weigh(distance, trust, close, weights)

    motion = Motion(
        pairs, first, np.empty((len(near), height, width, 2), np.int16), np.empty((len(near), height, width), np.uint8)
    )

    def enlarge(p: int) -> None:
        there = cv2.resize(flow[p].astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        motion.flow[p] = _stored(there * (averages.FRACTION / scale))
        motion.weights[p] = cv2.resize(weights[p], (width, height), interpolation=cv2.INTER_LINEAR)

    _for_each(len(near), enlarge)
    return motion


def _stored(flow: np.ndarray) -> np.ndarray:
    """Flow in 64ths of a pixel as int16."""
    limit = np.iinfo(np.int16).max
    return np.clip(np.rint(flow), -limit, limit).astype(np.int16)


def _opposite(near: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """For each pair (b, n) the pair of b and the frame as far on its other side, or itself; and what of its flow."""
    place = {pair: p for p, pair in enumerate(near)}
    source = np.array([place.get((b, 2 * b - n), p) for p, (b, n) in enumerate(near)])
    return source, np.where(source == np.arange(len(near)), 1, -1).astype(np.float32)


def _farthest(near: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """For each pair (b, n) that of b and the farthest frame on the same side; and what of its flow."""
    side = [[m for c, m in near if c == b and (m > b) == (n > b)] for b, n in near]
    far = [max(those, key=lambda m: abs(m - b)) for (b, _), those in zip(near, side)]
    place = {pair: p for p, pair in enumerate(near)}
    source = np.array([place[b, m] for (b, _), m in zip(near, far)])
    return source, np.array([(n - b) / (m - b) for (b, n), m in zip(near, far)], np.float32)


def finished(x: np.ndarray, sigma: float, neighbours: int, drift: float, search: Search) -> np.ndarray:
    """A solver's last estimate (V, B, H, W), averaged along the motion that it shows itself.

    `sigma` is the solver's, the other arguments are those of :func:`measure`. Done in every iteration it is worth as
    much as done once, in the end.
    """
    out = np.empty_like(x)
    for view, mean in zip(x, out):
        measure(view, neighbours, CERTAIN * sigma, drift, search).average(view, mean)
    return out


def _for_each(count: int, work: Callable[[int], None]) -> None:
    """Call `work` with 0..count-1, shared among as many threads as numba may use; OpenCV then stays in its own."""
    import cv2
    import numba

    own = cv2.getNumThreads()
    cv2.setNumThreads(1)  # one picture is too small to share out; the pairs are not
    try:
        list(_threads(numba.get_num_threads()).map(work, range(count)))
    finally:
        cv2.setNumThreads(own)


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)
