"""Does a measurement fit its masks? Asked before anything is solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pnp_sci.camera.code import Code
from pnp_sci.camera.fit import Finding, Fit
from pnp_sci.camera.frame_order import frame_order as order_of_frames
from pnp_sci.camera.groups import hot_groups
from pnp_sci.camera.lost_mask import lost_at_an_end, step_of
from pnp_sci.camera.mask_frames import lost_frames, lost_views, repeated_frames, static_views
from pnp_sci.camera.outliers import negative, outliers
from pnp_sci.camera.pile import pile
from pnp_sci.camera.stuck import stuck_lines
from pnp_sci.camera.values import beyond, centred, loud, saturation, sign, stuck_at, unlike
from pnp_sci.camera.verdict import judge_code, shift_of, told
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import check_bad, check_measurement, check_noise, check_operators
from pnp_sci.sensing.sensor import Sensor


def check_fit(y: Any, masks: Any, *, noise: Any = "auto", bad: Any = None, frame_order: bool = False) -> Any:
    """Check whether a measurement and its masks belong together: in less than a second for 2 x 10 frames of 256 x 256.

    Parameters
    ----------
    y : array_like, (H, W) or (N, H, W)
        The measurement, in any unit, or N of them.
    masks : array_like, (V, B, H, W), (B, H, W) or (N, V, B, H, W), or SensingOperator
    noise : "auto", float or Sensor
        A :class:`~pnp_sci.Sensor` says where the camera is saturated.
    bad : array_like of bool, (H, W), optional
        Pixels that are not used. Masked values of a NumPy masked array y are bad, too.
    frame_order : bool
        Whether to look also if the frames of the masks are in the order of time. It takes seconds, and needs several
        successive measurements: a single one is explained by reversed masks as well, by a film that runs backwards.

    Returns
    -------
    Fit, or list of Fit
        One for each of N measurements.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used.

    Notes
    -----
    The sum of a view's masks varies from pixel to pixel by the coding pattern only, which no scene follows. The part of
    y that follows this pattern therefore belongs to the masks. Its amount, its position and its sign tell whether they
    fit; standard errors come from the spread over blocks of pixels.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.check_fit(scene.y, scene.masks).ok
    True
    >>> print(pnp_sci.check_fit(scene.y, scene.masks[:, :, ::-1]).warnings[0])
    y does not follow the masks, but it follows them upside down: give the masks so
    """
    bad = check_bad(bad, y)
    measurements = check_measurement(y, bad)
    ops, _ = check_operators(masks, measurements)
    fits = check_all(ops, measurements, check_noise(noise), bad)
    if frame_order:
        if len(ops) > 1:
            raise InputError("frame_order needs masks (V, B, H, W) for all measurements, but each has its own")
        order = order_of_frames(ops[0], measurements, check_noise(noise))
        fits = [_with_order(fit, order) for fit in fits]
    return fits if np.ndim(y) == 3 else fits[0]


def check_all(
    ops: Sequence[SensingOperator],
    measurements: np.ndarray,
    sensor: Sensor,
    bad: np.ndarray | None,
    warn_of_bad: bool = True,
) -> list[Fit]:
    """How each of the measurements (N, H, W) fits its masks: `ops` has one operator for all, or one for each.

    `bad` is (N, H, W) or None.
    """
    with np.errstate(all="ignore"):  # extreme numbers make no rule true
        each = map(Masks, ops) if len(ops) > 1 else [Masks(ops[0])] * len(measurements)
        return [
            masks.fit(y, sensor, None if bad is None else bad[n], warn_of_bad)
            for n, (masks, y) in enumerate(zip(each, measurements))
        ]


def _with_order(fit: Fit, order: str) -> Fit:
    """The fit, with what is known of the order of the frames."""
    backwards = Finding("frame order", "successive measurements run backwards", "reverse the frames: masks[:, ::-1]")
    return replace(fit, frame_order=order, findings=fit.findings + (backwards,) * (order == "reversed"))


class Masks:
    """What all measurements through the same masks share."""

    def __init__(self, op: SensingOperator):
        self.masks = masks = op.masks
        self.sums = masks.sum(1, dtype=np.float32)
        self.signed = masks.dtype != np.uint8 and bool(masks.min() < 0)
        self.weight = np.abs(masks).sum((0, 1), dtype=np.float32) if self.signed else self.sums.sum(0)
        self.code = Code(self.sums)
        self.negative = float(np.mean(self.sums.sum(0) < 0))
        self.steps = [None if self.signed else step_of(view) for view in masks]
        lost = lost_views(masks)
        of_frames = (*lost_frames(np.asarray(masks.any((2, 3)))), *static_views(masks))
        self.missing = (*of_frames, *lost) if of_frames or lost else repeated_frames(masks)

    def fit(self, y: np.ndarray, sensor: Sensor, bad: np.ndarray | None, warn_of_bad: bool) -> Fit:
        """How y (H, W) fits; `bad` pixels (H, W) must be 0 in it."""
        good, saturated = np.ones(y.shape, bool) if bad is None else ~bad, sensor.saturated(y)
        nothing = np.zeros(y.shape, bool)
        stuck = nothing
        if not self.signed:
            stuck = stuck_lines(y, self.sums, good if saturated is None else good & ~saturated)
        fit = self._fit(np.where(stuck, 0, y), sensor, good & ~stuck, saturated, warn_of_bad)
        if not stuck.any() or any(f.kind in OTHERS for f in fit.findings):
            return fit
        found = (stuck_at(y[stuck]), *fit.findings) if warn_of_bad else fit.findings
        return replace(fit, stuck=stuck, findings=found)

    def _fit(
        self, y: np.ndarray, sensor: Sensor, good: np.ndarray, saturated: np.ndarray | None, warn_of_bad: bool
    ) -> Fit:
        """How the good pixels of y (H, W), which is 0 in the others, fit; no line of it is stuck."""
        height = float(np.abs(y).max())
        nothing = np.zeros(y.shape, bool)
        if height == 0:
            text = "y is 0 everywhere" if good.all() else "y is 0 in all pixels that are not bad"
            empty = Finding("empty", text, "look for missing parts of its file, or a closed shutter")
            found = (*self.missing, empty) if self.masks.any() else self.missing
            return Fit(None, None, 0.0, nothing, nothing, nothing, found, text)
        scaled = (y / height).astype(np.float32)
        known = nothing if saturated is None else saturated
        hot, dead = self._outliers(scaled, good)
        left = good & ~hot & ~dead
        heap = pile(scaled[left], self.weight[left])
        if not self.signed:
            piled = nothing if heap is None else scaled >= heap[0]
            groups = hot_groups(scaled, self.masks, good & ~dead & ~known & ~piled)
            if groups.any():
                hot, left = hot | groups, left & ~groups
                heap = pile(scaled[left], self.weight[left])
        findings = [*self.missing, *(unlike(scaled, self.weight, hot, dead, good) if warn_of_bad else ())]
        clipped = known if heap is None else known | (scaled >= heap[0])
        findings += [*beyond(float(y[left].max(initial=0)), sensor), *loud(y[left & ~clipped], sensor)]
        if all(step is not None for step in self.steps):
            findings += lost_at_an_end(self.masks, self.steps, scaled, left & ~clipped)
        if heap is not None:
            findings += saturation(y, heap[0] * height, heap[1] * height, sensor, saturated)
        if below := centred(y[left], self.negative) if self.signed else sign(y[good], y[left]):
            return Fit(None, None, 0.0, nothing, nothing, nothing, (*self.missing, *below))
        good = left
        return self._by_code(scaled * good, good, clipped, height, findings, hot, dead, heap)

    def _outliers(self, y: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hot and dead pixels; where views differ in brightness, each weighs as it is bright."""
        below = np.zeros(y.shape, bool) if self.signed else negative(y, good)
        good = good & ~below
        hot, dead = outliers(y, self.weight, good)
        if len(self.sums) > 1 and not self.signed and (hot.any() or dead.any()):
            code = Code(self.sums, good & ~hot & ~dead)
            if code.present and code.tells_light:
                levels = np.maximum(code.match(y * code.good).level.value, 0)
                hot, dead = outliers(y, np.einsum("v,vhw->hw", levels.astype(np.float32), self.sums), good)
        return hot, dead | below

    def _by_code(self, y, good, clipped, height, findings, hot, dead, heap) -> Fit:
        """The fit, with what the code says; a pile would weaken it, so that its blocks are left out."""
        code = self.code
        if clipped.any() or not good.all():
            code = Code(self.sums, good & ~code.around(clipped))
            if clipped.any() and code.blocks.sum() < self.code.blocks.sum() / 4:
                code = Code(self.sums, good & ~clipped)
        full_scale = None if heap is None else heap[0] * height
        if not code.present or clipped.mean() > 0.5:
            return Fit(
                None,
                None,
                0.0,
                hot,
                dead,
                np.zeros(y.shape, bool),
                tuple(findings),
                _why(self.code),
                full_scale=full_scale,
            )
        match = code.match(y)
        found = judge_code(code, y, match)
        if (clipped & (code.used > 0)).any():
            found = [f for f in found if f.kind not in LEVELS]
        if any(f.kind in OTHERS for f in found):  # what such masks allow says nothing of single pixels
            findings = [f for f in findings if f.kind not in ("hot", "dead")]
        black = next(
            ((1 - match.follows) * height * float(y[good].mean()) for f in found if f.kind == "black level"), None
        )
        return Fit(
            match.follows if match.error < np.inf else None,
            match.error if match.error < np.inf else None,
            match.share,
            hot,
            dead,
            np.zeros(y.shape, bool),
            (*findings, *found),
            "" if found or (code.tells_light and told(match)) else _hidden(code),
            shift_of(match),
            black,
            full_scale,
        )


OTHERS = {"arrangement", "inverted", "no code"}  # findings of masks that are not those of the measurement
LEVELS = {"black level", "contrast", "sharpness"}  # findings that saturation also causes


def _hidden(code: Code) -> str:
    if not code.tells_light:
        return "detail of the masks does not tell how much light there is, as with two views that complement each other"
    return "noise and texture hide the code of the masks"


def _why(code: Code) -> str:
    if not code.present:
        return "the sums of each view's masks do not vary from pixel to pixel, or the picture is too small"
    return "too many pixels are bad or saturated"
