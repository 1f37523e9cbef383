"""What the decoders share: networks by name, and measurements in the units that they are trained for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from ofanet_init import files as _weights
from ofanet_init.places import placed, places, taken
from pnp_sci._tuned import Tuned
from pnp_sci.accel.inference import ready
from pnp_sci.errors import InputError
from pnp_sci.pipeline.blend import TUNED as BLEND
from pnp_sci.sensing.problem import Problem


@dataclass(frozen=True)
class DecoderNumbers(Tuned):
    """Scaling from the problem's units to those of the network."""

    brightness: float = 0.8  # value of the problem's unit in units of the training clips, in which white is 1


TUNED = DecoderNumbers()

WEAKEST = 0.05  # light of a view beside the brightest one, below which y does not tell its frames
EMPTY = 0.5  # largest part of a network's places without a frame: what it decodes with more is far from the scene


def trained(model: str, views: int, frames: int, device: torch.device) -> Any:
    """The network `model` of this package for V and B, or the smallest for more frames, ready on a device.

    Raises
    ------
    InputError
        If no network has so many places, at least half of which are taken then.
    """
    sizes, count = _weights.sizes(model), views * frames
    fitting = [size for size in sizes if places((views, frames), *size) and count >= (1 - EMPTY) * math.prod(size)]
    if not fitting:
        known = ", ".join("{} x {}".format(*size) for size in sizes)
        title = _weights.MODELS[model][0].title
        raise InputError(
            f"masks has {views} x {frames} frames: {title} has weights for {known or 'none'} (views x frames), "
            f"which serve down to half as many frames; "
            f"others can be trained with 'python -m ofanet_init.train --model {model}'"
        )
    return _loaded(model, *min(fitting, key=math.prod), device)


@cache
def _loaded(model: str, views: int, frames: int, device: torch.device) -> Any:
    return ready(_weights.load(_weights.place(model, views, frames), model)[0], device)


def network_for(model: str, problem: Problem, device: torch.device) -> Any:
    """The network `model` for a problem.

    Raises
    ------
    InputError
        If no network fits so many views and frames, or masks are negative by more than noise.
    """
    if problem.op.signed:
        raise InputError("masks has negative values: learned decoders need masks >= 0")
    return trained(model, *problem.op.shape[:2], device)


def tensors(
    problem: Problem, network: Any, device: torch.device, rows: slice = slice(None)
) -> tuple[torch.Tensor, torch.Tensor]:
    """Measurement (1, H, W) and masks (1, V, B, H, W), or some rows of them, in the units of the training clips.

    V and B are those of the network. The largest mask value of each view is 1, unless it is nearly dark. Unlit pixels
    have the measurement and the masks of the nearest lit ones: no network was trained to see dark regions, and what it
    makes of them may explode.
    """
    largest = _largest(problem)
    y, coded = _lit(problem, rows)
    coded = np.maximum(coded.astype(np.float32) / largest, 0)
    masks = torch.from_numpy(placed(coded, network.config.views, network.config.frames))[None]
    y = torch.from_numpy((y * (TUNED.brightness / largest.max())).astype(np.float32))[None]
    return y.to(device), masks.to(device)


def _lit(problem: Problem, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    """Some rows of y (H, W) and of the masks (V, B, H, W), at unlit pixels those of the nearest lit one."""
    unlit = problem.op.unlit
    if not unlit.any() or unlit.all():
        return problem.y[rows], problem.op.masks[:, :, rows]
    nearest: Any = distance_transform_edt(unlit, return_distances=False, return_indices=True)
    i, j = nearest[:, rows]
    return problem.y[i, j], problem.op.masks[:, :, i, j]


def in_units_of(problem: Problem, video: torch.Tensor) -> np.ndarray:
    """A network's video (1, V, B, H, W) as an array (V, B, H, W) in the problem's units, with its frames only."""
    views, frames = problem.op.shape[:2]
    own = taken(video[0].float().cpu().numpy(), (views, frames))
    largest = _largest(problem)
    return (own * (largest.max() / (TUNED.brightness * largest))).astype(problem.op.dtype)


def _largest(problem: Problem) -> np.ndarray:
    """The largest mask value of each view, (V, 1, 1, 1); of views that are nearly dark that of all views."""
    largest = problem.op.masks.max((1, 2, 3), keepdims=True).astype(np.float32)
    top = largest.max() or np.float32(1)
    return np.where(largest < WEAKEST * top, top, largest)


def projected(problem: Problem, video: np.ndarray) -> np.ndarray:
    """Project a video (V, B, H, W) onto those that measure y, as far as the noise allows."""
    return problem.op.project(video, problem.y, (problem.typical_noise / BLEND.loud) ** 2)
