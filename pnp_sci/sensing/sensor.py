"""The camera model: noise, saturation and quantisation of a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pnp_sci._validate import finite_number, whole
from pnp_sci.errors import InputError

AROUND = 1.5  # pixels: standard deviation of the Gaussian mean that estimates the light of a pixel
MANY = 1e9  # electrons per pixel from which photon noise is drawn from a normal distribution
REACHED = 1e-6  # of the full scale: tolerance of the saturation test


@dataclass(frozen=True, repr=False)
class Sensor:
    """A camera: photon noise, read noise, full scale and grey levels.

    The variance of a pixel is ``read_noise**2 + gain * y + step**2 / 12``, where `step` is the distance between two
    grey levels. For a pixel at full scale, y is a lower bound of the light.

    Parameters
    ----------
    read_noise : "auto" or float
        Standard deviation of the noise in the dark, in the units of y, >= 0; "auto" estimates it from each measurement.
    gain : float
        Units of y per electron, >= 0; with 0 there is no photon noise. It needs a number as `read_noise`, and a y from
        which the black level has been subtracted.
    full_scale : float, optional
        Largest value of the camera, > 0, without the black level if that has been subtracted from y. Pixels that reach
        it are saturated.
    bits : int, optional
        The camera has 2**bits grey levels from -`black_level` to full scale; 1 to 32, needs `full_scale`.
    black_level : float
        What has been subtracted from y, >= 0: the grey levels begin that much below 0.

    Raises
    ------
    InputError, InputTypeError
        If a field is out of its range or of a wrong type, or needs another field.

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
    black_level: float = 0.0

    def __post_init__(self):
        def store(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        if not (isinstance(self.read_noise, str) and self.read_noise == "auto"):
            expected = '"auto" or a standard deviation >= 0 in the units of y'
            store("read_noise", finite_number("read_noise", self.read_noise, expected))
        store("gain", finite_number("gain", self.gain))
        store("black_level", finite_number("black_level", self.black_level))
        if self.gain and self.read_noise == "auto":
            raise InputError('read_noise is "auto": a number was expected beside a gain, in the units of y')
        if self.full_scale is not None:
            store("full_scale", finite_number("full_scale", self.full_scale))
            if self.full_scale == 0:
                raise InputError("full_scale is 0: a number > 0 was expected")
        if self.bits is not None:
            store("bits", check_bits(self.bits))
            if self.full_scale is None:
                raise InputError(
                    f"bits is {self.bits}, but full_scale is None: the value of the last level was expected"
                )

    def __repr__(self) -> str:
        black = f", {self.black_level}" if self.black_level else ""
        return f"pnp_sci.Sensor({self.read_noise!r}, {self.gain}, {self.full_scale}, {self.bits}{black})"

    @property
    def step(self) -> float:
        """Distance between two grey levels in the units of y; 0 without quantisation."""
        return (self.full_scale + self.black_level) / (2**self.bits - 1) if self.full_scale and self.bits else 0.0

    def expose(self, clean: np.ndarray, seed: int = 0) -> np.ndarray:
        """Add noise to a noise-free measurement `clean` (H, W), then clip and quantise it.

        Returns
        -------
        ndarray of float32 or float64, (H, W)

        Raises
        ------
        InputError
            If `read_noise` is "auto", or `clean` has negative values and there is a gain.
        """
        if self.read_noise == "auto":
            raise InputError('read_noise is "auto": a number was expected, as there is no measurement to estimate from')
        random = np.random.default_rng(whole("seed", seed, 0))
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
            y = np.clip(y, -self.black_level, self.full_scale)
        if self.step > 0:
            y = np.round((y + self.black_level) / self.step) * self.step - self.black_level
        return y.astype(np.result_type(clean, np.float32))

    def deviation(self, y: np.ndarray) -> np.ndarray | float:
        """Standard deviation of the noise of each pixel of y (H, W); one number if it is equal for all pixels.

        The light of a pixel is estimated by a local mean, and is at least one electron. The value of the pixel itself
        would bias the estimate: pixels with few counts would have too large a weight.
        """
        from scipy.ndimage import gaussian_filter

        assert self.read_noise != "auto", "measured() has put a number there"
        constant = float(np.hypot(self.read_noise, self.step / np.sqrt(12)))
        if self.gain == 0:
            return constant
        light = np.maximum(gaussian_filter(y.astype(np.float64), AROUND, mode="nearest"), self.gain)
        return np.hypot(constant, np.sqrt(self.gain) * np.sqrt(light))  # the product of the squares could overflow

    def saturated(self, y: np.ndarray) -> np.ndarray | None:
        """Whether each pixel of y (H, W) is at full scale, bool (H, W); None if no pixel is."""
        if self.full_scale is None:
            return None
        reached = y >= self.full_scale * (1 - REACHED) - self.step / 2
        return reached if reached.any() else None


def check_bits(bits: Any) -> int | None:
    """`bits` as a whole number from 1 to 32, or None."""
    if bits is not None and whole("bits", bits, 1) > 32:
        raise InputError(f"bits is {bits}: a whole number from 1 to 32 was expected")
    return None if bits is None else int(bits)
