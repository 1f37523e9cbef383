"""PSNR and SSIM: mean over the frames of a view, one value per view."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import positive_number, real_array, white
from pnp_sci.errors import InputError

OTHER_UNITS = 2.0  # times white: no estimate is above in most of its pixels
_SSIM_WINDOW = 11  # pixels: width of a Gaussian of standard deviation 1.5, truncated at 3.5 standard deviations
_log = logging.getLogger("pnp_sci")


def psnr(x: Any, reference: Any, peak: float | None = None) -> Any:
    """Peak signal-to-noise ratio in dB, mean over the frames of a view.

    Parameters
    ----------
    x : array_like, (V, B, H, W), (B, H, W), (H, W), or (V, B, H, W, 3) in colour
        Estimate; clipped to [0, peak]. NaN gives NaN. The squared error of a colour frame is the mean over its colours.
    reference : array_like, same shape
        Values in [0, peak].
    peak : float, optional
        The value of white in both, > 0. By default 1 of floats and 255 of uint8; needed for uint16.

    Returns
    -------
    ndarray of float64, (V,), or float
        One value per view; a float for a single video or picture. Equal frames give inf.

    Raises
    ------
    InputError, InputTypeError
        If the shapes or, without `peak`, the types differ, values are masked or not real, or `reference` has values
        outside [0, peak].

    Examples
    --------
    >>> import numpy as np
    >>> psnr(np.full((2, 3, 4, 4), 0.6), np.full((2, 3, 4, 4), 0.5)).round(6)
    array([20., 20.])
    """
    return _per_view(_frame_psnr, x, reference, peak)


def ssim(x: Any, reference: Any, peak: float | None = None) -> Any:
    """Structural similarity, Gaussian window of standard deviation 1.5, mean over the frames of a view.

    Parameters
    ----------
    x : array_like, (V, B, H, W), (B, H, W), (H, W), or (V, B, H, W, 3) in colour
        Estimate; clipped to [0, peak]. Of a colour frame it is the mean over its colours.
    reference : array_like, same shape
        Values in [0, peak].
    peak : float, optional
        The value of white in both, > 0. By default 1 of floats and 255 of uint8; needed for uint16.

    Returns
    -------
    ndarray of float64, (V,), or float
        One value per view; a float for a single video or picture. NaN for frames with a side below 11 pixels, the
        width of the window.

    Raises
    ------
    InputError, InputTypeError
        If the shapes or, without `peak`, the types differ, values are masked or not real, or `reference` has values
        outside [0, peak].

    References
    ----------
    Z. Wang et al., "Image quality assessment: from error visibility to structural similarity", IEEE TIP 13 (2004).

    Examples
    --------
    >>> import numpy as np
    >>> video = np.random.default_rng(0).random((2, 1, 16, 16))
    >>> ssim(video, video)
    array([1., 1.])
    """
    return _per_view(_frame_ssim, x, reference, peak)


def _per_view(score: Callable[[np.ndarray, np.ndarray], float], x: Any, reference: Any, peak: float | None) -> Any:
    x, reference = real_array("x", x), real_array("reference", reference)
    colour = x.ndim == 5 and x.shape[-1] == 3
    if x.shape != reference.shape or not (x.ndim in (2, 3, 4) or colour) or x.size == 0:
        raise InputError(
            f"x has shape {x.shape} and reference {reference.shape}: the same was expected, (V, B, H, W), (B, H, W), "
            "(H, W), or (V, B, H, W, 3)"
        )
    low, high = reference.min(), reference.max()
    if (peak := _white(x, reference) if peak is None else positive_number("peak", peak)) != 1:
        with np.errstate(all="ignore"):  # what is not finite is no reference
            x, reference = x / peak, reference / peak
    if not (reference.min() >= -1e-6 and reference.max() <= 1 + 1e-6):
        spans = f"{low:g} to {high:g}"
        raise InputError(f"reference spans {spans}: values in [0, {peak:g}] were expected; peak= says what is white")
    if np.mean(x > OTHER_UNITS) > 0.5:
        told = f"more than half of x is above {OTHER_UNITS * peak:g} where white is {peak:g}, to which it is clipped"
        _log.warning("%s: x and reference may be in different units", told)
    frame = x.shape[2:] if colour else x.shape[-2:]
    frames = zip(x.reshape(-1, *frame), reference.reshape(-1, *frame))
    values = np.array([score(np.clip(_floating(a), 0, 1), _floating(b)) for a, b in frames])
    return values.reshape(len(x), -1).mean(1) if x.ndim > 3 else float(values.mean())


def _white(x: np.ndarray, reference: np.ndarray) -> float:
    """The value of white of the reference, if x is of such a type: 1 of floats, whatever x reaches."""
    if x.dtype.kind in "fb" and reference.dtype.kind in "fb":
        return 1.0
    if "uint16" in (x.dtype.name, reference.dtype.name):
        raise InputError("x or reference is of uint16, which holds 10 to 16 bits: peak= says what is white")
    peak = white("reference", reference.dtype, 1.0)
    if x.dtype.name != reference.dtype.name:  # in any byte order
        raise InputError(
            f"x has dtype {x.dtype} and reference {reference.dtype}, where white is {peak:g}: the same dtype was "
            "expected; peak= says what is white in both"
        )
    return peak


def _floating(frame: np.ndarray) -> np.ndarray:
    return frame if frame.dtype in (np.float32, np.float64) else frame.astype(np.float64)


def _frame_psnr(x: np.ndarray, reference: np.ndarray) -> float:
    error = np.mean((x.astype(np.float64) - reference) ** 2)
    with np.errstate(divide="ignore"):
        return float(-10 * np.log10(error))


def _frame_ssim(x: np.ndarray, reference: np.ndarray) -> float:
    if min(x.shape[:2]) < _SSIM_WINDOW:
        return float("nan")
    from skimage.metrics import structural_similarity

    dtype = np.result_type(x, reference)
    return float(
        structural_similarity(  # type: ignore[no-untyped-call]
            reference.astype(dtype, copy=False),
            x.astype(dtype, copy=False),
            data_range=1,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
            channel_axis=2 if x.ndim == 3 else None,
        )
    )
