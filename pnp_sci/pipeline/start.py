"""The solver's first estimate."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pnp_sci._validate import require_finite, shaped
from pnp_sci.errors import FormatError, InputError
from pnp_sci.pipeline.auto import DECODER
from pnp_sci.plugins.mosaic import decoded
from pnp_sci.plugins.protocols import Traits
from pnp_sci.plugins.resolve import FunctionDecoder, decoder_for
from pnp_sci.sensing.problem import Problem, filled, level
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.solvers.pace import LITTLE, SIDE
from pnp_sci.solvers.state import length, missing
from pnp_sci.solvers.stopping import EXPLODED

CANCELS = 1.25  # times what a decoder's estimate measures: what its magnitudes may; those of real scenes reach 1.05


@dataclass(frozen=True, eq=False)
class Start:
    """A first estimate.

    Attributes
    ----------
    name : str
        As `init` had it, or the type of the object that it was.
    x : ndarray, (V, B, H, W)
        In the problem's units.
    decoded : bool
        Whether an installed decoder has made it: then it counts in the result of a noisy measurement.
    remarks : list of str
        What to know of it before a result is used.
    """

    name: str
    x: np.ndarray
    decoded: bool = False
    remarks: list[str] = field(default_factory=list)


Decode = Callable[[Problem, SceneModel], np.ndarray]
_seconds: dict[Hashable, float] = {}  # least that a decoder has taken for each value of x in this process
_guessed: set[Hashable] = set()  # those of `_seconds` that are from crops
_warm: set[Hashable] = set()  # decoders that have been loaded


def may_decode(traits: Traits, deadline: float | None) -> bool:
    """Whether "auto" may be a decoder: with a strong prior, but no deadline is spent on PyTorch for it alone."""
    return traits.strong and (traits.network or deadline is None or "torch" in sys.modules)


def first_estimate(
    init: Any,
    problem: Problem,
    scene: SceneModel,
    decode: bool = False,
    device: str | None = None,
    deadline: float | None = None,
) -> Start:
    """The start that an `init` argument of :func:`pnp_sci.solve` stands for.

    With `decode` "auto" is a quick decoder, where PyTorch and weights that serve such masks are installed. One that
    takes a `device` runs there. In place of one that would miss the `deadline` comes "adjoint".
    """
    if isinstance(init, str) and init == "auto":
        try:
            return first_estimate(DECODER if decode else "adjoint", problem, scene, False, device, deadline)
        except FormatError:  # weights that are damaged
            raise
        except InputError:  # not installed, or no weights that serve such masks
            return first_estimate("adjoint", problem, scene)
    if isinstance(init, str) and init == "adjoint":
        return Start(init, level(problem.op, problem.y))
    if isinstance(init, str):
        return _decoded(init, problem, scene, device, deadline)
    if callable(init):
        x = decoded(decoder_for("init", init, {}), problem, scene)
    else:
        with np.errstate(all="ignore"):  # what the type cannot hold is told below
            video = shaped("init", init, problem.op.shape, np.dtype(np.float64))
            x = video / np.asarray(problem.unit, np.float64)
    x = _checked(x, problem)
    residual = length(missing(problem.y - problem.op.forward(x), problem.saturated)) / (length(problem.y) or 1.0)
    if not residual <= (EXPLODED if problem.y.any() else sys.float_info.max):
        raise InputError(f"init leaves {residual:.3g} times y as residual: an estimate in the units of y was expected")
    return Start(type(init).__name__, x)


def _decoded(name: str, problem: Problem, scene: SceneModel, device: str | None, deadline: float | None) -> Start:
    """What the decoder of this name makes, or "adjoint" where it would miss the deadline or explodes."""
    known = decoder_for("init", name, {}, device)

    def decoder(problem: Problem, scene: SceneModel) -> np.ndarray:
        """With unlit pixels filled: a decoder cannot see them, and a solver takes long to fill them."""
        seen = (~problem.op.unlit).astype(problem.op.dtype)
        return filled(_checked(known(problem, scene), problem) * seen, seen)

    def decode(problem: Problem, scene: SceneModel) -> np.ndarray:
        return decoded(FunctionDecoder(decoder), problem, scene)

    def adjoint(why: str) -> Start:
        return Start("adjoint", level(problem.op, problem.y), remarks=[f"init: {why}: 'adjoint' was taken"])

    key, size = (name, device, problem.op.shape[:2], scene.nothing_moves), problem.op.masks.size
    if deadline is not None:
        needed = _needed(key, decode, problem, scene, deadline)
        if needed + time.perf_counter() > deadline:
            return adjoint(f"{name!r} takes about {needed:.2g} s, which the time budget has not")
    x, lasted = _timed(decode, problem, scene)
    if key in _warm:
        _learn(key, lasted / size)
    _warm.add(key)
    if why := exploded(scene.expand(scene.restrict(x), x.shape), problem):
        return adjoint(f"what {name!r} makes of y {why}")
    return Start(name, x, decoded=True)


def exploded(x: np.ndarray, problem: Problem) -> str:
    """How an estimate x shows that it is not of y, in words; "" if it does not.

    A network that sees what it was not trained for, such as points of light ten times as bright as the rest, may make
    large values of either sign. They cancel each other in y, or leave more of it than a video of zeros does.
    """
    if not problem.y.any():
        return ""
    light = problem.op.forward(x)
    left = length(missing(problem.y - light, problem.saturated)) / length(problem.y)
    if not left <= 1:
        return f"leaves {left:.3g} times y as residual"
    excess = length(problem.op.forward(np.abs(x))) / (length(light) or 1.0)
    if excess > CANCELS and not problem.op.signed:
        return f"cancels itself ({excess:.3g} times as much light)"
    return ""


def _needed(key: Hashable, decode: Decode, problem: Problem, scene: SceneModel, deadline: float) -> float:
    """Seconds that the decoder needs: from its runs in this process, else from two crops, as it takes a part anyway.

    If these would miss the deadline, they are tried again if that takes little time: the machine may have been busy.
    """
    small, part = (problem.crop((slice(0, side), slice(0, side))) for side in (SIDE // 2, SIDE))
    size, n, left = problem.op.masks.size, part.op.masks.size, deadline - time.perf_counter()
    known = _seconds.get(key, 0.0)
    if not known or (key in _guessed and known * size > left and known * n < LITTLE * left):
        if key not in _warm:
            decode(part, scene)  # loads
        _warm.add(key)
        few, more = (_timed(decode, crop, scene)[1] for crop in (small, part))
        slope = max(more - few, 0.0) / max(n - small.op.masks.size, 1)
        _seconds[key] = (more + slope * (size - n)) / size
        _guessed.add(key)
    return _seconds[key] * size


def _learn(key: Hashable, seconds: float) -> None:
    """Keep what a run has taken for each value: the least of all runs, others on the machine only slow it down."""
    _seconds[key] = seconds if key in _guessed else min(seconds, _seconds.get(key, seconds))
    _guessed.discard(key)


def _timed(decode: Decode, problem: Problem, scene: SceneModel) -> tuple[np.ndarray, float]:
    begin = time.perf_counter()
    return decode(problem, scene), time.perf_counter() - begin


def _checked(x: Any, problem: Problem) -> np.ndarray:
    x = shaped("init", x, problem.op.shape, problem.op.dtype)
    require_finite("init", x)
    return x
