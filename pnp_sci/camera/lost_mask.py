"""Whether a mask before the first or after the last one is missing, of masks that move by the same step each frame."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.sensing.light import light_of_frames
from pnp_sci.sensing.operator import SensingOperator

SIDE = 512  # pixels of the central part, at most, that is looked at
MOVED = 0.1  # largest part of a mask's variance that may be left of it without the previous mask, moved
LIT = 0.75  # light of an exposed frame, at least, in units of the mean one: 1.0 to 1.24 in 12 clips without one mask
DARK = 0.25  # light of a frame that was not exposed, at most; 0.05 in these clips


def step_of(masks: np.ndarray) -> np.ndarray | None:
    """The step in rows and columns by which masks (B, H, W) move from frame to frame; None if they do not.

    Examples
    --------
    >>> import pnp_sci
    >>> step_of(pnp_sci.moving_masks((1, 4, 32, 32), step=(2, -1))[0]).tolist()
    [2, -1]
    """
    if len(masks) < 2:
        return None
    central = _middle(masks)
    first, second = (np.fft.rfft2(mask - mask.mean()) for mask in central[:2].astype(np.float64))
    size = central.shape[1:]
    alike = np.fft.irfft2(second * first.conj(), size)
    half = np.array(size) // 2
    step = (np.array(np.unravel_index(alike.argmax(), size)) + half) % size - half
    inside = _inside(size, step)
    if not step.any() or not inside.any():
        return None
    for before, mask in pairwise(central.astype(np.float32)):
        rest = mask - np.roll(before, step, (0, 1))
        if np.mean(np.square(rest), where=inside) > MOVED * np.var(mask, where=inside):
            return None
    return step


def lost_at_an_end(masks: np.ndarray, steps: Sequence[Any], y: np.ndarray, good: np.ndarray) -> list[Finding]:
    """The finding of a mask that is missing before or after masks (V, B, H, W), which move by the steps of their views.

    The two masks that would follow are known from the step. The light of each frame, theirs included, is estimated from
    the good pixels of y (H, W). The next one is dark, unless it was exposed. The one after it must be dark, or y does
    not tell. The frame at the other end must be lit: if not, all masks are there, and are off by one step.
    """
    masks, y, good = _middle(masks), _middle(y), _middle(good)
    reach = 2 * np.abs(steps).max(0)
    for where, forwards in (("after the last", 1), ("before the first", -1)):
        frames = masks[:, ::forwards]
        following = [
            np.stack([np.roll(v[-1], n * forwards * step, (0, 1)) for v, step in zip(frames, steps)]) for n in (1, 2)
        ]
        op = SensingOperator(np.concatenate([frames, np.stack(following, 1)], 1))
        opposite, *_, after, control = light_of_frames(op, y, good & _inside(y.shape, reach))[..., 0, 0].T
        if np.any((after > LIT) & (control < DARK) & (opposite > DARK)):
            hint = "give the masks of all frames: their file, or the part that is read, may lack one"
            return [Finding("missing", f"y follows one more mask, {where} one", hint)]
    return []


def _middle(pictures: np.ndarray) -> np.ndarray:
    """The central part of pictures (..., H, W)."""
    top, left = (max(n - SIDE, 0) // 2 for n in pictures.shape[-2:])
    return pictures[..., top : top + SIDE, left : left + SIDE]


def _inside(size: tuple[int, ...], reach: np.ndarray) -> np.ndarray:
    """Pixels of a picture of this size that are farther from its sides than the reach in rows and columns, bool."""
    inside = np.zeros(size, bool)
    down, right = np.abs(reach)
    inside[down : size[0] - down, right : size[1] - right] = True
    return inside
