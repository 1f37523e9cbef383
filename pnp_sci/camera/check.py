"""Does a measurement fit its masks? Asked before anything is solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pnp_sci._validate import true_or_false
from pnp_sci.camera.fit import Finding, Fit
from pnp_sci.camera.fitting import Masks
from pnp_sci.camera.frame_order import frame_order as order_of_frames
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import check_bad, check_measurement, check_noise, check_operators
from pnp_sci.sensing.sensor import Sensor


def check_fit(y: Any, masks: Any, *, noise: Any = "auto", bad: Any = None, frame_order: bool = False) -> Any:
    """Check whether a measurement and its masks belong together: in less than a second for 2 x 10 frames of 256 x 256.

    Parameters
    ----------
    y : array_like, (H, W) or (N, H, W)
        The measurement, in any unit, or N of them.
    masks : array_like, (V, B, H, W), (B, H, W) or (N, V, B, H, W), or SensingOperator
    noise : "auto", float or Sensor
        A :class:`~pnp_sci.Sensor` says where the camera is saturated.
    bad : "auto" or array_like of bool, (H, W), optional
        Pixels that are not used; "auto" leaves out values that are not finite. Masked values of a NumPy masked array y
        are bad, too.
    frame_order : bool
        Whether to look also if the frames of the masks are in the order of time. It takes seconds, and needs several
        successive measurements: a single one is explained by reversed masks as well, by a film that runs backwards.

    Returns
    -------
    Fit, or list of Fit
        One for each of N measurements.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used.

    Notes
    -----
    The sum of a view's masks varies from pixel to pixel by the coding pattern only, which no scene follows. The part of
    y that follows this pattern therefore belongs to the masks. Its amount, its position and its sign tell whether they
    fit; standard errors come from the spread over blocks of pixels.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.check_fit(scene.y, scene.masks).ok
    True
    >>> print(pnp_sci.check_fit(scene.y, scene.masks[:, :, ::-1]).warnings[0])
    y does not follow the masks, but it follows them upside down: give the masks so
    """
    true_or_false("frame_order", frame_order)
    bad = check_bad(bad, y)
    measurements = check_measurement(y, bad)
    ops, _ = check_operators(masks, measurements)
    fits = check_all(ops, measurements, check_noise(noise), bad)
    if frame_order:
        if len(ops) > 1:
            raise InputError("frame_order needs masks (V, B, H, W) for all measurements, but each has its own")
        order = order_of_frames(ops[0], measurements, check_noise(noise))
        fits = [_with_order(fit, order) for fit in fits]
    return fits if np.ndim(y) == 3 else fits[0]


def check_all(
    ops: Sequence[SensingOperator],
    measurements: np.ndarray,
    sensor: Sensor,
    bad: np.ndarray | None,
    warn_of_bad: bool = True,
) -> list[Fit]:
    """How each of the measurements (N, H, W) fits its masks: `ops` has one operator for all, or one for each.

    `bad` is (N, H, W) or None.
    """
    with np.errstate(all="ignore"):  # extreme numbers make no rule true
        each = map(Masks, ops) if len(ops) > 1 else [Masks(ops[0])] * len(measurements)
        return [
            masks.fit(y, sensor, None if bad is None else bad[n], warn_of_bad)
            for n, (masks, y) in enumerate(zip(each, measurements))
        ]


def _with_order(fit: Fit, order: str) -> Fit:
    """The fit, with what is known of the order of the frames."""
    backwards = Finding("frame order", "successive measurements run backwards", "reverse the frames: masks[:, ::-1]")
    return replace(fit, frame_order=order, findings=fit.findings + (backwards,) * (order == "reversed"))
