"""What is asked of ``solve``, checked: everything but the measurement and its masks."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pnp_sci._validate import finite_number, instance, one_of, whole
from pnp_sci.advice.recommend import prior_within
from pnp_sci.camera.registration import Registration
from pnp_sci.errors import InputError
from pnp_sci.formats.plain import as_json
from pnp_sci.pipeline.auto import prior_for
from pnp_sci.pipeline.place import backend_for
from pnp_sci.pipeline.sequence import FEWEST, MOST
from pnp_sci.plugins.combine import Stages
from pnp_sci.plugins.mosaic import mosaicked
from pnp_sci.plugins.protocols import Prior
from pnp_sci.plugins.resolve import as_prior
from pnp_sci.sensing.mosaic import Mosaic
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import check_noise, check_scene
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor
from pnp_sci.solvers.backend import Backend
from pnp_sci.solvers.effort import EFFORTS
from pnp_sci.solvers.iterate import ALGORITHMS


@dataclass(frozen=True, eq=False)
class Request:
    """The options of :func:`pnp_sci.solve`, checked; `name` is the prior as JSON can hold it."""

    prior: Prior
    name: Any
    prior_options: dict[str, Any]
    init: Any
    algorithm: str
    effort: str
    counted: str  # the effort whose number of iterations holds
    scene: str | SceneModel
    iterations: int | None
    sensor: Sensor
    sigma: float | None
    tol: float
    time_budget: float | None
    device: str | None
    backend: Backend
    threads: int | None
    seed: int
    register: bool | Registration
    uncertainty: bool
    sequence: int  # measurements that are solved together at most: 1 if each is solved alone
    mosaic: Mosaic | None  # videos are mosaics in planes

    def init_of(self, n: int) -> Any:
        """The first estimate of the n-th measurement: `init`, or of an array (N, V, B, H, W) its own."""
        return self.init[n] if getattr(self.init, "ndim", 0) == 5 else self.init

    def cropped(self, where: tuple[slice, slice]) -> Request:
        """The request for a part of the picture, rows and columns."""
        return self if getattr(self.init, "ndim", 0) < 4 else replace(self, init=self.init[(..., *where)])

    def settings(self) -> dict[str, Any]:
        """For `Result.settings`: equal to what is read back from a file."""
        settings = {
            "prior": self.name,
            "prior_options": as_plain(self.prior_options),
            "algorithm": self.algorithm,
            "effort": self.effort,
            "scene": self.scene if isinstance(self.scene, str) else asdict(self.scene),
            "sensor": asdict(self.sensor),
            "sigma": self.sigma,
            "tol": self.tol,
            "time_budget": self.time_budget,
            "device": self.device,
            "backend": self.backend.name,
            "threads": self.threads,
            "seed": self.seed,
            "register": bool(self.register),
            "uncertainty": self.uncertainty,
            "sequence": self.sequence,
            "mosaic": self.mosaic and self.mosaic.pattern,
        }
        return json.loads(as_json(settings))


def check_request(
    op: SensingOperator,
    count: int,
    *,
    prior: Any,
    prior_options: dict[str, Any],
    init: Any,
    algorithm: Any,
    effort: Any,
    scene: Any,
    iterations: Any,
    noise: Any,
    sigma: Any,
    tol: Any,
    time_budget: Any,
    callback: Any,
    progress: Any,
    device: Any,
    backend: Any,
    threads: Any,
    seed: Any,
    register: Any,
    uncertainty: Any,
    sequence: Any,
    mosaic: Mosaic | None = None,
) -> Request:
    """The request for `count` measurements with this operator; errors name the argument."""
    sensor = check_noise(noise)
    one_of("algorithm", algorithm, ALGORITHMS)
    one_of("effort", effort, EFFORTS)
    check_scene(scene, op)
    tol, seed = finite_number("tol", tol), whole("seed", seed, 0)
    iterations = None if iterations is None else whole("iterations", iterations, 1, sys.maxsize)
    threads = None if threads is None else whole("threads", threads, 1)
    time_budget = None if time_budget is None else finite_number("time_budget", time_budget)
    sigma = None if sigma is None else finite_number("sigma", sigma)
    instance("callback", callback, Callable)  # type: ignore[arg-type]
    instance("progress", progress, bool)
    instance("uncertainty", uncertainty, bool)
    instance("device", device, str)
    placed = backend_for(backend, device)
    instance("register", register, bool, Registration)
    counted = effort
    if isinstance(prior, str) and prior == "auto":
        within = time_budget is not None
        prior = prior_within(time_budget / count / (1 + uncertainty), op.shape) if within else prior_for(effort)
        counted = "best" if within else effort
    if getattr(init, "ndim", 0) == 5 and len(init) != count:
        raise InputError(f"init has shape {init.shape}: one video, or {count} as there are measurements, was expected")
    made = as_prior(prior, device=device, seed=seed, **prior_options)
    name = describe(prior, made)
    if mosaic is not None:
        if uncertainty:
            raise InputError("uncertainty is True, but it cannot be predicted for mosaics")
        made = mosaicked(made, mosaic)
    return Request(
        made, name, prior_options, init, algorithm, effort, counted, scene, iterations, sensor, sigma,
        tol, time_budget, device, placed, threads, seed, register, uncertainty,
        _together(sequence, op.shape, count), mosaic,
    )  # fmt: skip


def _together(sequence: Any, shape: tuple[int, ...], count: int) -> int:
    """How many measurements are solved together: as memory allows, or as `sequence` says."""
    if isinstance(sequence, bool) or (isinstance(sequence, int) and sequence == 1):  # 1 is of the settings of a result
        return max(MOST // int(np.prod(shape)), FEWEST) if sequence is True and count > 1 else 1
    return whole("sequence", sequence, FEWEST)


def describe(prior: Any, made: Prior) -> Any:
    """A `prior` argument as JSON can hold it: by name where it has one, so that it can be given again."""
    if isinstance(prior, str):
        return prior
    if isinstance(made, Stages) and prior is not made:
        return [[describe(p, d), int(c)] for (p, c), (d, _) in zip(prior, made.stages)]
    return repr(prior)


def as_plain(options: dict[str, Any]) -> dict[str, Any]:
    """Options as JSON can hold them."""
    return {k: v if v is None or isinstance(v, (bool, int, float, str)) else repr(v) for k, v in options.items()}
