"""Simulation of measurements."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._validate import finite_number, positive_number, real_array, require_finite, whole
from pnp_sci.errors import InputError
from pnp_sci.io import read_video
from pnp_sci.sensing.mosaic import Mosaic, check_cells
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import check_bad
from pnp_sci.sensing.sensor import Sensor, check_bits

_log = logging.getLogger("pnp_sci")


def simulate(
    video: Any,
    masks: Any,
    noise: float | Sensor = 0.0,
    seed: int = 0,
    bits: int | None = None,
    peak: float | None = None,
    bad: Any = None,
    mosaic: str | None = None,
) -> np.ndarray:
    """Simulate the measurement of a video through masks, with noise and quantisation.

    ``y = Phi x + noise * peak * n`` with n standard normal, the noise protocol of the OFaNet paper. If `bits` is given,
    y is then clipped to [0, peak] and rounded to 2**bits levels. A :class:`~pnp_sci.Sensor` as `noise` models the
    camera instead.

    Parameters
    ----------
    video : array_like, (V, B, H, W) or (B, H, W), or a path
        In any units, which are those of the measurement. The planes of a file are divided among the views of `masks`.
        With `mosaic` it is in colour, with another axis of 3 at the end.
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
    noise : float or Sensor
        Standard deviation of the noise relative to `peak`, >= 0; or the camera, in the units of the measurement.
    seed : int
        Random seed of the noise, >= 0.
    bits : int, optional
        Bits of the camera, 1 to 32; by default no rounding. Not beside a Sensor.
    peak : float, optional
        Full scale of the camera, in units of the measurement, > 0. By default the largest value of the noise-free
        measurement. Not beside a Sensor.
    bad : array_like of bool, (H, W), optional
        Dead pixels, which read 0. For hot ones, assign their values to the result.
    mosaic : "RGGB", "BGGR", "GRBG" or "GBRG", optional
        The sensor's colour filters, from its first two pixels in the first row and in the second.

    Returns
    -------
    ndarray of float32 or float64, (H, W)

    Raises
    ------
    InputError, InputTypeError
        If `video` and `masks` differ in shape, an argument is out of its range, or the measurement is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> float(simulate(np.ones((2, 3, 4, 5)), np.ones((2, 3, 4, 5)), bits=8).max())
    6.0
    """
    if isinstance(noise, Sensor):
        if (bits, peak) != (None, None):
            raise InputError(f"bits is {bits}, peak is {peak}: neither was expected beside a Sensor, which has its own")
    else:
        noise = finite_number("noise", noise, "a Sensor or a finite number >= 0")
        if noise > 1:
            told = "noise is %g times the largest value of y: Sensor(read_noise=%g) is noise in the units of y"
            _log.warning(told, noise, noise)
    bits, peak = check_bits(bits), None if peak is None else positive_number("peak", peak)
    seed = whole("seed", seed, 0)
    op = SensingOperator(masks)
    colours = () if mosaic is None else (3,)
    from_file = isinstance(video, (str, Path))
    x = read_video(video, op.shape[0], None, bool(colours)) if from_file else real_array("video", video)
    x = x[None] if x.ndim == 3 + len(colours) else x
    if x.shape != (*op.shape, *colours):
        expected = f"{(*op.shape, *colours)} in colour" if colours else "the same"
        raise InputError(f"video has shape {x.shape}, but masks {op.shape}: {expected} was expected")
    if mosaic is not None:
        check_cells("video", op.shape)
        x = Mosaic(mosaic).sample(x)
    require_finite("video", x)
    y = op.forward(x)
    dead = check_bad(bad, y)
    if not isinstance(noise, Sensor):
        highest = float(y.max()) if peak is None else peak
        levels = (highest, bits) if bits is not None and highest > 0 else (None, None)
        noise = Sensor(abs(noise * highest), 0.0, *levels)
    with np.errstate(over="ignore"):
        y = noise.expose(y, seed)
    require_finite("the measurement", y, "; a smaller noise, peak or video, or masks in float64")
    return y if dead is None else np.where(dead[0], y.dtype.type(0), y)
