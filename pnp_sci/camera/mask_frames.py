"""What masks say, without a measurement: frames are missing or the same, views cannot be told apart."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.masks import views_are_separable
from pnp_sci.sensing.sample import some_pixels

SAME = 1e-3  # of the largest value: masks that differ less code nothing
ALIKE = 0.03  # of the energy in which independent masks differ: those of two frames with less can hardly be told apart
PIXELS = 2**14  # about, at most, of which masks are compared
CONDITION = "see pnp_sci.condition(masks)"


def lost_frames(present: np.ndarray) -> tuple[Finding, ...]:
    """The findings of masks of which some frames are all 0; `present` is (V, B)."""
    if present.all():
        return ()
    lost = "; ".join(
        f"view {v + 1}, frame{'s' * (len(b) > 1)} {', '.join(str(i + 1) for i in b)}"
        for v, b in ((v, np.flatnonzero(~row)) for v, row in enumerate(present))
        if len(b)
    )
    where = f" in {lost}" if present.any() else ""
    return (Finding("missing", f"masks are all 0{where}", "parts of their file may be missing"),)


def static_views(masks: np.ndarray) -> tuple[Finding, ...]:
    """The finding of views whose masks (V, B, H, W) are the same in all frames."""
    least = SAME * float(max(-masks.min(), masks.max()))
    same = [
        str(v)
        for v, (first, *others) in enumerate(masks, 1)
        if others and first.any() and all(np.ptp((first, other), axis=0).max() <= least for other in others)
    ]
    if not same:
        return ()
    text = f"masks of view {', '.join(same)} are the same in all frames"
    return (Finding("static", text, f"its frames cannot be told apart; {CONDITION}"),)


def lost_views(masks: np.ndarray) -> tuple[Finding, ...]:
    """The finding of masks (V, B, H, W) whose views cannot be told apart; none if all are 0."""
    if views_are_separable(masks) or not masks.any():
        return ()
    text = "masks of the views are too much alike, or those of one are all 0"
    return (Finding("views", text, f"the views cannot be told apart; {CONDITION}"),)


def repeated_frames(masks: np.ndarray) -> tuple[Finding, ...]:
    """The finding of frames with nearly the same masks (V, B, H, W), in a view or in two.

    Masks of two frames are nearly the same if they differ by less than 3 % of the energy by which they differ from the
    means of their views. Views of less than three frames, and those that never change, are not compared.
    """
    views, frames = masks.shape[:2]
    rows, columns = some_pixels(masks.shape[2:], PIXELS)
    flat = masks[..., rows, columns].reshape(views * frames, -1).astype(np.float64)
    products = np.einsum("fp,gp->fg", flat, flat)
    own = products.reshape(views, frames, views, frames)
    own = np.stack([own[v, :, v] for v in range(views)])
    squares = np.diagonal(products)
    changes = (squares.reshape(views, frames) - 2 * own.mean(1) + own.mean((1, 2), keepdims=True)[:, 0]).ravel()
    usual = changes[:, None] + changes
    differ = squares[:, None] + squares - 2 * products
    codes = changes > SAME**2 * squares.max()
    same = np.argwhere(np.triu((differ < ALIKE * usual) & codes[:, None] & codes, 1))
    if not len(same):
        return ()
    first, second = (f"view {n // frames + 1}, frame {n % frames + 1}" for n in same[0].tolist())
    more = f", and in {len(same) - 1} other pairs" if len(same) > 2 else ", and in another pair" * (len(same) - 1)
    text = f"masks are nearly the same in {first} and in {second}{more}"
    return (Finding("repeated", text, f"such frames can hardly be told apart; {CONDITION}"),)
