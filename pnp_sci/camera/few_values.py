"""Measurements of one or two bits, whose values tell nothing of single pixels."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.sensing.sensor import Sensor

FEW = 4  # values: with as few, most steps from pixel to pixel are those of the rounding


def has_few_values(y: np.ndarray, weight: np.ndarray) -> bool:
    """Whether y (N,) has 2 to 4 different values, and fewer than the sums of masks, `weight`, which uniform light has.

    >>> y = np.arange(100.0)
    >>> has_few_values(np.round(3 * y / 99), y), has_few_values(y, y)
    (True, False)
    """
    return 2 <= (count := np.unique(y).size) <= FEW and count < np.unique(weight).size


def coarse(y: np.ndarray, sensor: Sensor) -> list[Finding]:
    """The finding of few values y (N,), unless the sensor says that it has grey levels."""
    if sensor.step > 0:
        return []
    count, top = np.unique(y).size, float(y.max())
    told = f"noise=pnp_sci.Sensor(full_scale={top:.7g}, bits={1 if count == 2 else 2})"
    hint = f"give it as recorded; if the camera has so few grey levels, {told}" if top > 0 else "give it as recorded"
    return [Finding("coarse", f"y has {count} different values only", hint)]
