"""Where each pixel of a view goes from frame to frame, and how far to believe it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from . import _flow_kernels as kernels

SMALLEST = 32  # pixels a side that optical flow needs
BLUR = 0.7  # pixels: of the pictures that flow is estimated from
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
        kernels.average(view, self.flow, self.weights, self.pairs, self.first, out)

    @cached_property
    def remaining(self) -> np.ndarray:
        """What averaging leaves of the standard deviation of white noise, float32 (B, H, W), 1 where nothing helped."""
        left = np.empty((len(self.first) - 1, *self.weights.shape[1:]), np.float32)
        kernels.remaining(self.weights, self.first, left)
        return left


@dataclass(frozen=True)
class Search:
    """How hard flow is looked for: steps of gradient descent for each patch, then smoothings of the whole."""

    steps: int
    smoothings: int


def measure(view: np.ndarray, neighbours: int, tolerance: float, drift: float, search: Search) -> Motion:
    """The motion of a view (B, H, W), C-ordered, values about [0, 1], from each frame to those up to `neighbours` away.

    `tolerance` is the difference, `drift` the distance in pixels between there and back, at which the weight is 1/e;
    `search` says how hard the flow is looked for.
    Frames are compared twice: as they are, and once more after they have been averaged by these first weights.
    """
    import cv2
    import numba

    frames = len(view)
    near = [(b, n) for b in range(frames) for n in range(frames) if 0 < abs(b - n) <= neighbours]
    pairs = np.array(near, np.int64)
    first = np.searchsorted(pairs[:, 0], np.arange(frames + 1)).astype(np.int64)
    place = {pair: p for p, pair in enumerate(near)}
    reverse = np.array([place[n, b] for b, n in near], np.int64)

    pictures = [cv2.GaussianBlur(np.clip(f, 0, 1), (0, 0), BLUR) for f in view.astype(np.float32)]
    pictures = [np.round(255 * p).astype(np.uint8) for p in pictures]
    flow = np.empty((len(near), *view.shape[1:], 2), np.int16)
    limit = np.iinfo(np.int16).max

    def estimate(p: int) -> None:
        b, n = near[p]
        # Dense inverse search made anew each time: on small pictures it changes its scales, and it keeps them.
        dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        dis.setPatchStride(4)  # a third quicker than 3 pixels, and as accurate here
        dis.setGradientDescentIterations(search.steps)
        dis.setVariationalRefinementIterations(search.smoothings)
        there = dis.calc(pictures[b], pictures[n], None)  # type: ignore[call-overload, arg-type]
        np.clip(np.rint(kernels.FRACTION * there), -limit, limit, out=there)
        flow[p] = there

    own = cv2.getNumThreads()
    cv2.setNumThreads(1)  # one picture is too small to share out; the pairs are not
    try:
        list(_threads(numba.get_num_threads()).map(estimate, range(len(near))))
    finally:
        cv2.setNumThreads(own)
    trust = np.empty(flow.shape[:3], np.uint8)
    kernels.consistency(flow, pairs, reverse, drift, trust)
    motion = Motion(pairs, first, flow, np.empty_like(trust))
    kernels.weigh(view, flow, trust, pairs, view.dtype.type(tolerance), motion.weights)
    pilot = np.empty_like(view)  # frames already averaged are cleaner, and tell better which of them are alike
    motion.average(view, pilot)
    kernels.weigh(pilot, flow, trust, pairs, view.dtype.type(tolerance), motion.weights)
    return motion


def finished(x: np.ndarray, sigma: float, neighbours: int, drift: float, search: Search) -> np.ndarray:
    """A solver's last estimate (V, B, H, W), averaged along the motion that it shows itself.

    `sigma` is the solver's, the other arguments are those of :func:`measure`. Done in every iteration it is worth as
    much as done once, in the end.
    """
    out = np.empty_like(x)
    for view, mean in zip(x, out):
        measure(view, neighbours, CERTAIN * sigma, drift, search).average(view, mean)
    return out


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)
