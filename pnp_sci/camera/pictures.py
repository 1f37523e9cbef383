"""Pictures of a calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci._optional import needed_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(calibration: Any) -> Figure:
    """Dark frame, bad pixels, brightest values, first masks, values and means, of a :class:`~pnp_sci.Calibration`."""
    with needed_for("pictures of a calibration", "plot"):
        from matplotlib.figure import Figure

    masks = calibration.masks
    pictures = {
        "dark frame": calibration.dark,
        "bad pixels": calibration.bad.astype(float),
        "brightest value of a pixel": masks.max((0, 1)),
        **{f"view {v}, frame 1": view[0] for v, view in enumerate(masks, 1)},
    }
    columns = (len(pictures) + 3) // 2
    figure = Figure((3 * columns, 6), layout="constrained")
    axes = figure.subplots(2, columns).ravel()
    for axis, (title, picture) in zip(axes, pictures.items()):
        low, high = np.percentile(picture, [0.5, 99.5])
        axis.imshow(picture, "gray", vmin=low, vmax=max(high, low + 1e-6))
        axis.set(title=title, xticks=[], yticks=[])
    values, means = axes[len(pictures) :][:2]
    for view, frames in enumerate(masks, 1):
        values.hist(frames[:, ~calibration.bad].ravel(), 80, histtype="step", label=f"view {view}")
        means.plot(np.arange(1, len(frames) + 1), frames.mean((1, 2)), "o-", label=f"view {view}")
    values.set(title="values of the masks", yticks=[])
    values.legend()
    means.set(title="mean of a frame", xlabel="frame")
    for axis in axes[len(pictures) + 2 :]:
        axis.set_axis_off()
    return figure
