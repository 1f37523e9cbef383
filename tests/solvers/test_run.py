"""The loop: what it observes and returns, whatever ends it."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_priors import Made

from pnp_sci import SensingOperator, Status, Traits
from pnp_sci.solvers.plan import make_plan
from pnp_sci.solvers.run import run
from pnp_sci.solvers.state import State

Y = np.ones((2, 2))
PLAIN, AVERAGING = Traits(), Traits(average=True)


def plan(known=PLAIN, iterations=100):
    op = SensingOperator(np.ones((1, 1, 2, 2)))
    return make_plan(op, 0.0, Made(known=known), iterations=iterations, tol=0.0)


def course(residuals):
    """States with these residuals: x is what is missing of Y."""
    for n, residual in enumerate(residuals):
        x = np.full((1, 1, 2, 2), 1 - residual)
        yield State(n, x, Y - x[0, 0], np.zeros((2, 2)), 0.1 if n else float("nan"))
    raise AssertionError("the run goes on after the last state")


def score(x):
    """Like PSNR: it is highest where x is Y."""
    return -float(np.abs(x - 1).max())


def ended(residuals, observe=lambda state, record: False, known=PLAIN, iterations=100, finish=None):
    return run(course(residuals), Y, plan(known, iterations), observe, score=score, finish=finish)


def is_of(record, state):
    """Whether a record tells of this state."""
    return (
        record.iteration == state.iteration
        and record.residual == pytest.approx(np.linalg.norm(Y - state.x[0, 0]) / 2)
        and record.psnr == pytest.approx(score(state.x))
    )


FAILS = {"DIVERGED": 1e3, "NOT_FINITE": np.nan}


@pytest.mark.parametrize(("status", "wild"), FAILS.items())
@given(st.lists(st.floats(0, 5), min_size=1, max_size=8))
def test_after_a_failure_the_estimate_with_the_smallest_residual_is_returned(status, wild, residuals):
    state, found, records = ended([*residuals, wild])
    assert found is Status[status]
    assert np.abs(state.residual).max() == pytest.approx(min(residuals))
    assert is_of(records[-1], state)
    assert records[-1].residual == min(record.residual for record in records)


@pytest.mark.parametrize(("status", "wild"), FAILS.items())
@given(st.lists(st.floats(0.5, 5), min_size=3, max_size=8))
def test_the_best_of_means_is_a_mean(status, wild, residuals):
    """Where estimates are averaged, so is the one that is returned; the guard looks at the iterates."""
    seen = []
    state, found, records = ended([*residuals, wild], lambda s, record: seen.append(s), known=AVERAGING)
    assert found is Status[status]
    assert any(state.x is other.x for other in seen)
    smallest = min(np.linalg.norm(other.residual) for other in seen)
    assert np.linalg.norm(state.residual) == pytest.approx(smallest)
    assert is_of(records[-1], state)


def test_without_a_failure_the_last_estimate_is_returned():
    state, status, records = ended([1, 0.2, 0.9], iterations=2)
    assert status is Status.ITERATIONS
    assert state.iteration == 2
    assert is_of(records[-1], state)


def test_the_observer_ends_the_run():
    state, status, records = ended([1, 0.5, 0.2], lambda s, record: record.iteration == 1)
    assert status is Status.STOPPED
    assert [record.iteration for record in records] == [0, 1]
    assert is_of(records[-1], state)


def test_what_is_finished_is_what_the_record_tells_of():
    def finish(state):
        x = state.x + 0.125
        return State(state.iteration, x, Y - x[0, 0], state.dual, state.sigma)

    state, _, records = ended([1, 0.5, 0.25], iterations=2, finish=finish)
    assert np.allclose(state.x, 0.875)
    assert is_of(records[-1], state)
    assert [record.iteration for record in records] == [0, 1, 2]


def test_a_finish_that_fails_leaves_the_best_estimate():
    def finish(state):
        return State(state.iteration, state.x * np.nan, state.residual * np.nan, state.dual, state.sigma)

    state, status, records = ended([1, 0.25, 0.5], iterations=2, finish=finish)
    assert status is Status.NOT_FINITE
    assert state.iteration == 1
    assert is_of(records[-1], state)


def test_a_first_estimate_that_fails_has_a_record():
    state, status, records = ended([1e3])
    assert status is Status.DIVERGED
    assert len(records) == 1
    assert is_of(records[-1], state)


def test_time_spent_on_scores_is_not_counted(monkeypatch):
    clock = itertools.count()
    now = [0.0]

    def slow_score(x):
        now[0] += 1000
        return 0.0

    monkeypatch.setattr("pnp_sci.solvers.run.time.perf_counter", lambda: now[0] + 1e-3 * next(clock))
    _, _, records = run(course([1] * 4), Y, plan(iterations=3), lambda state, record: False, score=slow_score)
    assert records[-1].seconds < 1
