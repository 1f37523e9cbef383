"""The checks themselves: each broken promise is found, and named."""

import threading
from dataclasses import dataclass, field

import numpy as np
import pytest

from pnp_sci import SensingOperator
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import FunctionSession
from pnp_sci.plugins.protocols import Prior, Session, Traits
from pnp_sci.testing import ContractError, check_operator, check_prior


def halved(x, sigma):
    return x / (1 + sigma)


def overwrites(x, sigma):
    x /= 1 + sigma
    return x


def counts():
    """A function with a memory that all videos share."""
    calls = []

    def smaller(x, sigma):
        calls.append(sigma)
        return x / len(calls)

    return smaller


def knows_threads(x, sigma):
    return x / (2 if threading.current_thread() is threading.main_thread() else 3)


class Halves(Session):
    """Does what it should; those below break one promise each."""

    def __call__(self, v, sigma, out=None):
        return halved(v, sigma)


class CannotWriteInPlace(Halves):
    def __call__(self, v, sigma, out=None):
        if out is None:
            return halved(v, sigma)
        out[:] = 0
        return halved(v, sigma)


class FinishesSmaller(Halves):
    def finish(self, x, sigma):
        return x[:, :1]


class FinishesWithNothing(Halves):
    def finish(self, x, sigma):
        return np.full_like(x, np.nan)


class TellsArrays(Halves):
    def facts(self):
        return {"still": np.zeros(3)}


@dataclass(frozen=True)
class Of(Prior):
    """A prior with these sessions."""

    session: type
    known: object = field(default_factory=Traits)

    def traits(self, shape):
        return self.known

    def begin(self, shape, dtype):
        return self.session()


@dataclass(frozen=True)
class CountsSessions(Prior):
    """Every session divides by more."""

    begun: list = field(default_factory=list)

    def begin(self, shape, dtype):
        self.begun.append(shape)
        parts = len(self.begun)
        return FunctionSession(lambda x, sigma: x / parts)


def test_what_keeps_its_promises_passes():
    check_prior(halved)
    check_prior(Of(Halves))


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (lambda x, sigma: x[:1], r"shape \(2, 3, 8, 8\).*is returned"),
        (lambda x, sigma: x + np.inf, "not finite"),
        (overwrites, "the input has changed"),
        (lambda x, sigma: x / 2 + x.mean(0), "views are mixed"),
        (counts(), "another session at work"),
        (CountsSessions(), "another session at work"),
        (knows_threads, "in two threads"),
        (Of(CannotWriteInPlace), "in place"),
        (Of(FinishesSmaller), "finish returns another shape"),
        (Of(FinishesWithNothing), "finish returns a value that is not finite"),
        (Of(TellsArrays), "facts are no JSON"),
        (Of(object), "a Session was expected"),
        (Of(Halves, None), r"traits\(.*\) is None"),
    ],
)
def test_a_broken_promise_of_a_prior_is_named(prior, message):
    with pytest.raises(ContractError, match=message):
        check_prior(prior, shapes=[(2, 3, 8, 8)])


def test_options_are_those_of_the_prior():
    check_prior("tv", shapes=[(1, 1, 8, 8)], strength=2.0)
    with pytest.raises(InputError, match="strong"):
        check_prior("tv", shapes=[(1, 1, 8, 8)], strong=True)


class Wrong:
    """An operator with one method in the place of its own."""

    def __init__(self, **changed):
        self.op = SensingOperator(np.random.default_rng(0).random((2, 3, 6, 5)), np.float64)
        self.changed = changed

    def __getattr__(self, name):
        return self.changed[name](self.op) if name in self.changed else getattr(self.op, name)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"adjoint": lambda op: lambda y: 1.01 * op.adjoint(y)}, "adjoint is not that of forward"),
        ({"gram": lambda op: op.masks.sum((0, 1))}, "gram is not"),
        ({"project": lambda op: lambda x, y, rho=0: x}, "does not measure y"),
        ({"project": lambda op: lambda x, y, rho=0: op.project(x, y)}, "does not minimise"),
    ],
)
def test_a_broken_promise_of_an_operator_is_named(changed, message):
    with pytest.raises(ContractError, match=message):
        check_operator(Wrong(**changed))


def test_a_projection_moves_nothing_where_every_mask_is_closed():
    op = SensingOperator(np.array([[[[1.0, 0.0]], [[1.0, 0.0]]]]), np.float64)
    wrong = Wrong(project=lambda _: lambda x, y, rho=0: op.project(x, y, rho) + (op.gram == 0))
    wrong.op = op
    with pytest.raises(ContractError, match="what no mask shows"):
        check_operator(wrong)
