"""One prior object serves several solvers at once, and what a prior does with its own arrays disturbs none."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count

import numpy as np
import pytest
from operators_and_priors import PRIORS

import pnp_sci
from pnp_sci import datasets
from pnp_sci.plugins.combine import Joint, Stages
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.tv import TV

ITERATIONS = 66  # beyond every warm-up


@pytest.fixture(scope="module")
def cases():
    """Measurements of two scenes, one of them mirrored."""
    scene = datasets.embedded_scene(48)
    return [(pnp_sci.simulate(truth, scene.masks), scene.masks) for truth in (scene.truth, scene.truth[..., ::-1])]


@pytest.mark.parametrize("prior", PRIORS)
def test_one_object_in_two_threads(prior, cases):
    def solved(case):
        return pnp_sci.solve(*case, prior, iterations=ITERATIONS, scene="full", threads=1)

    alone = [solved(case) for case in cases]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(solved, cases))
    for one, other in zip(alone, together):
        assert other.status == one.status
        np.testing.assert_allclose(other.x, one.x, atol=1e-5)
    assert np.abs(alone[0].x - alone[1].x).mean() > 0.01, "or two measurements tell nothing"


@pytest.mark.parametrize("prior", PRIORS)
def test_a_prior_is_not_changed_by_what_it_serves(prior, cases):
    before = repr(prior), hash(prior)
    first, other, again = (
        pnp_sci.solve(*case, prior, iterations=ITERATIONS, scene="full", threads=1).x for case in (*cases, cases[0])
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert (repr(prior), hash(prior)) == before


class BlurSession(Session):
    """Blurs along rows and remembers the last result; it returns its only buffer, or a copy."""

    def __init__(self, shape, dtype, copies):
        self.buffer, self.copies, self.last = np.zeros(shape, dtype), copies, np.zeros(shape, dtype)

    def __call__(self, v, sigma, out=None):
        blurred = v + sigma * (np.roll(v, 1, -1) + np.roll(v, -1, -1) + self.last)
        np.divide(blurred, 1 + 3 * sigma, out=self.buffer)
        self.last = blurred
        return self.buffer.copy() if self.copies else self.buffer

    def finish(self, x, sigma):
        np.multiply(x, 1 - sigma, out=self.buffer)
        return self.buffer.copy() if self.copies else self.buffer


@dataclass(frozen=True)
class Blur(Prior):
    """A prior whose sessions reuse one buffer for all that they return, unless it `copies`."""

    copies: bool
    average: bool = False

    def traits(self, shape):
        return Traits(average=self.average)

    def begin(self, shape, dtype):
        return BlurSession(shape, dtype, self.copies)


def one_buffer_for_all(copies):
    """A function that returns the same array in every call of every session, or a copy; each call divides by more."""
    buffers, calls = {}, count()

    def smaller(x, sigma):
        buffer = buffers.setdefault((x.shape, x.dtype), np.empty_like(x))
        np.divide(x, 1 + 0.01 * next(calls), out=buffer)
        return buffer.copy() if copies else buffer

    return smaller


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
@pytest.mark.parametrize(
    "make",
    [
        Blur,
        lambda copies: Blur(copies, average=True),
        lambda copies: Joint([Blur(copies), Blur(copies), TV()]),
        lambda copies: Stages([(Blur(copies), 3), (TV(), 2), (Blur(copies), 3)]),
        one_buffer_for_all,
        lambda copies: Joint([pnp_sci.as_prior(one_buffer_for_all(copies))] * 3),
    ],
    ids=["alone", "averaged", "at once with others", "in stages", "a function", "a function at once with itself"],
)
def test_a_prior_may_reuse_its_buffer(make, algorithm, cases):
    """Two measurements at once, whose results do not depend on whether copies are returned."""
    y, masks = np.stack([y for y, _ in cases]), cases[0][1]
    reusing, copying = (
        pnp_sci.solve(y, masks, make(copies), algorithm=algorithm, iterations=8, scene="full")
        for copies in (False, True)
    )
    assert np.array_equal(reusing.x, copying.x)
    assert np.array_equal(reusing.history["residual"], copying.history["residual"])
    assert np.isfinite(reusing.x).all()
    assert reusing.x.any()


def test_states_keep_their_values_while_a_buffer_is_reused(cases):
    """What a callback has kept of an iterate is the same afterwards."""
    kept = []

    def keep(state):
        kept.append((state.x, state.x.copy()))

    pnp_sci.solve(*cases[0], Blur(copies=False), iterations=5, scene="full", callback=keep)
    assert len(kept) == 6
    for seen, then in kept:
        np.testing.assert_array_equal(seen, then)
    assert not np.array_equal(kept[-1][0], kept[-2][0])


def test_a_prior_that_overwrites_its_input_is_no_worse(cases):
    """In a solver the input is the solver's own array: who writes to it and who does not say the same."""

    def in_place(x, sigma):
        x /= 1 + sigma
        return x

    one, other = (
        pnp_sci.solve(*cases[0], f, iterations=8, scene="full").x for f in (in_place, lambda x, sigma: x / (1 + sigma))
    )
    np.testing.assert_array_equal(one, other)
