"""Comparison of methods on one measurement, with or without the truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.bench.held_back import held_back_score
from pnp_sci.bench.methods import Method, Source
from pnp_sci.bench.runner import machine, scores
from pnp_sci.camera.fit import Fit
from pnp_sci.errors import InputError
from pnp_sci.formats.plain import finite
from pnp_sci.masks import condition
from pnp_sci.pipeline.input import Input, told
from pnp_sci.pipeline.progress import bar
from pnp_sci.pipeline.reference import Reference
from pnp_sci.results.result import Result
from pnp_sci.scene.choose import choose_scene
from pnp_sci.sensing.operator import as_masks
from pnp_sci.sensing.problem import check_noise, measured
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor


@dataclass(frozen=True, eq=False)
class Trial:
    """The result of one method.

    Attributes
    ----------
    method : Method
    python : str
        Python code that reproduces the result.
    command : str or None
        Command line that reproduces the result; None of a decoder, and if the files are unknown.
    result : Result or None
        None if the method failed.
    error : str or None
        Message of the failure.
    score : float or None
        See :func:`pnp_sci.bench.held_back_score`.
    psnr, ssim : tuple of float
        One value per view; empty without truth.
    """

    method: Method
    python: str
    command: str | None
    result: Result | None = None
    error: str | None = None
    score: float | None = None
    psnr: tuple[float, ...] = ()
    ssim: tuple[float, ...] = ()

    @property
    def quality(self) -> float | None:
        """Mean PSNR over the views in dB, or the score without truth."""
        return float(np.mean(self.psnr)) if self.psnr else self.score

    def row(self) -> dict[str, Any]:
        """All values except the video, for JSON."""
        row: dict[str, Any] = {"name": self.method.name, **asdict(self.method), "error": self.error}
        if self.result is not None:
            last = self.result.history[-1]
            row |= {
                "seconds": self.result.settings["seconds"],
                "iterations_done": last.iteration,
                "status": self.result.status.value,
                "remarks": self.result.remarks,
                "residual": last.residual,
                "score": self.score,
                "psnr": list(self.psnr),
                "ssim": list(self.ssim),
                "settings": self.result.settings,
            }
        return row | {"python": self.python, "command": self.command}


@dataclass(frozen=True, eq=False)
class Comparison:
    """The result of :func:`compare`.

    Attributes
    ----------
    y : ndarray, (H, W)
    trials : tuple of Trial
        In the order of the methods.
    truth : ndarray or None
        (V, B, H, W), with white at 1; None if it is unknown.
    white : float
        Value of the videos that is displayed as white.
    facts : dict
        Description of the measurement: names and texts.
    fit : Fit
        How the measurement and the masks fit.
    machine : dict
        See :func:`pnp_sci.bench.runner.machine`.
    """

    y: np.ndarray
    trials: tuple[Trial, ...]
    truth: np.ndarray | None
    white: float
    facts: dict[str, str]
    fit: Fit
    machine: dict[str, Any] = field(default_factory=machine)

    def as_json(self) -> str:
        """Rows with their settings, facts and machine as JSON; NaN becomes null."""
        rows = [trial.row() for trial in self.trials]
        return json.dumps(finite({"machine": self.machine, "measurement": self.facts, "rows": rows}), indent=2)

    def save_html(self, path: str | Path, title: str = "Comparison of reconstructions") -> None:
        """Write a self-contained HTML report, see :mod:`pnp_sci.bench.report`."""
        from pnp_sci.bench.report import write

        write(path, self, title)


def compare(
    y: Any,
    masks: Any,
    methods: Sequence[Method],
    *,
    reference: Any = None,
    source: Source | None = None,
    progress: bool = False,
    noise: float | str | Sensor = "auto",
    seed: int = 0,
    device: str | None = None,
    bad: Any = None,
) -> Comparison:
    """Run several methods on one measurement.

    Each method runs twice. The first run, with some pixels held back, gives the score and does all loading and
    compilation. The second run gives the video and the seconds. A failure is recorded in the method's trial.

    Parameters
    ----------
    y : array_like, (H, W)
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
    methods : sequence of Method
    reference : array_like, optional
        The truth, as for :func:`pnp_sci.solve`.
    source : Source, optional
        The files of y and masks, for the command lines.
    progress : bool
        Whether to show a progress bar.
    noise, seed, device, bad
        As for :func:`pnp_sci.solve`, for all methods.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError, InputTypeError
        If y, masks, noise or the reference cannot be used, or there are no methods.

    Examples
    --------
    >>> import pnp_sci
    >>> from pnp_sci.bench import grid
    >>> scene = pnp_sci.datasets.embedded_scene(32)
    >>> both = compare(scene.y, scene.masks, grid(["tv", "none"], iterations=5), reference=scene.truth)
    >>> tv, none = both.trials
    >>> tv.score > none.score, tv.quality > none.quality
    (True, True)
    """
    if np.ndim(y) != 2:
        raise InputError(f"y has shape {np.shape(y)}: one measurement (rows, columns) was expected")
    if not methods:
        raise InputError("methods is empty: one at least was expected")
    task = _Task.of(y, masks, reference, {"noise": noise, "seed": seed, "device": device}, source, bad)
    with told():
        trials = tuple(task.attempt(method) for method in bar(methods, desc="compare", shown=progress, leave=False))
    if task.truth is not None:
        truth, white = task.truth.array[0] / task.truth.white, task.truth.white
    else:
        whites = [trial.result.white for trial in trials if trial.result is not None]
        truth, white = None, float(np.median(whites or [1.0]))
    return Comparison(task.y, trials, truth, white, task.facts(), task.fit)


@dataclass(frozen=True, eq=False)
class _Task:
    """The measurement, its noise and scene, and the settings common to all methods."""

    y: np.ndarray
    masks: Any  # unconverted, so that the hash in the settings is that of the file
    planes: np.ndarray  # the masks as (V, B, H, W)
    unit: float  # value of x that corresponds to 1 in the solver's units
    noise: float  # standard deviation in the units of y
    sensor: Sensor  # with the estimated read noise if it is "auto"
    saturated: np.ndarray | None
    bad: np.ndarray | None
    fit: Fit
    scene: SceneModel
    truth: Reference | None
    common: dict[str, Any]
    source: Source | None

    @classmethod
    def of(cls, y: Any, masks: Any, reference: Any, common: dict[str, Any], source: Source | None, bad: Any) -> _Task:
        planes = as_masks(masks)
        given = Input.of(y, planes, bad)
        op, (picture,) = given.op, given.measurements
        sensor = check_noise(common["noise"])
        (fit,) = fits = given.check(sensor)
        (problem,) = given.problems(sensor, fits)
        return cls(
            picture,
            masks,
            planes,
            float(problem.unit),
            problem.typical_noise * float(problem.unit) * given.largest,
            measured(sensor, problem.op, picture, problem.bad),
            problem.saturated,
            problem.bad,
            fit,
            choose_scene("auto", problem),
            None if reference is None else Reference(reference, (1, *op.shape)),
            common,
            source,
        )

    def attempt(self, method: Method) -> Trial:
        words = method.python(self.source, **self.common), method.command(self.source, **self.common)
        try:
            score = self.score(method)
            result = method.run(self.y, self.masks, **self.common, bad=self.bad)
        except Exception as error:  # an error in a plugin must not end the comparison
            return Trial(method, *words, error=" ".join(str(error).split()) or type(error).__name__)
        if self.truth is None:
            return Trial(method, *words, result, None, score)
        psnr, ssim = scores(result.x / self.truth.white, self.truth.array[0] / self.truth.white)
        return Trial(method, *words, result, None, score, psnr, ssim)

    def score(self, method: Method) -> float:
        """The held-back score; noise, not lowered, and scene are those of all pixels, equal for all methods."""
        settings = self.common | {"noise": self.sensor, "scene": self.scene}
        planes = self.planes if self.bad is None else self.planes * ~self.bad
        return held_back_score(
            lambda y, masks: method.run(y, masks, **settings).x,
            self.y if self.bad is None else self.y * ~self.bad,
            planes,
            noise=self.noise,
            white=self.unit,
            saturated=self.saturated,
        )

    def facts(self) -> dict[str, str]:
        report = condition(self.planes)
        known = "estimated" if check_noise(self.common["noise"]).read_noise == "auto" else "given"
        views, frames, rows, columns = self.planes.shape
        lines = [line.split(": ", 1) for line in str(report).splitlines() if not line.startswith("Warning")]
        return {
            "Size": f"{views} view{'s' * (views != 1)} x {frames} frames of {rows} x {columns} in one picture",
            "Values": f"{self.y.min():.4g} to {self.y.max():.4g}",
            "Noise": f"{self.noise:.3g} (standard deviation, {known})",
            "Scene": self.scene.reason,
            **({} if self.bad is None else {"Bad": f"{self.bad.mean():.2%} of the pixels"}),
            **({} if self.saturated is None else {"Saturated": f"{self.saturated.mean():.2%} of the pixels"}),
            **dict(lines),
            **({"Warnings": "; ".join(warnings)} if (warnings := (*report.warnings, *self.fit.warnings)) else {}),
        }
