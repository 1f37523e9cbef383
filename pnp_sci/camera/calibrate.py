"""From raw pictures of a camera to masks: dark frame, lamp, bad pixels, and how good they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from pnp_sci._validate import positive_number, real_array, require_finite, shown, whole
from pnp_sci.camera.calibration import Calibration, cut
from pnp_sci.camera.clipped import Clipped, clipped, grey_level
from pnp_sci.camera.quality import lamp_gains, measure_quality
from pnp_sci.errors import InputError

SURE = 8.0  # robust standard deviations: no pixel of 1e7 with Gaussian noise is that far from its neighbours
DEAD = 0.3  # of the neighbours' response to light: less is no lens's shading
LEVELS = 20  # grey levels in a picture: with fewer, its steps are not those of a camera's rounding
AROUND = 5  # pixels: side of the median that neighbours have


def calibrate(
    dark: Any,
    white: Any,
    patterns: Any,
    *,
    crop: tuple[int, int, int, int] | None = None,
    full_scale: float | None = None,
) -> Calibration:
    """Make masks of raw pictures.

    Repeated pictures are averaged without the smallest and the largest value of each pixel, which may be a cosmic ray.
    The dark frame is subtracted. With `white`, the brightness of the lamp is taken from the open elements of each
    pattern, and its drift is divided out.

    Parameters
    ----------
    dark : array_like, (H0, W0) or (N, H0, W0), or None
        Pictures without light; None if the camera has subtracted them.
    white : array_like, (H0, W0), (N, H0, W0) or (V, N, H0, W0), or None
        Pictures with all elements open, of all views or of each.
    patterns : array_like, (B, H0, W0), (V, B, H0, W0) or (V, B, N, H0, W0)
        Pictures of each pattern, while light comes through one view only. The target is evenly lit.
    crop : tuple, optional
        (top, left, rows, columns) of the part that is kept.
    full_scale : float, optional
        The camera's largest value: pixels that reach it are bad, and measurements end there, see
        :attr:`Calibration.saturation`. Without it, a pile of values at the largest one is only said in the report.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError, InputTypeError
        If shapes do not agree, values are not finite real numbers, or `white` is not brighter than `dark`.

    Examples
    --------
    >>> import pnp_sci
    >>> masks = pnp_sci.random_masks((1, 4, 64, 64))
    >>> raw = (100 + 3000 * masks).astype(np.uint16)
    >>> made = calibrate(np.full((64, 64), 100), np.full((64, 64), 3100), raw)
    >>> float(np.abs(made.masks - masks).max()) < 0.01
    True
    """
    pictures = _finite("patterns", patterns, (3, 4, 5))
    pictures = pictures[None] if pictures.ndim == 3 else pictures
    pictures = pictures[:, :, None] if pictures.ndim == 4 else pictures  # (V, B, N, H, W)
    size = pictures.shape[3:]
    crop = (0, 0, *size) if crop is None else _checked_crop(crop)
    pictures = cut("patterns", pictures, crop, size)
    views, frames = pictures.shape[:2]
    if full_scale is not None:
        full_scale = positive_number("full_scale", full_scale)

    darks = _repeated("dark", np.zeros((1, *size)) if dark is None else dark, crop, size)
    black = average(darks)
    light = np.stack([[average(p) - black for p in view] for view in pictures])  # (V, B, H, W)
    whites = None if white is None else _whites(white, crop, size, views)
    response = None if whites is None else _response(whites, black, views)
    grain = _grain(darks[0], pictures[0, 0, 0])
    bad = _far(black, grain) | _far(darks.std(0), grain) | _saturated(pictures, whites, full_scale)
    shading = light.max(1) if response is None else response  # what each pixel sees of an open element
    bad |= np.all([picture < DEAD * _median(picture) for picture in shading], axis=0)
    if np.median(shading) <= 0:
        raise InputError("patterns are not brighter than dark: their order may be another than dark, white, patterns")
    if bad.all():
        raise InputError("patterns or white are bad in all pixels, such as saturated: a shorter exposure was expected")
    gains = np.ones((views, frames)) if response is None else lamp_gains(light, response, bad)
    one = float(np.median(shading[:, ~bad]))
    masks = (light / (one * gains[..., None, None])).astype(np.float32)
    piles = _piles(pictures, whites, darks[0], ~bad, full_scale)
    quality = measure_quality(masks, shading / one, pictures, black, bad, gains, piles)
    return Calibration(masks, black.astype(np.float32), bad, crop, size, full_scale, quality)


def average(pictures: np.ndarray) -> np.ndarray:
    """Mean (H, W) of pictures (N, H, W); of three or more without the smallest and the largest of each pixel."""
    total = pictures.sum(0, dtype=np.float64)
    if len(pictures) < 3:
        return total / len(pictures)
    return (total - pictures.min(0) - pictures.max(0)) / (len(pictures) - 2)


def _whites(white: Any, crop: tuple[int, ...], size: tuple[int, int], views: int) -> np.ndarray:
    """The pictures of the lamp, (1 or V, N, H, W)."""
    array = _finite("white", white, (2, 3, 4))
    if array.ndim == 4 and len(array) != views:
        raise InputError(f"white has pictures of {len(array)} views, but patterns of {views}: the same was expected")
    each = array if array.ndim == 4 else array.reshape(1, -1, *array.shape[-2:])
    return cut("white", each, crop, size)


def _response(whites: np.ndarray, black: np.ndarray, views: int) -> np.ndarray:
    """What each pixel shows of the lamp, (V, H, W)."""
    response = np.stack([average(one) for one in whites]) - black
    if np.median(response) <= 0:
        raise InputError(f"white is not brighter than dark: {np.median(response):.3g} in the median, > 0 was expected")
    return np.broadcast_to(response, (views, *response.shape[1:]))


def _far(picture: np.ndarray, grain: float) -> np.ndarray:
    """Pixels whose value is far above those around them, of which rounding alone spreads values by the `grain`."""
    rest = picture - _median(picture)
    spread = max(1.4826 * float(np.median(np.abs(rest))), grain)
    return rest > np.float64(max(SURE * spread, np.finfo(np.float32).eps * np.abs(picture).max(), 1e-12))


def _grain(*pictures: np.ndarray) -> float:
    """Half a grey level of pictures (H, W), whatever their type and unit; 0 if they are not rounded.

    With few levels between dark and bright the step is that of the type: 1 for integers, 0 for others.
    """
    whole = 1.0 if all(picture.dtype.kind in "iu" for picture in pictures) else 0.0
    step = grey_level(*map(np.ravel, pictures))
    span = np.ptp(np.stack(pictures).astype(np.float64))
    return (step if LEVELS * step < span else whole) / 2


def _median(picture: np.ndarray) -> np.ndarray:
    from scipy.ndimage import median_filter

    return median_filter(picture, AROUND, mode="nearest")


def _saturated(patterns: np.ndarray, whites: np.ndarray | None, full_scale: float | None) -> np.ndarray:
    """Pixels of which most repeats are at full scale in any picture."""
    if full_scale is None:
        return np.zeros(patterns.shape[-2:], bool)
    reached = np.any(np.median(patterns, 2) >= full_scale, axis=(0, 1))
    return reached if whites is None else reached | np.any(np.median(whites, 1) >= full_scale, axis=0)


def _piles(
    patterns: np.ndarray, whites: np.ndarray | None, dark: np.ndarray, good: np.ndarray, full_scale: float | None
) -> tuple[Clipped, ...]:
    """The pictures that are clipped below full scale."""
    top = np.inf if full_scale is None else full_scale
    taken = {"patterns": patterns} if whites is None else {"white": whites, "patterns": patterns}
    found = (clipped(name, pictures, dark, good, top) for name, pictures in taken.items())
    return tuple(pile for pile in found if pile is not None)


def _repeated(name: str, value: Any, crop: tuple[int, ...], size: tuple[int, int]) -> np.ndarray:
    array = cut(name, _finite(name, value, (2, 3)), crop, size)
    return array.reshape(-1, *array.shape[-2:])


def _finite(name: str, value: Any, dimensions: tuple[int, ...]) -> np.ndarray:
    array = real_array(name, value)
    if array.ndim not in dimensions or array.size == 0:
        allowed = " or ".join(map(str, dimensions))
        raise InputError(f"{name} has shape {array.shape}: {allowed} dimensions were expected, rows and columns last")
    require_finite(name, array)
    return array


def _checked_crop(crop: Any) -> tuple[int, int, int, int]:
    try:
        top, left, rows, columns = crop
    except (TypeError, ValueError) as error:
        raise InputError(f"crop is {shown(crop)}: (top, left, rows, columns) was expected") from error
    return whole("crop", top, 0), whole("crop", left, 0), whole("crop", rows, 1), whole("crop", columns, 1)
