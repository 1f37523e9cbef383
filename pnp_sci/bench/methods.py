"""Reconstruction methods by name, and the Python code and command lines that reproduce them."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

from pnp_sci import api
from pnp_sci.errors import InputError, UnknownPluginError
from pnp_sci.plugins import registry
from pnp_sci.results.result import Result
from pnp_sci.sensing.sensor import Sensor

OF_DECODE = ("noise", "scene", "bad", "mosaic")  # arguments of `solve` that `decode` has too


@dataclass(frozen=True)
class Source:
    """The files of the measurement and the masks, to reproduce a row.

    Attributes
    ----------
    measurement, masks : path
    views, key, masks_key, index, bad, bad_key : optional
        As for ``pnp-sci solve``.
    calibration : path, optional
        It makes the measurement of a raw picture, and has the masks.
    full_scale : float, optional
        The camera's largest value in the raw picture, if it is not that of the calibration.
    each : bool
        Whether the file has masks of each measurement, of which those of `index` are meant.
    """

    measurement: Path
    masks: Path
    views: int | None = None
    key: str | None = None
    masks_key: str | None = None
    index: int | None = None
    bad: str | None = None
    each: bool = False
    calibration: Path | None = None
    full_scale: float | None = None
    bad_key: str | None = None

    def python(self) -> str:
        """Python code that reads both files."""
        lines = ["import pnp_sci", "from pnp_sci import io", ""]
        chosen = "" if self.index is None else f"[{self.index}]"
        y = _call("io.read_measurement", repr(str(self.measurement)), key=self.key)
        if self.calibration is not None:
            lines.append(f"calibration = pnp_sci.Calibration.load({str(self.calibration)!r})")
            if self.full_scale is not None:
                lines = ["import dataclasses", "", *lines]
                lines.append(f"calibration = dataclasses.replace(calibration, full_scale={self.full_scale})")
            y = f"calibration.correct({y})"
        masks = _call("io.read_masks", repr(str(self.masks)), views=self.views, key=self.masks_key)
        lines += [f"y = {y}{chosen}", f"masks = {masks}{chosen * self.each}"]
        if self.bad == "auto":
            lines.append("bad = 'auto'")
        elif self.bad is not None:
            lines.append(f"bad = {_call('io.read_bad', repr(self.bad), key=self.bad_key)}")
            if chosen:
                lines.append(f"bad = bad{chosen} if bad.ndim == 3 else bad")
            if self.calibration is not None:
                lines += ["if bad.shape != y.shape:", "    bad = calibration.cropped('bad', bad)"]
        return "\n".join([*lines, ""])

    def command(self) -> list[str]:
        """Words of the command line before the options of the method."""
        options = {"views": self.views, "key": self.key, "masks_key": self.masks_key, "index": self.index}
        options |= {"bad": self.bad, "bad_key": self.bad_key, "calibration": self.calibration}
        options |= {"masks": self.masks if self.masks != self.calibration else None}
        return ["pnp-sci", "solve", str(self.measurement), *_options(options)]


@dataclass(frozen=True)
class Method:
    """A reconstruction method given by names.

    Attributes
    ----------
    prior : str or None
        As for :func:`pnp_sci.solve`; None is the decoder `init` without a solver.
    init, algorithm, effort : str
        As for :func:`pnp_sci.solve`.
    iterations : int, optional
        Largest number of iterations; by default that of `effort`.
    """

    prior: str | None
    init: str = "auto"
    algorithm: str = "gap"
    effort: str = "balanced"
    iterations: int | None = None

    @property
    def name(self) -> str:
        """The prior, and the settings that are not the default.

        >>> Method("flow").name, Method("tv", init="ofanet", effort="fast").name
        ('flow', 'tv from ofanet, fast')
        """
        if self.prior is None:
            return f"{self.init} alone"
        usual = Method(self.prior)
        words = [self.prior if self.init == usual.init else f"{self.prior} from {self.init}"]
        words += [getattr(self, key) for key in ("algorithm", "effort") if getattr(self, key) != getattr(usual, key)]
        if self.iterations is not None:
            words.append(f"{self.iterations} iteration{'s' * (self.iterations != 1)}")
        return ", ".join(words)

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of :func:`pnp_sci.solve`, or of :func:`pnp_sci.decode` without a prior."""
        if self.prior is None:
            return {"model": self.init}
        return {key: value for key, value in asdict(self).items() if value is not None}

    def run(self, y: Any, masks: Any, **common: Any) -> Result:
        """Reconstruct a measurement.

        `common` are further arguments of :func:`pnp_sci.solve`. A decoder gets those that concern it.
        """
        function = api.decode if self.prior is None else api.solve
        return function(y, masks, **self._with(common))

    def python(self, source: Source | None, **common: Any) -> str:
        """Python code of :meth:`run`, after the lines that read the source, if any."""
        read = source.python() if source else ""
        words = ("y", "masks", "bad=bad") if source and source.bad else ("y", "masks")
        function = "pnp_sci.decode" if self.prior is None else "pnp_sci.solve"
        return f"{read}result = {_call(function, *words, **self._with(common))}"

    def command(self, source: Source | None, **common: Any) -> str | None:
        """Command line of :meth:`run`; None without a prior or without files."""
        if source is None or self.prior is None:
            return None
        noise = common.get("noise")
        if isinstance(noise, Sensor):
            camera = {"noise": noise.read_noise, "gain": noise.gain or None}
            full_scale = noise.full_scale if source.calibration is None else source.full_scale
            common = common | camera | {"full_scale": full_scale, "bits": noise.bits}
        return shlex.join([*source.command(), *_options(self.arguments() | common)])

    def _with(self, common: dict[str, Any]) -> dict[str, Any]:
        """The arguments of the method, and those of `common` that its function takes."""
        if self.prior is not None:
            return self.arguments() | common
        taken = {*OF_DECODE, *(("device",) if common.get("device") and _takes_device(self.init) else ())}
        return self.arguments() | {name: value for name, value in common.items() if name in taken}


def grid(
    priors: Iterable[str],
    inits: Iterable[str] = ("auto",),
    algorithms: Iterable[str] = ("gap",),
    efforts: Iterable[str] = ("balanced",),
    iterations: int | None = None,
    decoders: Iterable[str] = (),
) -> list[Method]:
    """The decoders without a solver, then all distinct combinations of the other arguments.

    An InputError if one of them is a single name instead of a sequence of names.

    >>> [method.name for method in grid(["tv", "flow"], efforts=["fast", "balanced"])]
    ['tv, fast', 'tv', 'flow, fast', 'flow']
    """
    given = {"priors": priors, "inits": inits, "algorithms": algorithms, "efforts": efforts, "decoders": decoders}
    for argument, names in given.items():
        if isinstance(names, str):
            raise InputError(f"{argument} is {names!r}: a sequence of names was expected, such as [{names!r}]")
    alone = [Method(None, init=decoder) for decoder in decoders]
    combinations = product(priors, inits, algorithms, efforts)
    return list(dict.fromkeys([*alone, *(Method(*combination, iterations) for combination in combinations)]))


def _takes_device(decoder: str) -> bool:
    try:
        return "device" in inspect.signature(registry.load("decoders", decoder)).parameters
    except UnknownPluginError:  # `decode` raises it
        return False


def _call(function: str, *positional: str, **keywords: Any) -> str:
    """Text of a function call; keywords that are None are left out.

    >>> _call("io.read_masks", repr("a.mat"), views=2, key=None)
    "io.read_masks('a.mat', views=2)"
    """
    words = [*positional, *(f"{key}={value!r}" for key, value in keywords.items() if value is not None)]
    return f"{function}({', '.join(words)})"


def _options(settings: dict[str, Any]) -> list[str]:
    """Words of a command line; options that are None are left out.

    >>> _options({"masks_key": "C", "views": None, "seed": 0})
    ['--masks-key', 'C', '--seed', '0']
    """
    pairs = ((f"--{key.replace('_', '-')}", str(value)) for key, value in settings.items() if value is not None)
    return [word for pair in pairs for word in pair]
