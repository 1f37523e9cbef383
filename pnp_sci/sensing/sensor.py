"""What a camera makes of the light that reaches it, and what its pictures then say of that light."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pnp_sci._validate import finite_number, whole
from pnp_sci.errors import InputError

CLIPPED, FEW = 1e-3, 16  # portion and number of pixels that have the largest value of y where it was clipped
AROUND = 1.5  # pixels: width of the mean that tells how much light a pixel gets
MANY = 1e9  # electrons in a pixel: from here on their noise is normal to all digits
REACHED = 1e-6  # of the full scale: pixels as close to it as that have reached it

_log = logging.getLogger("pnp_sci")


@dataclass(frozen=True, repr=False)
class Sensor:
    """A camera: photon noise, read noise, a largest value and grey levels.

    The variance of a pixel is ``read_noise**2 + gain * y``, and a twelfth of the squared distance of two grey levels.
    A pixel at full scale says only that there was at least so much light.

    Parameters
    ----------
    read_noise : "auto" or float
        Standard deviation of the noise in the dark, in the units of y, >= 0; "auto" estimates it from each measurement.
    gain : float
        Units of y that an electron adds, >= 0; 0 is no photon noise. Needs a `read_noise` that is a number, and a y
        whose black level has been taken off.
    full_scale : float, optional
        The largest value that the camera gives, > 0, less the black level if that has been taken off y: pixels that
        reach it are saturated.
    bits : int, optional
        There are 2**bits grey levels from 0 to full scale; 1 to 32, needs `full_scale`.

    Raises
    ------
    InputError
        If a field is out of its range, or needs another one.

    Examples
    --------
    >>> camera = Sensor(read_noise=2.0, gain=0.5, full_scale=255, bits=8)
    >>> camera.saturated(np.array([[20.0, 255.0]]))
    array([[False,  True]])
    """

    read_noise: Literal["auto"] | float = "auto"
    gain: float = 0.0
    full_scale: float | None = None
    bits: int | None = None

    def __post_init__(self):
        def store(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        if not (isinstance(self.read_noise, str) and self.read_noise == "auto"):
            expected = '"auto" or a standard deviation >= 0 in the units of y'
            store("read_noise", finite_number("read_noise", self.read_noise, expected))
        store("gain", finite_number("gain", self.gain))
        if self.gain and self.read_noise == "auto":
            raise InputError('read_noise is "auto": a number was expected beside a gain, in the units of y')
        if self.full_scale is not None:
            store("full_scale", finite_number("full_scale", self.full_scale))
            if self.full_scale == 0:
                raise InputError("full_scale is 0: a number > 0 was expected")
        if self.bits is not None:
            store("bits", whole("bits", self.bits, 1))
            if self.bits > 32:
                raise InputError(f"bits is {self.bits}: a whole number from 1 to 32 was expected")
            if self.full_scale is None:
                raise InputError(
                    f"bits is {self.bits}, but full_scale is None: the value of the last level was expected"
                )

    def __repr__(self) -> str:
        return f"pnp_sci.Sensor({self.read_noise!r}, {self.gain}, {self.full_scale}, {self.bits})"

    @property
    def step(self) -> float:
        """From one grey level to the next, in the units of y; 0 without levels."""
        return self.full_scale / (2**self.bits - 1) if self.full_scale and self.bits else 0.0

    def expose(self, clean: np.ndarray, seed: int = 0) -> np.ndarray:
        """The picture (H, W), floating, that the camera takes of a measurement without noise (H, W), in its units."""
        if self.read_noise == "auto":
            raise InputError('read_noise is "auto": a number was expected, for there is no measurement to take it from')
        random = np.random.default_rng(seed)
        y = clean.astype(np.float64)
        if self.gain > 0:
            if y.min() < 0:
                raise InputError(f"gain is {self.gain}, but the measurement reaches {y.min():.3g}: >= 0 was expected")
            few = y < MANY * self.gain
            some = self.gain * random.poisson(np.divide(y, self.gain, out=np.zeros_like(y), where=few))
            many = y + np.sqrt(self.gain) * np.sqrt(y) * random.standard_normal(y.shape)
            y = np.where(few, some, many)
        y += self.read_noise * random.standard_normal(y.shape)
        if self.full_scale is not None:
            y = np.clip(y, 0, self.full_scale)
        if self.step > 0:
            y = np.round(y / self.step) * self.step
        return y.astype(np.result_type(clean, np.float32))

    def deviation(self, y: np.ndarray) -> np.ndarray | float:
        """Standard deviation of the noise of each pixel of y (H, W); one number where all have the same.

        The light of a pixel is taken from the mean around it, and to be an electron at least: by its own value, a pixel
        that happens to count little would be trusted most.
        """
        from scipy.ndimage import gaussian_filter

        assert self.read_noise != "auto", "measured() has put a number there"
        constant = float(np.hypot(self.read_noise, self.step / np.sqrt(12)))
        if self.gain == 0:
            return constant
        light = np.maximum(gaussian_filter(y.astype(np.float64), AROUND, mode="nearest"), self.gain)
        return np.hypot(constant, np.sqrt(self.gain) * np.sqrt(light))  # squares could overflow

    def saturated(self, y: np.ndarray) -> np.ndarray | None:
        """Which pixels of y are at full scale, bool (H, W); None if there are none."""
        if self.full_scale is None:
            return None
        reached = y >= self.full_scale * (1 - REACHED) - self.step / 2
        return reached if reached.any() else None


def warn_if_saturated(noise: Any, measurements: np.ndarray) -> None:
    """Log a warning if one of the measurements (N, H, W) looks saturated, and `noise` does not speak of the camera."""
    if not isinstance(noise, Sensor) and any(map(looks_saturated, measurements)):
        _log.warning(
            "y has many pixels at exactly its largest value: if the camera was saturated there, say so with "
            "noise=pnp_sci.Sensor(full_scale=...)"
        )


def looks_saturated(y: np.ndarray) -> bool:
    """Whether y (H, W) piles up at its largest value: a thousandth of it is there, and more than in the 2 % below."""
    highest = y.max()
    there, near = np.count_nonzero(y == highest), np.count_nonzero(y >= 0.98 * highest)
    return bool(highest > 0 and there >= max(CLIPPED * y.size, FEW) and near < 2 * there < y.size)
