"""The search for the transforms of masks: start, interpolation, blur, and whether the views share one transform."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from pnp_sci.camera.black_level import light_against_mean
from pnp_sci.camera.coarse import coarse_transform
from pnp_sci.camera.local_model import LocalModel
from pnp_sci.camera.refine import Refined, refine
from pnp_sci.camera.warp import Transform

BY_CHANCE = 10.0  # standard errors of the explained share: the best of thousands of wrong transforms reaches five
MIRRORS = (  # the last for squares only
    lambda planes: planes[..., ::-1, :],
    lambda planes: planes[..., ::-1],
    lambda planes: planes[..., ::-1, ::-1],
    lambda planes: planes.swapaxes(-1, -2),
)
ENOUGH = 0.1  # least explained share that is trusted where the light cannot be told; wrong masks that move reach 0.08
CHANCE = 3.0  # standard errors: estimates nearer to 0 count as 0
NEGLIGIBLE = 0.02  # pixels: masks that far off cost some 0.05 dB
MATERIAL = 0.05  # of the explained share: a view that is so dim that its transform is by chance adds less
MOTIONS = 4  # shift along rows and columns, rotation, scale
NO_BLUR = 0.01  # pixels squared: such blur changes masks as little as that shift does


def search(models: list[LocalModel], each_view: bool | Literal["auto"]) -> Refined:
    """The transforms with which masks explain most of measurements; the models differ in their interpolation.

    Where the light cannot be told, as with masks that complement each other, all views move together unless `each_view`
    is True.
    """
    model, sums = models[0], models[0].planes[:, 0]
    start = coarse_transform(model.measurements, sums)
    together, apart = np.ones((1, len(sums))), np.eye(len(sums))
    choices = [Transform(), start]
    if not model.tells_light:  # the details of views that complement each other cancel in the start of all views
        choices += [coarse_transform(model.measurements, total[None]) for total in sums]
        each_view = each_view is True
    best = _refined(models, _most(model, [[one] * len(sums) for one in choices]), together)
    if len(sums) == 1 or each_view is False or not trusted(best):
        return best
    starts = _starts(best, start)
    own = _refined([best.model] if starts == best.transforms else models, starts, apart)
    if each_view is True:
        return own
    shared = _with_the_strong(models, own, best)
    if _explains_more(own, shared):
        shared = own
    return shared if _views_differ(shared) else best


def _with_the_strong(models: list[LocalModel], own: Refined, best: Refined) -> Refined:
    """Own transforms of the strong views, with the first of which the others move; `best` if one at most is strong."""
    strong = own.fit.strong
    if strong.all() or strong.sum() < 2:
        return own if strong.all() else best
    groups = np.eye(len(strong))[strong]
    groups[0] += ~strong
    first = own.transforms[int(strong.argmax())]
    return _refined(models, [t if s else first for t, s in zip(own.transforms, strong)], groups)


def trusted(found: Refined) -> bool:
    """Whether more is explained than by chance, and twice as much as by mirrored masks; and whether light is positive.

    Where the light cannot be told, the share must exceed `ENOUGH` instead.

    Masks that move have sums like streaks, which explain a little of each other.
    """
    told = found.model.tells_light
    least = max(BY_CHANCE * found.fit.share_by_chance, 0 if told else ENOUGH)
    if found.fit.share <= least or (told and light_against_mean(found.model, found.fit) <= 0):
        return False
    mirrors = MIRRORS[: 4 if found.model.shape[2] == found.model.shape[3] else 3]
    others = (found.model.mirrored(mirror).fit(found.transforms, found.fit.usable).share for mirror in mirrors)
    return all(found.fit.share > 2 * share for share in others)


def _starts(common: Refined, start: Transform) -> list[Transform]:
    """Of each view, the common transform or that which its own sums find around the common start."""
    model, transforms = common.model, common.transforms
    for v, total in enumerate(model.planes[:, 0]):
        alone = coarse_transform(model.measurements, total[None], np.rint(start.shift).astype(int))
        transforms = _most(model, [transforms, [*transforms[:v], alone, *transforms[v + 1 :]]])
    return transforms


def _most(model: LocalModel, choices: list[list[Transform]]) -> list[Transform]:
    """The transforms that explain most; the first of equals."""
    return max(choices, key=lambda transforms: model.fit(transforms).share)


def _refined(models: list[LocalModel], transforms: list[Transform], groups: np.ndarray) -> Refined:
    """The best transforms near these, over the interpolations; with blur if it is real."""
    soft = max((refine(model, transforms, groups, blur=True) for model in models), key=lambda r: r.fit.share)
    return soft if _is_blurred(soft) else refine(soft.model, _sharp(soft.transforms), groups, blur=False)


def _is_blurred(found: Refined) -> bool:
    """Whether the blur of all views is more than chance, more than negligible, and true to the light.

    Detail of the scene may look like blur, more often like sharpness, which no camera adds. But only true blur makes
    the light that the detail tells of as much as the mean of y.
    """
    if found.transforms[0].blur <= max(NO_BLUR, CHANCE * found.errors[0, 4]) or not found.model.tells_light:
        return False
    fits = found.fit, found.model.fit(_sharp(found.transforms), found.fit.usable)
    soft, sharp = (abs(light_against_mean(found.model, fit) - 1) for fit in fits)
    return soft < sharp


def _sharp(transforms: list[Transform]) -> list[Transform]:
    return [replace(transform, blur=0.0) for transform in transforms]


def _explains_more(own: Refined, shared: Refined) -> bool:
    """Whether transforms of all views explain more than shared ones, by more than chance and materially."""
    common = shared.model.fit(shared.transforms, own.fit.usable).share
    return own.fit.share - common > max(MATERIAL * common, BY_CHANCE * own.fit.share_by_chance)


def _views_differ(found: Refined) -> bool:
    """Whether the transforms of two views differ by more than chance and by more than is negligible."""
    shape, views = found.model.shape, range(len(found.transforms))
    return any(
        found.transforms[v].displacement(shape, found.transforms[w])
        > max(NEGLIGIBLE, CHANCE * corner_error(_of_difference(found.covariance, v, w), shape))
        for v in views
        for w in views
    )


def _of_difference(covariance: np.ndarray, v: int, w: int) -> np.ndarray:
    """Covariance (5, 5) of the difference of the parameters of two views."""
    return covariance[v, :, v] + covariance[w, :, w] - covariance[v, :, w] - covariance[w, :, v]


def corner_error(covariance: np.ndarray, shape: tuple[int, ...]) -> float:
    """Standard error, in pixels, of where the worst corner goes, from the covariance (5, 5) of the parameters."""
    down, right = np.array(shape[2:]) / max(shape[2:])
    worst = 0.0
    for i, j in ((down, right), (-down, right)):
        motions = np.array([[1, 0, -j, i], [0, 1, i, j]])
        worst = max(worst, float(np.trace(motions @ covariance[:4, :4] @ motions.T)))
    return float(np.sqrt(worst))


def whole_pixels(found: Refined) -> list[Transform] | None:
    """Shifts by whole pixels, if the transforms are that but for chance or for what is negligible.

    They need no interpolation, which would change the masks. By chance is what is within three standard errors, or
    explains no more than the parameters do by chance, with three standard errors for each.
    """
    whole = [Transform(float(round(t.rows)), float(round(t.columns))) for t in found.transforms]
    if found.transforms[0].blur > 0:
        return None
    left, least = (float(np.sum(f.residual**2)) for f in (found.model.fit(whole, found.fit.usable), found.fit))
    pixels = found.fit.usable.sum() * len(found.fit.detail)
    if (left - least) * pixels <= CHANCE**2 * len(set(found.transforms)) * MOTIONS * least:
        return whole
    for v, (transform, plain) in enumerate(zip(found.transforms, whole)):
        error = corner_error(found.covariance[v, :, v], found.model.shape)
        if transform.displacement(found.model.shape, plain) > max(NEGLIGIBLE, CHANCE * error):
            return None
    return whole
