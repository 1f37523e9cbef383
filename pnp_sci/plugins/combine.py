"""Priors made of others: plain functions, several at once ("tv+wavelet"), and stages one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from pnp_sci._validate import whole
from pnp_sci.accel.arrays import copied
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.plugins.on_host import OnHost
from pnp_sci.plugins.protocols import DevicePrior, Prior, Session, Traits


@dataclass(frozen=True)
class Identity(Prior):
    """The prior "none": no denoising, the solver only projects."""

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session that returns what it gets."""
        return FunctionSession(lambda v, sigma: v)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Session:
        """The same on tensors."""
        return self.begin(shape, dtype)


@dataclass(frozen=True)
class FunctionPrior(Prior):
    """A function ``(x, sigma)`` that returns x (V, B, H, W) denoised, as a prior.

    All sessions call the same function: one that remembers a video from call to call must be a prior with sessions. Its
    x is the solver's buffer; copy what is to be kept.
    """

    function: Callable[[np.ndarray, float], Any]

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session that calls the function."""
        return FunctionSession(self.function)


class FunctionSession(Session):
    """Calls a function, and remembers nothing."""

    def __init__(self, function: Callable[[np.ndarray, float], Any]):
        self.function = function

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v (V, B, H, W)."""
        return self.function(v, sigma)


@dataclass(frozen=True)
class Joint(Prior):
    """Several priors at once: the mean of what they return, and of what they make of a last estimate, by `shares`.

    The mean of proximal maps is, to first order in sigma^2, that of the mean of their priors, so this serves an
    objective such as ``||y - Phi x||^2 / 2 + a TV(x) + b Theta(x)``. The longest warm-up of a member serves all.

    Parameters
    ----------
    members : sequence of Prior
    shares : sequence of float, optional
        Weights of the members, > 0; by default all weigh the same.

    Raises
    ------
    InputError
        If there are not as many shares as members, or one is not a number > 0.

    References
    ----------
    Y. Yu, "Better approximation and faster algorithm using the proximal average", NIPS 2013.

    Examples
    --------
    >>> halve, keep = FunctionPrior(lambda x, sigma: x / 2), Identity()
    >>> session = Joint([halve, keep], shares=[3, 1]).begin((1, 1, 1, 1), np.dtype("f8"))
    >>> float(session(np.ones((1, 1, 1, 1)), 0.1).max())
    0.625
    """

    members: Sequence[Prior]
    shares: Sequence[float] = ()

    def __post_init__(self):
        if not self.members:
            raise InputError("members is empty: at least one Prior was expected")
        shares = list(self.shares) or [1.0] * len(self.members)
        above_0 = all(isinstance(share, Real) and 0 < share < np.inf for share in shares)
        if len(shares) != len(self.members) or not above_0:
            raise InputError(f"shares is {self.shares}: {len(self.members)} numbers > 0 were expected")
        object.__setattr__(self, "members", tuple(self.members))
        object.__setattr__(self, "shares", tuple(float(share) / sum(shares) for share in shares))

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """What holds for one of the members holds for all of them."""
        each = [member.traits(shape) for member in self.members]
        warmups = [traits.warmup for traits in each if traits.warmup]
        return Traits(
            strong=any(traits.strong for traits in each),
            network=any(traits.network for traits in each),
            warmup=max(warmups, key=lambda warmup: warmup[1], default=None),
            serves_below=min(traits.serves_below for traits in each),
            average=any(traits.average for traits in each),
            motion=any(traits.motion for traits in each),
        )

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session of each member."""
        return self.begin_on(shape, dtype, None)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str | None) -> Session:
        """A session of each member; if there is a device, on tensors."""
        return _JointSession([begun(member, shape, dtype, device) for member in self.members], self.shares)


class _JointSession(Session):
    def __init__(self, sessions: list[Session], shares: Sequence[float]):
        self.sessions, self.shares = sessions, shares

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        return self._mean(self.sessions, v, sigma)

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        return self._mean([session.finish for session in self.sessions], x, sigma)

    def facts(self) -> Mapping[str, Any]:
        return _merged([session.facts() for session in self.sessions])

    def _mean(self, functions: Sequence[Callable[..., np.ndarray]], x: np.ndarray, sigma: float) -> np.ndarray:
        mean = first = copied(functions[0](x, sigma))  # another member may return the same buffer
        for function, share in zip(functions[1:], self.shares[1:]):
            # where all members return the same, so does the mean, to the last digit
            mean = mean + share * (function(x, sigma) - first)
        return mean


@dataclass(frozen=True)
class Turn:
    """A prior, and when it serves.

    Attributes
    ----------
    prior : Prior
    begins : int
        The first call that it serves, counted from 0.
    below : float
        Largest sigma that it serves; above it the turn before goes on.
    average : bool
        Whether the estimates of its calls are averaged.
    motion : bool
        Whether frames are displaced before its calls where the data say so.
    """

    prior: Prior
    begins: int = 0
    below: float = float("inf")
    average: bool = False
    motion: bool = False


@dataclass(frozen=True)
class Stages(Prior):
    """One prior after the other: each serves its number of calls, the last one all that follow.

    The warm-up of the first prior is part of its calls; a later one finds the scene estimated and needs none. Neither
    does the first one after a decoder. sigma is one number for all stages.

    Parameters
    ----------
    stages : sequence of (Prior, calls)

    Examples
    --------
    >>> stages = Stages([(FunctionPrior(lambda x, sigma: x / 2), 1), (Identity(), 1)])
    >>> session = stages.begin((1, 1, 1, 1), np.dtype("f8"))
    >>> [float(session(np.ones((1, 1, 1, 1)), 0.1).max()) for _ in range(3)]
    [0.5, 1.0, 1.0]
    """

    stages: Sequence[tuple[Prior, int]]

    def __post_init__(self):
        if not self.stages:
            raise InputError("stages is empty: at least one (prior, calls) was expected")
        stages = tuple((prior, whole("calls of a stage", calls, 1)) for prior, calls in self.stages)
        object.__setattr__(self, "stages", stages)

    @property
    def calls(self) -> int:
        """Of all stages together."""
        return sum(calls for _, calls in self.stages)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """The stages fix the number of calls, so that the sequence counts as plain."""
        return Traits()

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> InTurn:
        """A session of each stage, in turn."""
        return self.begin_on(shape, dtype, None)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str | None) -> InTurn:
        """A session of each stage, in turn; if there is a device, on tensors."""
        return InTurn(turns(self, shape), shape, dtype, device)


def turns(prior: Prior, shape: tuple[int, ...], warm: bool = True) -> tuple[Turn, ...]:
    """Which prior serves when, for videos (V, B, H, W) of this shape: warm-up, if `warm`, and prior, or stages."""
    if isinstance(prior, Stages):
        found, begins = [], 0
        for stage, calls in prior.stages:
            own = turns(stage, shape, warm and begins == 0)
            found += [replace(turn, begins=begins + turn.begins) for turn in own if turn.begins < calls]
            begins += calls
        return tuple(found)
    traits = prior.traits(shape)
    own = Turn(prior, below=traits.serves_below, average=traits.average, motion=traits.motion)
    if not warm or traits.warmup is None or traits.warmup[1] == 0:
        return (own,)
    first, calls = traits.warmup
    return Turn(first), replace(own, begins=calls)


def serving(order: Sequence[Turn], call: int, sigma: float) -> int:
    """The place in `order` of the turn that serves a call, counted from 0, at this sigma."""
    due = max(place for place, turn in enumerate(order) if turn.begins <= call)
    while due and sigma > order[due].below:
        due -= 1
    return due


class InTurn(Session):
    """Sessions of several priors of which one serves at a time; on tensors if there is a device."""

    def __init__(self, order: Sequence[Turn], shape: tuple[int, ...], dtype: np.dtype, device: str | None = None):
        self.order, self.calls, self.now = order, 0, 0
        # all begin now: what cannot is told at once
        self.sessions = [begun(turn.prior, shape, dtype, device) for turn in order]

    def due(self, sigma: float) -> Turn:
        """Whose turn the next call is, with this sigma."""
        return self.order[self._place(sigma)]

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise with the prior whose turn it is."""
        self.now = self._place(sigma)
        self.calls += 1
        return self.sessions[self.now](v, sigma, out)

    def _place(self, sigma: float) -> int:
        return serving(self.order, self.calls, sigma)

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Finish with the prior that has served last."""
        return self.sessions[self.now].finish(x, sigma)

    def facts(self) -> Mapping[str, Any]:
        """Of all that have served, the latest first."""
        return _merged([session.facts() for session in self.sessions[self.now :: -1]])


def begun(prior: Prior, shape: tuple[int, ...], dtype: np.dtype, device: str | None = None) -> Session:
    """A session of a prior; on a device one that takes tensors, with copies to the CPU and back where it must."""
    on_tensors = prior.begin_on(shape, dtype, device) if device and isinstance(prior, DevicePrior) else None
    session = prior.begin(shape, dtype) if on_tensors is None else on_tensors
    if not isinstance(session, Session):
        method = "begin" if on_tensors is None else "begin_on"
        raise InputTypeError(f"prior: {method} of {type(prior).__name__} returns {session!r}: a Session was expected")
    return OnHost(session) if device and on_tensors is None else session


def _merged(all_facts: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Facts of several sessions: lists of weights are joined, of anything else the first that is known counts."""
    merged: dict[str, Any] = {}
    for facts in all_facts:
        for name, value in facts.items():
            if name == "weights":
                merged[name] = [*merged.get(name, []), *value]
            else:
                merged[name] = merged.get(name) or value
    return merged
