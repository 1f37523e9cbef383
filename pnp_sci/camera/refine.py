"""Gauss-Newton steps that make moved masks explain more of a measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci.camera.local_model import PARAMETERS, LocalFit, LocalModel
from pnp_sci.camera.warp import Transform

STEPS = 10  # at most; from half a pixel off, five suffice
SETTLED = 1e-3  # pixels: shorter steps are not made
WITHIN = 0.1  # standard errors: neither
HALVES = (1.0, 0.5, 0.25, 0.125)  # parts of a step that are tried, until one lowers the residual
TINY = 1e-3  # instead of no degree of freedom: errors are then as good as infinite
LONGEST = 1.0  # pixels: the detail of the masks is no straight line farther away


@dataclass(frozen=True, eq=False)
class Refined:
    """Transforms of the views, how far to trust them, and what they explain.

    `covariance` (V, 5, V, 5) is in pixels: along rows, along columns, rotation and growth at half of the longer side;
    that of the blur in pixels squared.
    """

    model: LocalModel
    transforms: list[Transform]
    covariance: np.ndarray
    fit: LocalFit

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (V, 5)."""
        return deviations(self.covariance)


def refine(model: LocalModel, transforms: list[Transform], groups: np.ndarray, blur: bool) -> Refined:
    """The transforms near these with the least residual, one for each group of views; with blur, or without.

    Each step solves the linearised least squares with the levels of all blocks eliminated (Golub & Pereyra 1973, with
    Kaufman's simplification of 1975). A step that does not lower the residual is halved.

    Parameters
    ----------
    model : LocalModel
    transforms : list of Transform
        Of each view.
    groups : ndarray, (G, V)
        1 where a view belongs to a group. The views of a group move by the same steps.
    blur : bool
        Whether the blur, the same for all views, is sought too.
    """
    usable = model.usable(transforms)  # kept, so that shares can be compared
    fit, better = model.fit(transforms, usable), True
    for _ in range(STEPS):
        step, covariance = _step(model, transforms, fit, _free(groups, blur))
        if not better or (np.abs(step) <= np.maximum(SETTLED, WITHIN * deviations(covariance))).all():
            break
        step *= min(1.0, LONGEST / float(np.abs(step).max()))
        for part in HALVES:
            tried = [_after(t, part * s, model.shape) for t, s in zip(transforms, step)]
            new = model.fit(tried, usable)
            if better := new.share > fit.share:
                transforms, fit = tried, new
                break
    return Refined(model, transforms, covariance, fit)


def deviations(covariance: np.ndarray) -> np.ndarray:
    """Standard errors (V, 5) of a covariance (V, 5, V, 5)."""
    return np.sqrt(np.maximum(np.einsum("vivi->vi", covariance), 0))


def _step(
    model: LocalModel, transforms: list[Transform], fit: LocalFit, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The Gauss-Newton step (V, 5) and its covariance (V, 5, V, 5), for what each free parameter changes (F, V, 5).

    The covariance is robust against blocks that differ in how well they are explained, and corrected for few blocks.
    """
    slopes = fit.beyond(np.einsum("fvi,vinkp->fnkp", free, model.derivatives(transforms, fit), optimize=True))
    normal = np.einsum("fnkp,gnkp->fg", slopes, slopes, optimize=True)
    gradients = np.einsum("fnkp,nkp->kf", slopes, fit.residual)  # of each block
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    there = int(fit.usable.any(1).sum())
    covariance = inverse @ (gradients.T @ gradients) @ inverse * there / max(there - len(free), TINY)
    step = np.einsum("f,fvi->vi", inverse @ gradients.sum(0), free)
    return step, np.einsum("fvi,fg,gwj->viwj", free, covariance, free, optimize=True)


def _free(groups: np.ndarray, blur: bool) -> np.ndarray:
    """What each free parameter changes, (F, V, 5): motions of the groups (G, V), and blur of all views."""
    motions, softness = np.eye(PARAMETERS)[:4], np.eye(PARAMETERS)[4:]
    views = groups.shape[1]
    free = np.einsum("gv,mi->gmvi", groups, motions).reshape(-1, views, PARAMETERS)
    return np.concatenate([free, np.broadcast_to(softness, (1, views, PARAMETERS))]) if blur else free


def _after(transform: Transform, step: np.ndarray, shape: tuple[int, ...]) -> Transform:
    """The transform after a step (5,)."""
    radius = max(shape[2:]) / 2
    rows, columns, turn, growth, blur = (float(s) for s in step)
    return Transform(
        transform.rows + rows,
        transform.columns + columns,
        transform.rotation + float(np.rad2deg(turn / radius)),
        transform.scale * (1 + growth / radius),
        transform.blur + blur,
    )
