"""Which method is worth the seconds there are: from curves of quality against time that were measured before."""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._validate import shown, whole
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.plugins.registry import LEARNED
from pnp_sci.plugins.resolve import as_prior
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.iterate import iterate

MEASURED = Path(__file__).parent / "measured.json"  # made by `pnp-sci bench`; see docs/results/speed.md
USUAL = {"init": "auto", "algorithm": "gap", "effort": "balanced"}  # of `solve`, left out of a recommendation
PLAIN = {"prior", "init", "iterations"}
OF_ANY_SIZE = ("auto", "adjoint")  # first estimates
KEYS = ("case", "method", "shape", "loading", "course", "settings", "machine")  # of a row, those that are read
WORTH = 0.25  # of a time budget: what loading PyTorch may take of it, so that networks are thought of at all


@dataclass(frozen=True)
class Recommendation:
    """What :func:`recommend` advises.

    Attributes
    ----------
    arguments : dict
        For :func:`pnp_sci.solve`, or with ``model`` for :func:`pnp_sci.decode`.
    seconds : float
        What a measurement will take on this machine, by estimate.
    psnr : float
        In dB, the mean over the cases it was measured on.
    cases : tuple of str
        Those cases.
    """

    arguments: dict[str, Any]
    seconds: float
    psnr: float
    cases: tuple[str, ...]

    @property
    def python(self) -> str:
        """The call, as text."""
        function = "decode" if "model" in self.arguments else "solve"
        words = ", ".join(f"{key}={value!r}" for key, value in self.arguments.items())
        return f"pnp_sci.{function}(y, masks, {words})"


def recommend(
    budget_seconds: float,
    like: str | Sequence[int] = "dualview",
    results: str | Path | None = None,
    *,
    loading: bool = False,
) -> Recommendation:
    """The method with the best PSNR among those that were done by then, where they were measured.

    Methods that need PyTorch count only where it is installed.

    Parameters
    ----------
    budget_seconds : float
        For one measurement.
    like : str or (V, B, H, W)
        A measured scene, a group ("dualview", "singleview"), or the size of your videos: then the cases with as many
        views serve, with seconds in proportion to the number of values.
    results : path, optional
        Of a file written by ``pnp-sci bench --out``; by default the measurements that come with the package.
    loading : bool
        Whether the budget must also cover what a new process loads first.

    Returns
    -------
    Recommendation
        Its ``arguments`` go to :func:`pnp_sci.solve`. Seconds are scaled to this machine by timing a few iterations,
        those of networks by timing a few convolutions, where the results say how quick these were.

    Raises
    ------
    InputError
        If the budget is not above 0 or less than the quickest method needs, or nothing `like` it was measured.
    FileNotFoundError, FormatError
        If there is no file `results`, or it holds none.

    Examples
    --------
    >>> advice = recommend(2.0, like=(2, 10, 128, 128))
    >>> advice.seconds <= 2.0
    True
    """
    if not (isinstance(budget_seconds, Real) and budget_seconds > 0):
        raise InputError(f"budget_seconds is {shown(budget_seconds)}: a number > 0 was expected")
    if not isinstance(like, str):
        like = _size(like)
    rows = _read(str(results or MEASURED))
    wait = _wait(rows) if loading and LEARNED[0] not in sys.modules else 0.0
    options = list(_options(rows, like, _installed(), wait))
    if not options:
        known = {row["case"]["scene"] for row in rows if _is_like(row, row["case"]["scene"])}
        names = ", ".join(["dualview", "singleview", *sorted(known)])
        expected = f"a size (views, frames, rows, columns), or one of these was expected: {names}"
        raise InputError(f"like is {shown(like)}: {expected}")
    within = [option for option in options if option.seconds <= budget_seconds]
    if not within:
        quickest = min(option.seconds for option in options)
        raise InputError(f"budget_seconds is {budget_seconds}: the quickest method needs {quickest:.3g}")
    return max(within, key=lambda option: (option.psnr, -option.seconds))


def prior_within(budget_seconds: float, shape: Sequence[int]) -> str:
    """The prior that has the best estimate by then from the first estimate it gets, "tv" if none has any.

    What it takes to find that out counts, too.
    """
    begin = time.perf_counter()
    rows = _read(str(MEASURED))
    networks = _installed() and (LEARNED[0] in sys.modules or _wait(rows) <= WORTH * budget_seconds)
    if networks:
        calibrate_networks()  # loads PyTorch, if that is still to be done
    options = [
        option
        for option in _options(rows, shape, networks)
        if option.arguments.keys() <= PLAIN
        and option.arguments.get("init", "auto") in OF_ANY_SIZE
        and option.arguments["prior"] != "auto"  # which is to be found out
    ]
    budget_seconds -= time.perf_counter() - begin
    within = [option for option in options if option.seconds <= budget_seconds]
    return max(within, key=lambda option: option.psnr).arguments["prior"] if within else "tv"


@dataclass(frozen=True)
class Moment:
    """What a method has reached, in the mean over cases: at which iteration, after how many seconds, what PSNR."""

    iteration: int
    seconds: float
    psnr: float


def course(rows: Sequence[dict[str, Any]]) -> list[Moment]:
    """The curve of one method over its cases; a run that has stopped stays what it is."""
    moments = []
    for iteration in sorted({point["iteration"] for row in rows for point in row["course"]}):
        reached = [[p for p in row["course"] if p["iteration"] <= iteration][-1] for row in rows]
        seconds, psnr = (float(np.mean([p[key] for p in reached])) for key in ("seconds", "psnr"))
        moments.append(Moment(iteration, seconds, psnr))
    return moments


def _options(
    rows: list[dict[str, Any]], like: str | Sequence[int], networks: bool, wait: float = 0.0
) -> Iterator[Recommendation]:
    """Every method at every checkpoint, on this machine; those with networks, if at all, so many seconds later."""
    alike = [row for row in rows if _is_like(row, like) and _serves(row, like)]
    key = lambda row: json.dumps(row["method"])  # noqa: E731
    groups = [list(group) for _, group in itertools.groupby(sorted(alike, key=key), key)]
    most = max(map(len, groups), default=0)
    for group in groups:
        if len(group) < most:  # a mean over other cases does not compare
            continue
        method, cases = group[0]["method"], tuple(row["case"]["scene"] for row in group)
        if _is_learned(method) and not networks:
            continue
        for moment in course([_here(row, like) for row in group]):
            if method["prior"] is None:
                arguments = {"model": method["init"]}
            else:
                # iterations say all that an effort does, but for what "auto" is
                usual = USUAL if method["prior"] == "auto" else USUAL | {"effort": method["effort"]}
                arguments = {k: v for k, v in method.items() if v != usual.get(k)} | {"iterations": moment.iteration}
            if moment.iteration or method["prior"] is None:
                seconds = moment.seconds + (wait if _is_learned(method) else 0.0)
                yield Recommendation(arguments, seconds, moment.psnr, cases)


def _here(row: dict[str, Any], like: str | Sequence[int]) -> dict[str, Any]:
    """The row with the seconds that it would have on this machine, and for videos of that size if `like` is one.

    All iterations of a prior with a network count as its network's, those too that it leaves to TV.
    """
    size = 1.0 if isinstance(like, str) else float(np.prod(like) / np.prod(row["shape"]))
    first = size * _slower(row, networks=_init(row) not in OF_ANY_SIZE)
    then = size * _slower(row, networks=_is_network(row["method"]["prior"]))
    start = row["course"][0]["seconds"]
    points = [point | {"seconds": start * first + (point["seconds"] - start) * then} for point in row["course"]]
    return row | {"course": points}


def _size(like: Any) -> tuple[int, ...]:
    """Views, frames, rows and columns."""
    size = tuple(whole("like", n, 1) for n in like) if np.shape(like) == (4,) else ()
    if not size:
        raise InputError(f"like is {shown(like)}: a scene, a group or (views, frames, rows, columns) was expected")
    return size


def _slower(row: dict[str, Any], networks: bool = False) -> float:
    """How many times as long things take on this machine as where a row was measured."""
    there = row["machine"]
    if networks and there.get("networks"):
        return calibrate_networks() / there["networks"]
    return calibrate() / there["calibration"]


def _init(row: dict[str, Any]) -> str:
    """The first estimate it was."""
    return row["settings"].get("init", row["method"]["init"])


def _serves(row: dict[str, Any], like: str | Sequence[int]) -> bool:
    """Whether videos of this size can be had so: a network is for as many views and frames as it was measured with."""
    return isinstance(like, str) or _init(row) == "adjoint" or row["shape"][:2] == list(like[:2])


def _installed() -> bool:
    """Whether networks can be had at all."""
    return all(map(find_spec, LEARNED))


def _wait(rows: list[dict[str, Any]]) -> float:
    """Seconds until PyTorch is loaded: the kernels of the other priors are there in no time."""
    return float(np.median([_slower(row) * row["loading"] for row in rows if _is_learned(row["method"])] or [0.0]))


def _is_learned(method: dict[str, Any]) -> bool:
    return method["prior"] is None or _is_network(method["prior"]) or method["init"] not in OF_ANY_SIZE


@cache
def _is_network(prior: str | None) -> bool:
    """Whether the prior of this name is a network; "auto", and one that is not installed, may be one."""
    try:
        return as_prior(prior).traits((2, 10, 256, 256)).network
    except (InputError, InputTypeError):
        return True


def _is_like(row: dict[str, Any], like: str | Sequence[int]) -> bool:
    known = all(point["psnr"] is not None for point in row["course"])
    clean = row["case"]["noise"] is None and row["case"]["frames"] is None
    if isinstance(like, str):
        groups = {"dualview": row["shape"][0] == 2, "singleview": row["shape"][0] == 1}
        return known and clean and (row["case"]["scene"] == like or groups.get(like, False))
    return known and clean and (row["shape"][0] == 1) == (like[0] == 1)


@cache
def _read(path: str) -> list[dict[str, Any]]:
    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: there is no such file")
    try:
        rows = json.loads(Path(path).read_text(encoding="utf-8"))["rows"]
        if missing := [key for key in KEYS for row in rows if key not in row]:
            raise KeyError(missing[0])
        return rows
    except (ValueError, KeyError, TypeError) as error:
        why = f"{type(error).__name__}: {error}"  # of an error in text, repr would show all bytes of the file
        raise FormatError(f"{path} holds no results of `pnp-sci bench`: {why}") from error


@cache
def calibrate() -> float:
    """Seconds that ten iterations with TV take here on 2 x 10 frames of 128 x 128, at best within a tenth of a second.

    Others on the machine make a lap take up to twice as long.
    """
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random((2, 10, 128, 128)) < 0.5)
    x, tv = np.full(op.shape, 0.5, np.float32), as_prior("tv")
    y = op.forward(x)

    def lap() -> float:
        begin = time.perf_counter()
        for _ in itertools.islice(iterate(op, y, tv, x), 11):
            pass
        return time.perf_counter() - begin

    return _least(lap)


@cache
def calibrate_networks() -> float:
    """Seconds that two convolutions of 32 channels take here on four frames of 128 x 128, at best likewise.

    Beside TV, networks take a third of the time where there is arithmetic in half precision. Needs PyTorch.
    """
    import torch

    from pnp_sci.accel.inference import ready, running

    place = torch.device("cpu")
    with torch.random.fork_rng(devices=[]):  # whoever draws from torch's generator sees no difference
        layers = [torch.nn.Conv2d(32, 32, 3, padding=1), torch.nn.ReLU(), torch.nn.Conv2d(32, 32, 3, padding=1)]
    network, x = ready(torch.nn.Sequential(*layers), place), torch.ones(4, 32, 128, 128)
    x = x.contiguous(memory_format=torch.channels_last)

    def lap() -> float:
        begin = time.perf_counter()
        network(x)
        return time.perf_counter() - begin

    with running(place):
        return _least(lap)


def _least(lap: Callable[[], float]) -> float:
    """The shortest of those laps, after one that compiles, that can be run in a tenth of a second; of two at least."""
    lap()
    end = time.perf_counter() + 0.1
    laps = [lap(), lap()]
    while time.perf_counter() < end:
        laps.append(lap())
    return min(laps)
