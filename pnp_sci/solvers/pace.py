"""How long iterations take on this machine, so that none is begun that cannot be finished in time."""

from __future__ import annotations

import itertools
import time
from collections.abc import Hashable, Sequence
from dataclasses import astuple, replace

import numba
import numpy as np

from pnp_sci.accel.arrays import length
from pnp_sci.plugins.combine import FunctionPrior, InTurn, Joint, turns
from pnp_sci.plugins.mosaic import Mosaicked
from pnp_sci.plugins.protocols import Prior
from pnp_sci.plugins.torch_module import TorchPrior
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import level
from pnp_sci.solvers.backend import Backend
from pnp_sci.solvers.gap import gap_step
from pnp_sci.solvers.iterate import states
from pnp_sci.solvers.plan import Pace, Plan
from pnp_sci.solvers.schedule import schedule_for

SIDE = 64  # pixels a side of the crop on which a prior is tried
LITTLE = 0.05  # part of the time left for trying a prior again
OPAQUE = (FunctionPrior, TorchPrior)


_known: dict[Hashable, Pace] = {}  # least seconds for each value of x in this process: others only slow it down
_warm: set[Hashable] = set()  # what has been loaded and compiled, by a run or a try


def pace(prior: Prior, op: SensingOperator, y: np.ndarray, left: float, backend: Backend) -> Pace:
    """The pace of a prior for x of this operator: from its runs in this process, else from a few iterations on a crop.

    Functions and modules are not tried: they may count their calls, or serve one size only.

    Parameters
    ----------
    prior : Prior
        It is tried without its warm-up.
    op : SensingOperator
    y : ndarray, (H, W)
    left : float
        Seconds until the deadline. What would miss it is tried again if that takes little of it: the machine may have
        been busy.
    backend : Backend
        Where the iterations run.
    """
    key, size = _key(prior, op.shape, backend), int(np.prod(op.shape))
    if key not in _known and _is_opaque(prior):
        return Pace()
    crop = slice(0, SIDE), slice(0, SIDE)
    part, shown = op.crop(crop), y[(..., *crop)]
    if key not in _known or _is_doubtful(_known[key], size, int(np.prod(part.shape)), left):
        if key not in _warm:
            _tried(prior, part, shown, backend)  # loads and compiles
        _warm.add(key)
        _learn(key, _tried(prior, part, shown, backend))
    return _known[key].times(size)


def _is_doubtful(known: Pace, size: int, crop: int, left: float) -> bool:
    least = known.slowest + known.finish
    return least * size > left and (least + known.usual) * crop < LITTLE * left


def remember(plan: Plan, shape: tuple[int, ...], seconds: Sequence[float], finish: float, backend: Backend) -> None:
    """Keep the pace of the priors of a plan, from the moments of its iterations and the seconds of its finish.

    The first run of a prior in this process may load and compile, and does not count.
    """
    lasted, size = np.diff(seconds), float(np.prod(shape))
    served = np.array([plan.place(call) for call in range(len(lasted))])
    for place in sorted({*served.tolist()}):
        key, own = _key(plan.serves[place].prior, shape, backend), lasted[served == place] / size
        if key in _warm:
            usual = float(np.median(own[1:])) if len(own) > 1 else np.inf
            _learn(key, Pace(float(own.max()), usual, finish / size if place == served[-1] else np.inf))
        _warm.add(key)


def _learn(key: Hashable, seen: Pace) -> None:
    before = _known.get(key, seen)
    _known[key] = Pace(*map(min, astuple(before), astuple(seen)))


def in_time(plan: Plan, op: SensingOperator, y: np.ndarray, backend: Backend) -> Plan:
    """The plan with the pace of its priors, if it has a deadline."""
    if plan.deadline is None:
        return plan
    left = plan.deadline - time.perf_counter()
    return replace(plan, paces=tuple(pace(turn.prior, op, y, left, backend) for turn in plan.serves))


def _tried(prior: Prior, op: SensingOperator, y: np.ndarray, backend: Backend) -> Pace:
    """Seconds for each value of x."""
    with backend.running():
        return _timed(prior, op, y, backend)


def _timed(prior: Prior, op: SensingOperator, y: np.ndarray, backend: Backend) -> Pace:
    session = InTurn(turns(prior, op.shape, warm=False), op.shape, op.dtype, backend.device)
    given, x = backend.put(y), backend.put(level(op, y))
    course = states(backend.operator(op), given, session, x, gap_step, schedule_for(op, 0.0))
    next(course)
    moments = [time.perf_counter()]
    for state in itertools.islice(course, 2):
        length(state.residual)  # which waits for a device
        moments.append(time.perf_counter())
    length(session.finish(state.x, state.sigma))
    first, second, finish = np.diff([*moments, time.perf_counter()]) / np.prod(op.shape)
    return Pace(max(first, second), second, finish)


def _is_opaque(prior: Prior) -> bool:
    """Whether a function or a module is called."""
    if isinstance(prior, Mosaicked):
        return _is_opaque(prior.prior)
    return any(map(_is_opaque, prior.members)) if isinstance(prior, Joint) else isinstance(prior, OPAQUE)


def _key(prior: Prior, shape: tuple[int, ...], backend: Backend) -> Hashable:
    return repr(prior), shape[:2], numba.get_num_threads(), backend
