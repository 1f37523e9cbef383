"""How one measurement fits its masks: by its single pixels, by its values, and by the code in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pnp_sci.camera.code import Code
from pnp_sci.camera.few_values import coarse, has_few_values
from pnp_sci.camera.fit import Finding, Fit
from pnp_sci.camera.groups import hot_groups
from pnp_sci.camera.lost_mask import lost_at_an_end, step_of
from pnp_sci.camera.mask_frames import lost_frames, lost_views, repeated_frames, static_views
from pnp_sci.camera.outliers import negative, outliers
from pnp_sci.camera.pile import pile
from pnp_sci.camera.scattered import scattered_hot
from pnp_sci.camera.stuck import stuck_lines
from pnp_sci.camera.values import beyond, centred, loud, saturation, sign, stuck_at, unlike
from pnp_sci.camera.verdict import judge_code, shift_of, told
from pnp_sci.camera.wrapped import wrapped, wrapped_at
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.sensor import Sensor

OTHERS = {"arrangement", "inverted", "no code"}  # findings of masks that are not those of the measurement
PLACED = {"shift", "arrangement", "inverted", "sign"}  # findings that explain y by themselves
LEVELS = {"black level", "contrast", "sharpness"}  # findings that saturation and few values also cause


@dataclass(frozen=True)
class Pixels:
    """The pixels of a measurement that are of a kind, each bool (H, W).

    Attributes
    ----------
    good : ndarray
        Neither bad nor of a stuck line.
    hot, dead : ndarray
        Good ones that do not follow the light.
    clipped : ndarray
        Saturated, or in the pile.
    saturated : ndarray
        Those that the sensor says.
    pile : (float, float) or None
        Lowest and highest value of a pile at the upper end, in the units of the measurement.
    few : bool
        Whether the good ones have few values.
    """

    good: np.ndarray
    hot: np.ndarray
    dead: np.ndarray
    clipped: np.ndarray
    saturated: np.ndarray
    pile: tuple[float, float] | None
    few: bool = False

    @property
    def left(self) -> np.ndarray:
        """Good pixels that are no outliers."""
        return self.good & ~self.hot & ~self.dead


class Masks:
    """What all measurements through the same masks share."""

    def __init__(self, op: SensingOperator):
        self.signed = op.signed
        self.masks = masks = op.masks if self.signed or op.masks.min() >= 0 else np.maximum(op.masks, 0)
        self.sums = masks.sum(1, dtype=np.float32)
        self.weight = np.abs(masks).sum((0, 1), dtype=np.float32) if self.signed else self.sums.sum(0)
        self.code = Code(self.sums)
        self.negative = float(np.mean(self.sums.sum(0) < 0))
        self.steps = [None if self.signed else step_of(view) for view in masks]
        ends = {None if step is None else tuple(((1 - masks.shape[1]) * step).tolist()) for step in self.steps}
        self.mirrored = ends.pop() if len(ends) == 1 and masks.shape[1] > 2 else None
        lost = lost_views(masks)
        of_frames = (*lost_frames(np.asarray(masks.any((2, 3)))), *static_views(masks))
        self.missing = (*of_frames, *lost) if of_frames or lost else repeated_frames(masks)

    def fit(self, y: np.ndarray, sensor: Sensor, bad: np.ndarray | None, warn_of_bad: bool) -> Fit:
        """How y (H, W) fits; `bad` pixels (H, W) must be 0 in it."""
        good = np.ones(y.shape, bool) if bad is None else ~bad
        fit = self._without_stuck(y, sensor, good, warn_of_bad)
        if self.signed or not (fit.findings or fit.bad.any()) or any(f.kind in PLACED for f in fit.findings):
            return fit
        period = wrapped(y, self.masks, self.weight, good)
        if period is None:
            return fit
        nothing = np.zeros(y.shape, bool)  # all else that was found comes from that
        findings = (*self.missing, wrapped_at(period))
        return Fit(hot=nothing, dead=nothing, stuck=nothing, findings=findings, share=fit.share)

    def _without_stuck(self, y: np.ndarray, sensor: Sensor, good: np.ndarray, warn_of_bad: bool) -> Fit:
        """How the good pixels of y (H, W) that are of no stuck line fit."""
        nothing, full = np.zeros(y.shape, bool), sensor.saturated(y)
        saturated = nothing if full is None else full
        stuck = nothing if self.signed else stuck_lines(y, self.sums, good & ~saturated)
        fit = self._fit(np.where(stuck, 0, y), sensor, good & ~stuck, saturated, warn_of_bad)
        if not stuck.any() or any(f.kind in OTHERS for f in fit.findings):
            return fit
        found = (stuck_at(y[stuck]), *fit.findings) if warn_of_bad else fit.findings
        return replace(fit, stuck=stuck, findings=found)

    def _fit(self, y: np.ndarray, sensor: Sensor, good: np.ndarray, saturated: np.ndarray, warn_of_bad: bool) -> Fit:
        """How the good pixels of y (H, W), which is 0 in the others, fit; no line of it is stuck."""
        height, nothing = float(np.abs(y).max()), np.zeros(y.shape, bool)
        fit = Fit(hot=nothing, dead=nothing, stuck=nothing)
        if height == 0:
            text = "y is 0 everywhere" if good.all() else "y is 0 in all pixels that are not bad"
            empty = Finding("empty", text, "look for missing parts of its file, or a closed shutter")
            return replace(fit, findings=(*self.missing, empty) if self.masks.any() else self.missing, unknown=text)
        scaled = (y / height).astype(np.float32)
        pixels = self._pixels(scaled, height, good, saturated)
        left = pixels.left
        if below := centred(y[left], self.negative) if self.signed else sign(y[good], y[left]):
            return replace(fit, findings=(*self.missing, *below))
        findings = (*self.missing, *self._of_values(y, scaled, pixels, sensor, warn_of_bad))
        full_scale = None if pixels.pile is None else pixels.pile[0]
        fit = replace(fit, hot=pixels.hot, dead=pixels.dead, findings=findings, full_scale=full_scale)
        return self._by_code(fit, scaled * left, height, left, pixels)

    def _pixels(self, y: np.ndarray, height: float, good: np.ndarray, saturated: np.ndarray) -> Pixels:
        """The pixels of y (H, W), in units of its `height`; hot groups are told from a pile, and may be in its way."""
        if has_few_values(y[good], self.weight[good]):
            nothing = np.zeros(y.shape, bool)
            return Pixels(good, nothing, nothing, saturated, saturated, None, few=True)
        hot, dead = self._outliers(y, good, saturated)
        pixels = self._with_pile(y, height, good, hot, dead, saturated)
        if self.signed:
            return pixels
        groups = hot_groups(y, self.masks, good & ~dead & ~pixels.clipped)
        return self._with_pile(y, height, good, hot | groups, dead, saturated) if groups.any() else pixels

    def _with_pile(self, y, height, good, hot, dead, saturated) -> Pixels:
        left = good & ~hot & ~dead
        found = pile(y[left], self.weight[left])
        if found is None:
            return Pixels(good, hot, dead, saturated, saturated, None)
        low, top = found
        return Pixels(good, hot, dead, saturated | (y >= low), saturated, (low * height, top * height))

    def _outliers(self, y: np.ndarray, good: np.ndarray, saturated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hot and dead pixels; where views differ in brightness, each weighs as it is bright."""
        below = many = np.zeros(y.shape, bool)
        if not self.signed:
            below = negative(y, good)
            many = scattered_hot(y, self.weight, self.masks, good & ~below & ~saturated)
        good = good & ~below & ~many
        hot, dead = outliers(y, self.weight, good)
        if len(self.sums) > 1 and not self.signed and (hot.any() or dead.any()):
            code = Code(self.sums, good & ~hot & ~dead)
            if code.present and code.tells_light:
                levels = np.maximum(code.match(y * code.good).level.value, 0)
                hot, dead = outliers(y, np.einsum("v,vhw->hw", levels.astype(np.float32), self.sums), good)
        return hot | many, dead | below

    def _of_values(
        self, y: np.ndarray, scaled: np.ndarray, pixels: Pixels, sensor: Sensor, warn_of_bad: bool
    ) -> list[Finding]:
        """What values of y, and the light of single masks in it, say; `scaled` is y in units of its largest value."""
        left = pixels.left
        clear = left & ~pixels.clipped
        found = unlike(scaled, self.weight, pixels.hot, pixels.dead, pixels.good) if warn_of_bad else []
        if pixels.few:
            found += coarse(y[left], sensor)
        found += [*beyond(float(y[left].max(initial=0)), sensor), *loud(y[clear], sensor)]
        if all(step is not None for step in self.steps):
            found += lost_at_an_end(self.masks, self.steps, scaled, clear)
        if pixels.pile is not None:
            found += saturation(y, *pixels.pile, sensor, pixels.saturated)
        return found

    def _by_code(self, fit: Fit, y: np.ndarray, height: float, good: np.ndarray, pixels: Pixels) -> Fit:
        """The fit, with what the code says; a pile would weaken it, so that its blocks are left out."""
        code, clipped = self.code, pixels.clipped
        if clipped.any() or not good.all():
            code = Code(self.sums, good & ~code.around(clipped))
            if clipped.any() and code.blocks.sum() < self.code.blocks.sum() / 4:
                code = Code(self.sums, good & ~clipped)
        if not code.present or clipped.mean() > 0.5:
            return replace(fit, unknown=_why(self.code))
        match = code.match(y)
        shift = shift_of(code, y, match, self.mirrored)
        found = judge_code(code, y, match, shift, self.mirrored)
        findings = fit.findings
        if (clipped & (code.used > 0)).any() or pixels.few:
            found = [f for f in found if f.kind not in LEVELS]
        if any(f.kind in OTHERS for f in found):  # what such masks allow says nothing of single pixels
            findings = [f for f in findings if f.kind not in ("hot", "dead")]
        black = any(f.kind == "black level" for f in found)
        certain = match.error < np.inf
        return replace(
            fit,
            follows=match.follows if certain else None,
            error=match.error if certain else None,
            share=match.share,
            findings=(*findings, *found),
            unknown="" if found or (code.tells_light and told(match)) else _hidden(code),
            shift=None if any(f.kind == "arrangement" for f in found) else shift,
            black_level=(1 - match.follows) * height * float(y[good].mean()) if black else None,
        )


def _hidden(code: Code) -> str:
    if not code.tells_light:
        return "detail of the masks does not tell how much light there is, as with two views that complement each other"
    return "noise and texture hide the code of the masks"


def _why(code: Code) -> str:
    if not code.present:
        return "the sums of each view's masks do not vary from pixel to pixel, or the picture is too small"
    return "too many pixels are bad or saturated"
