"""Measurements and masks as the user gave them: checked, compared with each other, and posed as problems."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pnp_sci._validate import real_array
from pnp_sci.camera.check import check_all
from pnp_sci.camera.fit import Fit
from pnp_sci.camera.register import registration_for
from pnp_sci.camera.registration import Registration
from pnp_sci.camera.residual import unexplained
from pnp_sci.errors import InputError
from pnp_sci.results.words import counted
from pnp_sci.sensing.mosaic import Mosaic, check_cells, planes
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import (
    Problem,
    check_bad,
    check_measurement,
    check_operator,
    check_operators,
    pose,
    without,
)
from pnp_sci.sensing.sensor import Sensor

MOST_VIEWS = 4  # that are usual on one sensor
PASSES = 3  # of quick estimates in which bad pixels are looked for
_log = logging.getLogger("pnp_sci")
_told: ContextVar[bool] = ContextVar("told", default=False)


@dataclass(frozen=True, eq=False)
class Input:
    """N measurements, all through the same masks or each through its own.

    Attributes
    ----------
    measurements : ndarray, (N, H, W)
        0 in the bad pixels.
    bad : ndarray of bool, (N, H, W), or None
        Pixels that are not used.
    find_bad : bool
        Whether those that the check finds are not used either.
    ops : list of SensingOperator
        One for all measurements, or one for each.
    largest : float
        What the masks were divided by.
    mosaic : Mosaic or None
        The colour filters of the sensor. All pictures then lie in planes, see :mod:`pnp_sci.sensing.mosaic`.
    balance : ndarray, (3,)
        What the masks of each colour were multiplied by: videos that all colours of the scene make equally bright.
    """

    measurements: np.ndarray
    bad: np.ndarray | None
    find_bad: bool
    ops: list[SensingOperator]
    largest: float
    registration: Registration | None = None
    mosaic: Mosaic | None = None
    balance: np.ndarray = field(default_factory=lambda: np.ones(3))

    @classmethod
    def of(cls, y: Any, masks: Any, bad: Any, mosaic: str | None = None) -> Input:
        """The arguments of :func:`pnp_sci.solve`; errors name them."""
        unused = check_bad(bad, y)
        measurements = check_measurement(y, unused)
        given = cls(measurements, unused, isinstance(bad, str), *check_operators(masks, measurements))
        return given if mosaic is None else given._in_planes(Mosaic(mosaic))

    def _in_planes(self, mosaic: Mosaic) -> Input:
        """The same, each colour by itself and as bright as the others."""
        check_cells("y", self.measurements.shape[1:])
        measurements, bad = planes(self.measurements), None if self.bad is None else planes(self.bad)
        ops = [SensingOperator(planes(op.masks), op.dtype) for op in self.ops]
        balance = mosaic.gains(measurements, ops[0])
        given = replace(self, measurements=measurements, bad=bad, ops=ops, mosaic=mosaic, balance=balance)
        return replace(given, ops=[SensingOperator(op.masks * given._gains, op.dtype) for op in ops])

    @property
    def _gains(self) -> np.ndarray:
        """The balance of each pixel of a mosaic in planes, (H, W)."""
        return self.mosaic.spread(self.balance.astype(self.op.dtype), self.measurements.shape)  # type: ignore[union-attr]

    def shown(self, videos: np.ndarray) -> np.ndarray:
        """Videos (..., B, H, W) as the user sees them: of mosaics in colour, (..., B, H, W, 3)."""
        if self.mosaic is None:
            return videos
        return self.mosaic.demosaic(videos) * self.balance.astype(videos.dtype)

    def modelled(self, init: Any) -> Any:
        """A first estimate as the solver takes it: an array, a colour video (..., B, H, W, 3) as a mosaic in planes."""
        if isinstance(init, str) or callable(init):
            return init
        video = real_array("init", init)
        if self.mosaic is None:
            return video
        if video.ndim not in (5, 6) or video.shape[-1] != 3:
            raise InputError(f"init has shape {video.shape}: a colour video (V, B, H, W, 3) was expected")
        check_cells("init", video.shape[:-1])
        return planes(self.mosaic.sample(video / self.balance))

    @property
    def op(self) -> SensingOperator:
        """The operator of the first measurement, and of all that have the same masks."""
        return self.ops[0]

    @property
    def each(self) -> list[SensingOperator]:
        """The operator of each measurement."""
        return self.ops if len(self.ops) > 1 else self.ops * len(self.measurements)

    def problems(self, sensor: Sensor, fits: list[Fit]) -> Iterator[Problem]:
        """Each measurement posed as a problem, without its bad pixels."""
        left_out: tuple[SensingOperator, np.ndarray, SensingOperator] | None = None  # many measurements share it
        for n, (whole, y, fit) in enumerate(zip(self.each, self.measurements, fits)):
            bad = np.zeros(y.shape, bool) if self.bad is None else self.bad[n]
            if self.find_bad:
                bad = bad | fit.bad
            if left_out is None or left_out[0] is not whole or not np.array_equal(bad, left_out[1]):
                left_out = whole, bad, without(whole, bad)
            problem = pose(left_out[2], self.largest, y, sensor, bad if bad.any() else None)
            wrapped = any(finding.kind == "wrapped" for finding in fit.findings)  # which nothing explains
            for _ in range(PASSES if self.find_bad and not wrapped else 0):  # what is left out misleads no longer
                if not (faint := unexplained(problem)).any():
                    break
                bad = bad | faint
                problem = pose(without(whole, bad), self.largest, y, sensor, bad)
            yield problem if self.mosaic is None else replace(problem, balance=self._gains)

    def registered(self, asked: bool | Registration, sensor: Sensor, masks: Any) -> tuple[Input, Sensor]:
        """The input with the masks, as given, where they are found to be, without black level; the sensor of that."""
        if asked and self.mosaic is not None:
            raise InputError("register is not for mosaics: register the masks beforehand, by pictures without colours")
        if asked and len(self.ops) > 1:
            raise InputError("register needs masks (V, B, H, W) for all measurements, but each has its own")
        registration = registration_for(asked, self.measurements, masks)
        if registration is None:
            return self, sensor
        black, full = registration.black_level, sensor.full_scale
        measurements = registration.correct(self.measurements)
        if self.bad is not None:
            measurements = np.where(self.bad, 0, measurements)
        if full is not None and full > black:
            sensor = replace(sensor, full_scale=full - black, black_level=max(sensor.black_level + black, 0.0))
        op, largest = check_operator(registration.masks, measurements)
        return replace(self, measurements=measurements, ops=[op], largest=largest, registration=registration), sensor

    def found(self, scene: dict[str, Any], fit: Fit, remarks: Sequence[str] = ()) -> dict[str, Any]:
        """What was found of a scene, with how its measurement fits, and where the masks are; after other remarks."""
        of_scene = [*scene["remarks"], *_of_light(scene["light"] or []), *fit.warnings]
        remarks = [*remarks, *_of_axes(self.op.shape), *of_scene]
        if self.registration is None:
            return scene | {"fit": fit.describe(), "remarks": remarks}
        remarks.append(f"register: {self.registration.in_words()}")
        return scene | {"fit": fit.describe(), "register": self.registration.describe(), "remarks": remarks}

    def check(self, sensor: Sensor) -> list[Fit]:
        """How each measurement fits the masks; what is wrong is logged."""
        fits = check_all(self.ops, self.measurements, sensor, self.bad, warn_of_bad=not self.find_bad)
        if not _told.get():
            for text in _of_axes(self.op.shape):
                _log.warning("%s", text)
            for text, numbers in _by_warning(fits).items():
                several = f"measurement{'s' * (len(numbers) > 1)} {counted(numbers)}: "
                _log.warning("%s%s", several if len(fits) > 1 else "", text)
        return fits


def _of_axes(shape: tuple[int, ...]) -> list[str]:
    """A remark on masks (V, B, H, W) whose views may be frames: more than any camera has, and more than frames."""
    views, frames = shape[:2]
    if views <= max(MOST_VIEWS, frames):
        return []
    text = f"masks have {views} views of {frames} frame{'s' * (frames > 1)}, as (views, frames, rows, columns)"
    return [f"{text}: if it is the other way round, give masks.swapaxes(-4, -3)"]


def _of_light(light: list[list[float]]) -> list[str]:
    """A remark on each view whose frames are lit unequally."""
    return [
        f"light: of view {v} frames are lit by {min(frames):.2f} to {max(frames):.2f} of their mean"
        for v, frames in enumerate(light, 1)
        if min(frames) < max(frames)
    ]


@contextmanager
def told() -> Iterator[None]:
    """What is wrong with a measurement has been logged already: it is not repeated."""
    token = _told.set(True)
    try:
        yield
    finally:
        _told.reset(token)


def _by_warning(fits: list[Fit]) -> dict[str, list[int]]:
    """Each kind of warning, as the first measurement has it, with the numbers of all that have it."""
    texts: dict[str, tuple[str, list[int]]] = {}
    for n, fit in enumerate(fits):
        for finding in fit.findings:
            texts.setdefault(finding.kind, (str(finding), []))[1].append(n)
    return dict(texts.values())
