"""What the frames of masks say, without a measurement: some are missing, or all are the same."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.fit import Finding

SAME = 1e-3  # of the largest value: masks that differ less code nothing


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
    return (Finding("static", text, "its frames cannot be told apart; see pnp_sci.condition(masks)"),)
