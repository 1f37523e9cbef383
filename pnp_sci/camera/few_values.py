"""Measurements of one or two bits: too few values to find bad pixels."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.sensing.sensor import Sensor

FEW = 4  # values: with as few, most steps from pixel to pixel are those of the rounding
BITS = {2: 1, 4: 2}  # by the number of grey levels


def has_few_values(y: np.ndarray, weight: np.ndarray) -> bool:
    """Whether y (N,) has 2 to 4 different values, and fewer than the sums of masks, `weight`, which uniform light has.

    >>> y = np.arange(100.0)
    >>> has_few_values(np.round(3 * y / 99), y), has_few_values(y, y)
    (True, False)
    """
    return 2 <= (count := np.unique(y).size) <= FEW and count < np.unique(weight).size


def coarse(y: np.ndarray, sensor: Sensor) -> list[Finding]:
    """The finding of few values y (N,), unless the sensor says that it has as few grey levels."""
    if sensor.bits is not None and 2**sensor.bits <= FEW:
        return []
    values, hint = np.unique(y), "give it as recorded"
    if np.allclose(values, np.linspace(0, values[-1], values.size)) and values.size in BITS:
        told = f"noise=pnp_sci.Sensor(full_scale={values[-1]:.7g}, bits={BITS[values.size]})"
        hint += f"; if the camera has so few grey levels, {told}"
    return [Finding("coarse", f"y has {values.size} different values only", hint)]
