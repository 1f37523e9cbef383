"""Motion of each pixel from frame to frame, on tensors; :mod:`priors.motion.measure` says what it does."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from priors.kernels.average import FRACTION
from priors.kernels.still import sureness
from priors.motion.credit import credit
from priors.motion.measure import TUNED, searched
from priors.motion.pairs import adjacent, neighbouring, reverse, steady
from priors.on_device.filters import box, gaussian, tie
from priors.on_device.warp import bicubic

NEAR, WIDE = 3, 5  # pixels a side of the boxes over squared differences and over flow, each applied twice
LEAST = 1e-6  # total weight that is not divided by


class Pairs:
    """Pairs (b, n) of frames of a video, and those related; pairs of one distance n - b follow each other."""

    def __init__(self, frames: int, neighbours: int):
        found, _ = neighbouring(frames, neighbours)
        self.pairs = pairs = found[np.argsort(found[:, 1] - found[:, 0], kind="stable")]
        self.steps = pairs[:, 1] - pairs[:, 0]
        self.reverse, self.adjacent, self.steady = reverse(pairs), adjacent(pairs), steady(pairs)
        self.most = int(self.steps.max())
        self.far = np.flatnonzero(np.abs(self.steps) == self.most)

    def slices(self) -> list[tuple[slice, slice, slice]]:
        """For each distance, the places of its pairs, of frames b and of frames n."""
        places = [np.flatnonzero(self.steps == d) for d in np.unique(self.steps)]
        return [(_span(p), _span(self.pairs[p, 0]), _span(self.pairs[p, 1])) for p in places]


def _span(successive: np.ndarray) -> slice:
    return slice(int(successive[0]), int(successive[-1]) + 1)


class OfTensors:
    """The flow (V, P, 2, h, w) of frames of half the size, weights (V, P, H, W) and still pixels (V, 1, H, W)."""

    def __init__(self, pairs: Pairs, flow: torch.Tensor, weights: torch.Tensor, still: torch.Tensor):
        self.pairs, self.flow, self.weights, self.still = pairs, flow, weights, still

    @property
    def at_rest(self) -> list[float]:
        """Fraction of the pixels of each view that are still, 0 to 1."""
        return self.still.mean((1, 2, 3)).tolist()

    @cached_property
    def remaining(self) -> torch.Tensor:
        """Factor of the averages on the standard deviation of white noise (V, B, H, W)."""
        shape = self.weights.shape
        frames = int(self.pairs.pairs.max()) + 1
        total = self.weights.new_ones((shape[0], frames, *shape[2:]))
        squares = total.clone()
        for p, b, _ in self.pairs.slices():
            total[:, b] += self.weights[:, p]
            squares[:, b] += self.weights[:, p].square()
        return squares.sqrt() / total

    def average(self, x: torch.Tensor) -> torch.Tensor:
        """Each frame of x (V, B, H, W) averaged with its neighbours along the motion."""
        return tie(x, self.still, averaged(x, self.flow, self.weights, self.pairs))


def averaged(x: torch.Tensor, flow: torch.Tensor, weights: torch.Tensor, pairs: Pairs) -> torch.Tensor:
    """Frames of x (V, B, H, W) averaged with their warped neighbours; the frame itself has weight 1.

    Flow (V, P, 2, h, w) of frames of another size serves blocks of pixels.
    """
    rows, columns = x.shape[2:]
    out, total = x.clone(), torch.ones_like(x)
    for p, b, n in pairs.slices():
        there = x[:, n].reshape(-1, rows, columns)
        along = _of_pixels(flow[:, p].flatten(0, 1), rows, columns)
        w = weights[:, p]
        out[:, b] += w * bicubic(there, along).reshape(w.shape)
        total[:, b] += w
    return out / total


def _of_pixels(flow: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
    """The flow (N, 2, h, w) of blocks of pixels for each pixel (N, 2, H, W)."""
    if flow.shape[2:] == (rows, columns):
        return flow
    scale = torch.tensor([columns / flow.shape[3], rows / flow.shape[2]], dtype=flow.dtype, device=flow.device)
    each = (flow * scale[:, None, None]).repeat_interleave(2, 2).repeat_interleave(2, 3)
    return each[..., :rows, :columns]


def measured(
    x: torch.Tensor, neighbours: int, tolerance: float, drift: float, rest: float, before: Any = None
) -> OfTensors:
    """The motion of each view of x (V, B, H, W); arguments as for :func:`priors.motion.measure.measure`."""
    frames, rows, columns = x.shape[1:]
    half, pairs = ((rows + 1) // 2, (columns + 1) // 2), Pairs(frames, neighbours)
    small = F.interpolate(x, half, mode="area")
    close = TUNED.halved * tolerance
    begin = before.flow if isinstance(before, OfTensors) else None
    flow = _searched(x, pairs, begin)
    flow, distance = _chosen(small, pairs, close, flow)
    trust = _trust(flow, pairs, drift / 2)
    pilot = averaged(small, flow, trust * _fading(distance, close, pairs), pairs)
    distance = _differing(pilot, flow, pairs)
    weights = F.interpolate(trust * _fading(distance, close, pairs), (rows, columns), mode="bilinear")
    still = F.interpolate(_at_rest(pilot, pairs, distance, rest), (rows, columns), mode="bilinear")
    return OfTensors(pairs, flow, weights, still)


def _searched(x: torch.Tensor, pairs: Pairs, begin: torch.Tensor | None) -> torch.Tensor:
    """Flow (V, P, 2, h, w) of each pair of frames of x (V, B, H, W) at half size, by OpenCV on the CPU."""
    starts = (
        [None] * len(x) if begin is None else (FRACTION * begin).movedim(2, -1).float().contiguous().numpy(force=True)
    )
    found = np.stack([searched(view, pairs.pairs, start) for view, start in zip(x.numpy(force=True), starts)])
    return torch.from_numpy(found).to(x).movedim(-1, 2) / FRACTION


def _differing(x: torch.Tensor, flow: torch.Tensor, pairs: Pairs) -> torch.Tensor:
    """Smoothed squared differences (V, P, h, w) between frames of x (V, B, h, w) and their warped neighbours."""
    size = x.shape[2:]
    apart = [
        bicubic(x[:, n].reshape(-1, *size), flow[:, p].flatten(0, 1)).reshape(len(x), -1, *size) - x[:, b]
        for p, b, n in pairs.slices()
    ]
    return box(torch.cat(apart, 1).square(), NEAR, 2)


def _chosen(small: torch.Tensor, pairs: Pairs, close: float, flow: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The best of flow, steady flows and smoothed flow in each pixel, and its squared differences."""
    distance = _differing(small, flow, pairs)

    def better(candidate: torch.Tensor, favour: float) -> None:
        nonlocal flow, distance
        other = _differing(small, candidate, pairs)
        take = other < favour * distance
        distance, flow = torch.where(take, other, distance), torch.where(take[:, :, None], candidate, flow)

    for source, share in pairs.steady:
        better(flow[:, source] * torch.tensor(share, dtype=flow.dtype, device=flow.device)[:, None, None, None], 1.0)
    sure = (1 + distance / close**2) ** -2
    total = box(sure, WIDE, 2).clamp(min=LEAST)
    better(box(sure[:, :, None] * flow, WIDE, 2) / total[:, :, None], TUNED.smooth)
    return flow, distance


def _trust(flow: torch.Tensor, pairs: Pairs, tolerance: float) -> torch.Tensor:
    """``exp(-|forward + backward flow|^2 / tolerance^2)`` (V, P, h, w), 0 for what leaves the frame."""
    rows, columns = flow.shape[3:]
    to = (flow + 0.5).floor().long()
    across = torch.arange(columns, device=flow.device) + to[:, :, 0]
    down = torch.arange(rows, device=flow.device)[:, None] + to[:, :, 1]
    inside = (across >= 0) & (across < columns) & (down >= 0) & (down < rows)
    place = (down.clamp(0, rows - 1) * columns + across.clamp(0, columns - 1)).flatten(2)[:, :, None]
    back = flow[:, pairs.reverse].flatten(3).gather(3, place.expand(-1, -1, 2, -1)).reshape(flow.shape)
    return torch.exp(-(flow + back).square().sum(2) / tolerance**2) * inside


def _fading(distance: torch.Tensor, tolerance: float, pairs: Pairs) -> torch.Tensor:
    """The credit of each pair times ``exp(-z)``: z = distance / tolerance^2, exp(z) by its Taylor series to z^3."""
    z = distance / tolerance**2
    counts = credit(distance.mean((2, 3)), pairs.adjacent, tolerance)
    return counts[..., None, None] / (1 + z * (1 + z * (1 / 2 + z / 6)))


def _at_rest(pilot: torch.Tensor, pairs: Pairs, distance: torch.Tensor, rest: float) -> torch.Tensor:
    """Probability that each pixel of `pilot` (V, B, h, w) is constant in time, (V, 1, h, w)."""
    if rest == 0:
        return torch.zeros_like(pilot[:, :1])
    far = pairs.most
    apart = gaussian((pilot[:, far:] - pilot[:, :-far]).square().mean(1, keepdim=True), 1.2)
    gained = gaussian(apart - distance[:, pairs.far].mean(1, keepdim=True), 1.0)
    brightness = gaussian(pilot.mean(1, keepdim=True), 1.5)
    variance = gaussian(pilot.var(1, correction=0, keepdim=True), 0.75)
    return sureness(variance + TUNED.moves * gained.clamp(min=0), brightness, rest)
