"""Quality of a reconstruction without the truth, by cross-validation on held-back pixels of the measurement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import shown
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import SensingOperator

FRACTION = 0.05  # of the pixels of y that are held back


def held_back_score(
    reconstruct: Callable[[np.ndarray, np.ndarray], Any],
    y: np.ndarray,
    masks: np.ndarray,
    *,
    noise: float = 0.0,
    white: float = 1.0,
    saturated: np.ndarray | None = None,
    fraction: float = FRACTION,
    seed: int = 0,
) -> float:
    """Prediction error of a method on held-back pixels of the measurement, in dB: higher is better.

    A random set H of pixels is hidden: their masks and y are set to 0. The video x is reconstructed from the rest ::

        score = -10 log10( (mean over H of (y - Phi x)^2 - noise^2) / (white^2 * mean over H of gram) )

    If the errors of x were independent from frame to frame, the score would be the PSNR of x. They are not, so the
    score only ranks methods on one measurement. It cannot be compared between measurements.

    Parameters
    ----------
    reconstruct : callable
        ``reconstruct(y, masks)`` returns the video (V, B, H, W) of a measurement (H, W).
    y : ndarray, (H, W)
    masks : ndarray, (V, B, H, W)
    noise : float
        Standard deviation of the noise of y, in its units; its variance is subtracted from the squared error.
    white : float
        Value of white in the video, as the peak of a PSNR.
    saturated : ndarray of bool, (H, W), optional
        Pixels that are not hidden, as their true value is unknown.
    fraction : float
        Fraction of the pixels to hide, between 0 and 1; pixels where gram is 0 are not hidden.
    seed : int
        Seed of the choice of pixels; scores are comparable for equal seeds.

    Returns
    -------
    float
        NaN if no pixel can be hidden. The difference of squares has the lower bound ``noise^2 * sqrt(2 / |H|)``, the
        statistical error of the mean square of the noise.

    Raises
    ------
    InputError
        If `fraction` is not between 0 and 1, or the shapes do not agree.

    References
    ----------
    J. Batson and L. Royer, "Noise2Self: blind denoising by self-supervision", ICML (2019).

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> def blur(y, masks):
    ...     return pnp_sci.solve(y, masks, "tv", iterations=20).x
    >>> def nothing(y, masks):
    ...     return 0 * masks
    >>> held_back_score(blur, scene.y, scene.masks) > held_back_score(nothing, scene.y, scene.masks) + 10
    True
    """
    if not 0 < fraction < 1:
        raise InputError(f"fraction is {shown(fraction)}: a number between 0 and 1 was expected")
    if np.ndim(masks) != 4 or np.shape(masks)[2:] != np.shape(y):
        raise InputError(
            f"masks has shape {np.shape(masks)}, but y {np.shape(y)}: (V, B, H, W) and (H, W) were expected"
        )
    op = SensingOperator(masks, np.float64)
    usable = op.gram > 0
    hidden = _choose(usable if saturated is None else usable & ~saturated, fraction, seed)
    if not hidden.any():
        return float("nan")
    x = np.asarray(reconstruct(y * ~hidden, masks * ~hidden), np.float64)
    error = (y - op.forward(x))[hidden]
    floor = noise**2 * np.sqrt(2 / error.size)
    excess = max(float(np.mean(error**2)) - noise**2, floor)
    with np.errstate(divide="ignore"):
        return float(-10 * np.log10(excess / (white**2 * op.gram[hidden].mean())))


def _choose(usable: np.ndarray, fraction: float, seed: int) -> np.ndarray:
    """A random set of a fraction of the usable pixels, bool (H, W): at least one pixel if two are usable."""
    places = np.flatnonzero(usable)
    count = min(max(round(fraction * places.size), 1), max(places.size - 1, 0))
    chosen = np.zeros(usable.size, bool)
    chosen[np.random.default_rng(seed).permutation(places)[:count]] = True
    return chosen.reshape(usable.shape)
