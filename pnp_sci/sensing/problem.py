"""Validation of a measurement, and its scaling to units in which the video spans about [0, 1]."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import finite_number, one_of, real_array, require_finite
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.light import light_of_frames
from pnp_sci.sensing.noise import estimate_noise
from pnp_sci.sensing.operator import SensingOperator, as_masks
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor
from pnp_sci.sensing.sequence import joined

NEAR = (1.5, 6, 24, 96)  # pixels: standard deviations of the Gaussian means that fill unlit pixels
CLOSED = 1e-3  # of the largest weight: smaller means of neighbours are not used
LOUDEST = 1e6  # of max |y|: upper bound of the noise, whose square must be finite
OF_FRAMES = ("unit", "light")  # fields of a problem that have no pixels


@dataclass(frozen=True)
class UnitNumbers(Tuned):
    """Parameters of the estimate of the video's unit."""

    brighter: float = 0.001  # part of the pixels in which y over the sum of the masks is above 1
    width: float = 1.5  # pixels: standard deviation of the Gaussian that smooths y and the sum


TUNED = UnitNumbers()


@dataclass(frozen=True, eq=False)
class Problem:
    """A measurement in the solver's units.

    Attributes
    ----------
    op : SensingOperator
    y : ndarray, (H, W), or (N, H, W) of consecutive measurements
        In units where x spans about [0, 1].
    unit : float or ndarray, (V, B, 1, 1)
        Value of x in the user's units that corresponds to 1 here; of each frame if :meth:`steady` is.
    noise : float or ndarray, like y
        Standard deviation of the noise of `y`, in its units; an array if it differs between pixels.
    saturated : ndarray of bool, like y, optional
        Pixels in which y is only a lower bound of the light.
    bad : ndarray of bool, like y, optional
        Pixels in which nothing is known of the light: y and all masks are 0.
    balance : ndarray, (H, W), optional
        What the masks of each pixel of a mosaic were multiplied by, > 0.
    estimated : bool
        Whether `noise` was estimated from y, so that texture makes it too large.
    light : ndarray, (V, B, 1, 1), optional
        How bright each frame is lit, in units of the mean of its view, where that was found to differ.
    """

    op: SensingOperator
    y: np.ndarray
    unit: float | np.ndarray
    noise: float | np.ndarray
    saturated: np.ndarray | None = None
    bad: np.ndarray | None = None
    balance: np.ndarray | None = None
    estimated: bool = False
    light: np.ndarray | None = None

    @property
    def usable(self) -> np.ndarray:
        """Pixels that are neither saturated nor bad, like y."""
        usable = np.ones(self.y.shape, bool)
        for unknown in (self.saturated, self.bad):
            if unknown is not None:
                usable &= ~unknown
        return usable

    @property
    def typical_noise(self) -> float:
        """Root mean square of `noise` over the usable pixels."""
        noise = np.asarray(self.noise)
        if noise.ndim and self.usable.any():
            noise = noise[self.usable]
        return float(np.sqrt(np.mean(np.square(noise))))

    def unbalanced(self) -> Problem:
        """The problem of the same video with the masks as they were given."""
        if self.balance is None:
            return self
        op = SensingOperator(self.op.masks / self.balance, self.op.dtype)
        return replace(self, op=op, y=self.y / self.balance, noise=self.noise / self.balance, balance=None)

    def steady(self) -> Problem:
        """The problem of the video in steady light: masks times light, which a prior that compares frames needs."""
        if self.light is None or np.ndim(self.unit):
            return self
        op = SensingOperator(self.op.masks * self.light.astype(self.op.dtype), self.op.dtype)
        return replace(self, op=op, unit=self.unit * self.light)

    def scaled(self, factor: float) -> Problem:
        """The problem in a unit that is larger by a factor."""
        return replace(self, y=self.y / self.y.dtype.type(factor), unit=self.unit * factor, noise=self.noise / factor)

    def crop(self, where: tuple[slice, slice]) -> Problem:
        """The problem of a part of the picture, rows and columns."""
        pictures = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in OF_FRAMES}
        cropped = {name: p[(..., *where)] for name, p in pictures.items() if isinstance(p, np.ndarray)}
        return replace(self, op=self.op.crop(where), **cropped)


def check_measurement(y: Any, bad: np.ndarray | None = None) -> np.ndarray:
    """Return y as an array (N, H, W) of native byte order, 0 in its masked values and in the `bad` pixels (N, H, W).

    Raises
    ------
    InputError, InputTypeError
        If y is not (H, W) or (N, H, W), is empty, or has values that are not finite real numbers.
    """
    array = _pictures(np.ma.filled(y, 0) if isinstance(y, np.ma.MaskedArray) else y)
    if bad is not None:
        array = np.where(bad.reshape(array.shape), array.dtype.type(0), array)
    hint = '; in solve, bad="auto" leaves such pixels out, as does bad=, a picture (rows, columns) that is True there'
    require_finite("y", array, hint)
    if array.dtype == np.longdouble:
        with np.errstate(over="ignore"):
            require_finite("y", array.astype(np.float64), hint)
    return array if array.ndim == 3 else array[None]


def _pictures(y: Any) -> np.ndarray:
    """y as an array (H, W) or (N, H, W)."""
    array = real_array("y", y)
    if array.ndim not in (2, 3) or array.size == 0:
        raise InputError(f"y has shape {array.shape}: (rows, columns) or (measurements, rows, columns) was expected")
    return array


def check_bad(bad: Any, y: Any) -> np.ndarray | None:
    """The pixels of each measurement that are not used, bool (N, H, W): `bad` (H, W) or like y, masked values of y.

    None if there are none. "auto" stands for values that are masked or not finite: the others are still to be found.

    Raises
    ------
    InputError, InputTypeError
        If `bad` is no picture of True and False as large as y, or no pixel is left.
    """
    if isinstance(bad, str):
        one_of("bad", bad, ("auto",), " or a picture that is True in the bad pixels")
    if bad is None and not np.ma.is_masked(y):
        return None
    pictures = _pictures(y.data if isinstance(y, np.ma.MaskedArray) else y)
    shape = pictures.shape if pictures.ndim == 3 else (1, *pictures.shape)
    unused = (np.zeros(pictures.shape, bool) | np.ma.getmask(y)).reshape(shape)
    if isinstance(bad, str):
        unused |= ~np.isfinite(pictures).reshape(shape)
    elif bad is not None:
        picture = real_array("bad", bad)
        if picture.dtype.kind == "f":
            raise InputTypeError(f"bad has dtype {picture.dtype}: True and False, or whole numbers, were expected")
        if picture.shape not in (shape[1:], np.shape(y)):
            expected = f"{shape[1:]}, or the same as y, was expected"
            raise InputError(f"bad has shape {picture.shape}, but y {np.shape(y)}: {expected}")
        unused |= picture.astype(bool)
    if not unused.any():
        return None
    if unused.all((1, 2)).any():
        raise InputError("bad has every pixel of y: some that are used were expected")
    return unused


def without(op: SensingOperator, bad: np.ndarray) -> SensingOperator:
    """The operator that measures nothing in the bad pixels (H, W): its masks are 0 there."""
    return SensingOperator(op.masks * (~bad).astype(op.masks.dtype), op.dtype) if bad.any() else op


def check_operators(masks: Any, y: np.ndarray) -> tuple[list[SensingOperator], float]:
    """As :func:`check_operator`, for the masks of all measurements or, (N, V, B, H, W), of each: one or N operators."""
    array = masks.masks if isinstance(masks, SensingOperator) else real_array("masks", masks)
    if array.ndim != 5:
        op, largest = check_operator(array, y)
        return [op], largest
    if len(array) != len(y):
        raise InputError(
            f"masks has shape {array.shape}, but y has {len(y)} measurements: (views, frames, rows, columns) for all, "
            "or as many such sets as there are measurements, were expected"
        )
    count, views, *others = array.shape
    op, largest = check_operator(array.reshape(count * views, *others), y)
    return [SensingOperator(own, op.dtype) for own in np.split(op.masks, count)], largest


def check_operator(masks: Any, y: np.ndarray) -> tuple[SensingOperator, float]:
    """The operator of the masks divided by their largest magnitude, and that magnitude (1 for uint8 and bool masks).

    Raises
    ------
    InputError, InputTypeError
        If the masks cannot be used, or their rows and columns differ from those of y (N, H, W).
    """
    dtype = np.dtype(np.float64 if y.dtype == np.float64 else np.float32)
    masks = as_masks(masks)
    check_pixels(masks, y)
    largest = 1.0 if masks.dtype == np.uint8 else float(max(-masks.min(), masks.max())) or 1.0
    if largest != 1.0:
        masks = masks / masks.dtype.type(largest)
    return SensingOperator(masks, dtype), largest


def check_pixels(masks: np.ndarray, y: np.ndarray) -> None:
    """Raise an InputError if masks (V, B, H, W) and measurements y (N, H, W) differ in rows and columns."""
    views, frames, rows, columns = masks.shape
    if (rows, columns) == y.shape[1:]:
        return
    if (rows, columns) == y.shape[:2]:
        expected = "(rows, columns) or (measurements, rows, columns), rows and columns last, was expected"
        raw = "; of a sensor with colour filters the raw picture, and mosaic=" if y.shape[2] == 3 else ""
        raise InputError(f"y has shape {y.shape}: {expected}{raw}")
    raise InputError(
        f"masks has {views} x {frames} frames of {rows} x {columns}, but y is {y.shape[1]} x {y.shape[2]}: "
        "the last two dimensions must agree"
    )


def pose(op: SensingOperator, largest: float, y: np.ndarray, sensor: Sensor, bad: np.ndarray | None = None) -> Problem:
    """The problem of one measurement y (H, W); `largest` is the divisor of the masks, which are 0 in `bad` pixels.

    Raises
    ------
    InputError
        If the video's unit overflows the operator's dtype.
    """
    y = y.astype(np.float64)
    if bad is not None:
        y[bad] = 0
    saturated = sensor.saturated(y)
    height = float(np.abs(y).max()) or 1.0
    used = np.ones(y.shape, bool)
    for unused in (saturated, bad):
        if unused is not None:
            used[unused] = False
    light = light_of_frames(op, y / height, used)
    estimated, sensor = sensor.read_noise == "auto", measured(sensor, op, y, bad, light)
    sigma = np.minimum(sensor.deviation(y) / height, LOUDEST)
    y /= height
    unit = brightest(op, y, float(np.mean(sigma)))
    x_unit = unit * height / largest
    if x_unit > float(np.finfo(op.dtype).max):
        raise InputError(
            f"y reaches {height:.3g} and masks {largest:.3g}: their quotient overflows {op.dtype}"
            + ("; give y as float64" if op.dtype == np.float32 else "")
        )
    noise = sigma / unit if np.ndim(sigma) else float(sigma / unit)
    told = None if (light == 1).all() else light
    return Problem(op, (y / unit).astype(op.dtype), x_unit, noise, saturated, bad, estimated=estimated, light=told)


def brightest(op: SensingOperator, y: np.ndarray, noise: float) -> float:
    """Estimate of the largest value of the video: the unit in which it spans about [0, 1].

    If the masks have mostly one sign, the estimate is the 0.999 quantile of y divided by their sum, both smoothed. It
    is 0.7 to 1.0 of the true value on natural scenes.

    If the masks cancel each other, the estimate is the unit in which y has its expected energy. For videos of mean 1/2
    and standard deviation 1/4 this is ``mean(S^2 / 4 + gram / 16)``, where S is the sum of the masks.
    """
    from scipy.ndimage import gaussian_filter

    total, gram = op.masks.sum((0, 1), dtype=np.float64), op.gram.astype(np.float64)
    if np.sum(total**2) >= np.sum(gram):
        below = gaussian_filter(total, TUNED.width, mode="nearest")
        open_pixels = np.abs(below) > 0.5 * np.median(np.abs(below))
        if open_pixels.any():
            mean = np.abs(gaussian_filter(y, TUNED.width, mode="nearest")[open_pixels] / below[open_pixels])
            return float(np.quantile(mean, 1 - TUNED.brighter)) or 1.0
    energy = max(float(np.mean(y**2)) - noise**2, 0.01 * float(np.mean(y**2)))
    expected = float(np.mean(total**2 / 4 + gram / 16))
    return float(np.sqrt(energy / expected)) if energy > 0 and expected > 0 else 1.0


def measured(
    sensor: Sensor,
    op: SensingOperator,
    y: np.ndarray,
    bad: np.ndarray | None = None,
    light: np.ndarray | None = None,
) -> Sensor:
    """The sensor, with its read noise estimated from a measurement y (H, W) if it is "auto"."""
    if sensor.read_noise != "auto":
        return sensor
    y = y.astype(np.float64)
    height = float(np.abs(y).max()) or 1.0
    # includes the rounding to grey levels
    estimate = height * estimate_noise(op, y / height, sensor.saturated(y), bad, light)
    rounding = sensor.step / np.sqrt(12)
    return replace(sensor, read_noise=float(np.sqrt(max(estimate - rounding, 0)) * np.sqrt(estimate + rounding)))


def check_noise(noise: Any) -> Sensor:
    """The sensor that the argument `noise` describes: a Sensor, "auto", or a standard deviation >= 0.

    Raises
    ------
    InputError, InputTypeError
        If it is none of them.
    """
    if isinstance(noise, Sensor):
        return noise
    if isinstance(noise, str) and noise == "auto":
        return Sensor()
    return Sensor(finite_number("noise", noise, '"auto", a standard deviation >= 0 in the units of y, or a Sensor'))


def level(op: SensingOperator, y: np.ndarray) -> np.ndarray:
    """The initial estimate "adjoint", (V, B, H, W): the same picture in each frame of each view.

    The picture is ``S y / (S^2 + gram / 4)``, where S is the sum of the masks: a regularised least-squares estimate of
    a level common to all frames. Unlit pixels get the mean of their neighbours. Consecutive
    measurements y (N, H, W) have one picture each.
    """
    if y.ndim == 3:
        return joined([level(part, picture) for part, picture in zip(op.parts, y)])
    total = op.masks.sum((0, 1), dtype=op.dtype)
    lit = ~op.unlit
    common = filled(lit * total * y, lit * (total**2 + op.gram / 4))
    return np.broadcast_to(common, op.shape).copy()


def filled(weighted: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The mean ``weighted / weight`` of pictures (..., H, W); where the weight (H, W) is 0, that of the neighbours.

    Neighbours are as near as possible, by Gaussians that grow. Where there are none, the value is 0.
    """
    mean = np.divide(weighted, weight, out=np.zeros_like(weighted), where=weight > 0)
    dark = weight == 0
    if not dark.any():
        return mean
    from scipy.ndimage import gaussian_filter

    for width in NEAR:
        around, known = (gaussian_filter(a, width, mode="nearest", axes=(-2, -1)) for a in (weighted, weight))
        reached = known > CLOSED * weight.max()
        np.divide(around, known, out=mean, where=dark & reached)
        dark &= ~reached
        if not dark.any():
            break
    return mean


def check_scene(scene: Any, op: SensingOperator) -> None:
    """Raise an InputError if `scene` is not "auto", "full" or a SceneModel with the operator's number of views."""
    if not isinstance(scene, SceneModel):
        one_of("scene", scene, ("auto", "full"), " or a SceneModel")
    elif len(scene.views) != op.shape[0] or not any(scene.views):
        raise InputError(f"scene has views {scene.views}: {op.shape[0]} were expected, one of them True at least")
