"""Registration: where the masks of a measurement really are, from the measurement alone."""

from __future__ import annotations

import logging
from typing import Any, Literal

import numpy as np

from pnp_sci._validate import one_of, shown
from pnp_sci.camera.black_level import black_level
from pnp_sci.camera.explained import BLOCK
from pnp_sci.camera.local_model import LocalModel
from pnp_sci.camera.refine import Refined
from pnp_sci.camera.registration import Registration
from pnp_sci.camera.search import search, trusted, whole_pixels
from pnp_sci.camera.warp import ORDERS, Transform
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import as_masks
from pnp_sci.sensing.problem import check_measurement, check_pixels

LEAST = 2  # blocks a side
MOST = 8  # measurements that are looked at, evenly spaced: more gain nothing that matters

_log = logging.getLogger("pnp_sci")


def register(
    y: Any,
    masks: Any,
    *,
    each_view: bool | Literal["auto"] = "auto",
    interpolation: str = "auto",
) -> Registration:
    """Find shift, rotation and scale of the masks, and the black level, from the measurement alone.

    In blocks of 16 x 16 pixels, the fine detail of y follows the sums of the views' masks, times the brightness of the
    views there. The transform is sought with which the moved masks explain most of it: by correlation in tiles, to
    about half a pixel, then by Gauss-Newton steps, to some thousandths. No video is estimated.

    A shift by whole pixels is taken instead, and with it no interpolation, if no corner goes elsewhere by more than
    three standard errors or 0.02 pixels. So masks that fit stay as they are, bit for bit.

    Parameters
    ----------
    y : array_like, (H, W) or (N, H, W)
        One measurement, or several with the same masks: they share one estimate, from eight of them at most.
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
        At least 32 x 32 pixels. They may be off by an eighth of the picture, 32 pixels at most, and by rotation or
        scale that moves its edges by 1/64 of its side (0.9 degrees).
    each_view : bool or "auto"
        Whether every view has a transform of its own. "auto": if their difference is more than three standard errors
        and 0.02 pixels.
    interpolation : "auto", "linear" or "cubic"
        How a moved mask is computed between its elements. Linear is exact for sharp elements as large as a pixel, and
        lowers their contrast; cubic suits masks that are smooth. "auto" is that which explains y better.

    Returns
    -------
    Registration
        Its `masks` are the moved ones, its ``correct(y)`` is y less the black level.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used.

    Notes
    -----
    The gain of y is not found: y alone does not tell it from the brightness of the scene. The black level is told by
    what y has beyond the light that the contrast of its detail calls for. Masks of views that complement each other,
    such as m and 1 - m, do not tell that light: neither blur nor black level is found.

    Masks whose sums over frames are uniform leave nothing to register by.

    References
    ----------
    G. H. Golub & V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems whose
    variables separate", SIAM Journal on Numerical Analysis 10 (1973).

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> off = np.roll(scene.masks, (1, -2), (2, 3))
    >>> found = register(scene.y, off).transforms[0]
    >>> round(found.rows, 1), round(found.columns, 1)
    (-1.0, 2.0)
    """
    measurements = check_measurement(y).astype(np.float64)
    given = as_masks(masks)
    _check(measurements, given, each_view, interpolation)
    chosen = measurements[np.unique(np.linspace(0, len(measurements) - 1, MOST).astype(int))]
    kinds = ORDERS if interpolation == "auto" else [interpolation]
    models = [LocalModel(chosen, given, kind) for kind in kinds]
    before = models[0].fit([Transform()] * len(given))
    return _registration(given, search(models, each_view), before.share)


def _registration(given: np.ndarray, found: Refined, before: float) -> Registration:
    """What is made of the transforms that were found: they are taken if they are trusted."""
    fits, stay = trusted(found), [Transform()] * len(given)
    kept = (whole_pixels(found) or found.transforms) if fits else stay
    after = found.model.fit(kept)
    level, error = black_level(found.model, after) if fits else (0.0, float("inf"))
    if not fits:
        _log.warning("register: no shift, rotation or scale makes the masks fit y; they are left as they are")
    return Registration(
        given=given,
        transforms=tuple(kept),
        errors=tuple(_errors(found, v) for v in range(len(given))),
        black_level=level,
        black_error=error,
        interpolation=found.model.interpolation,
        before=before,
        after=after.share,
        trusted=fits,
    )


def registration_for(asked: bool | Registration, y: np.ndarray, masks: Any) -> Registration | None:
    """The registration that an argument `register` of :func:`pnp_sci.solve` stands for."""
    if not isinstance(asked, Registration):
        return register(y, masks) if asked else None
    given = as_masks(masks)
    if not np.array_equal(asked.given, given):
        raise InputError("register is a registration of other masks: one of these masks, True or False was expected")
    return asked


def _check(measurements: np.ndarray, masks: np.ndarray, each_view: Any, interpolation: Any) -> None:
    check_pixels(masks, measurements)
    if min(masks.shape[2:]) < LEAST * BLOCK:
        rows, columns = masks.shape[2:]
        raise InputError(f"masks has frames of {rows} x {columns}: {LEAST * BLOCK} pixels a side or more were expected")
    if not (isinstance(each_view, bool) or (isinstance(each_view, str) and each_view == "auto")):
        raise InputError(f'each_view is {shown(each_view)}: True, False or "auto" was expected')
    one_of("interpolation", interpolation, ("auto", *ORDERS))


def _errors(found: Refined, view: int) -> Transform:
    """Standard errors of the fields of a view's transform."""
    rows, columns, turn, growth, blur = map(float, found.errors[view])
    radius = max(found.model.shape[2:]) / 2
    return Transform(rows, columns, float(np.rad2deg(turn / radius)), growth / radius, blur)
