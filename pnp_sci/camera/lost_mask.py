"""Whether a mask before the first or after the last one is missing, of masks that move by the same step each frame."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.sensing.light import light_of_frames
from pnp_sci.sensing.operator import SensingOperator

SIDE = 512  # pixels of the central part, at most, that is looked at
MOVED = 0.1  # of the variance of a mask: as little must remain of it if the one before, moved, is subtracted
SEEN = 0.75  # light of an exposed frame, at least, in units of the mean of its view; others have less than 1 - SEEN


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
    for before, mask in pairwise(central.astype(np.float32)):
        rest = mask - np.roll(before, step, (0, 1))
        if not inside.any() or np.mean(np.square(rest), where=inside) > MOVED * np.var(mask, where=inside):
            return None
    return step if step.any() else None


def lost_at_an_end(masks: np.ndarray, steps: list[np.ndarray], y: np.ndarray, good: np.ndarray) -> list[Finding]:
    """The finding of a mask that is missing before or after masks (V, B, H, W), which move by the steps of their views.

    The two masks that would follow are known from the step. The light of each frame, theirs included, is estimated from
    the good pixels of y (H, W): that of the next one is 0, unless it was exposed. That of the one after it is 0 in any
    case, or y does not tell.
    """
    masks, y, good = _middle(masks), _middle(y), _middle(good)
    reach = 2 * np.abs(steps).max(0)
    for end, forwards in (("last", 1), ("first", -1)):
        frames = masks[:, ::forwards]
        following = [
            np.stack([np.roll(v[-1], n * forwards * step, (0, 1)) for v, step in zip(frames, steps)]) for n in (1, 2)
        ]
        op = SensingOperator(np.concatenate([frames, np.stack(following, 1)], 1))
        *_, next_one, control = light_of_frames(op, y, good & _inside(y.shape, reach))[..., 0, 0].T
        if np.any((next_one > SEEN) & (control < 1 - SEEN)):
            where = {"last": "after the last", "first": "before the first"}[end]
            hint = "give the masks of all frames: their file, or the part that is read, may lack one"
            return [Finding("missing", f"y follows one more mask, {where} one", hint)]
    return []


def _middle(pictures: np.ndarray) -> np.ndarray:
    """The central part of pictures (..., H, W)."""
    rows, columns = (slice(max(n - SIDE, 0) // 2, max(n - SIDE, 0) // 2 + SIDE) for n in pictures.shape[-2:])
    return pictures[..., rows, columns]


def _inside(size: tuple[int, ...], reach: np.ndarray) -> np.ndarray:
    """Pixels of a picture of this size that are farther from its sides than the reach in rows and columns, bool."""
    inside = np.zeros(size, bool)
    down, right = np.abs(reach)
    inside[down : size[0] - down, right : size[1] - right] = True
    return inside
