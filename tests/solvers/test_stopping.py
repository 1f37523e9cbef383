"""When a run ends: by a failure, a plateau, a number of iterations or a moment in time."""

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_priors import Made

from pnp_sci import SensingOperator, Status
from pnp_sci.solvers.plan import Pace, make_plan
from pnp_sci.solvers.state import State
from pnp_sci.solvers.stopping import Guard, Stopping, held, relative_residual

Y = np.ones((2, 2))


def state(residual, iteration=1):
    picture = np.full((2, 2), float(residual))
    return State(iteration, np.zeros((1, 1, 2, 2)), picture, np.zeros((2, 2)))


def plan(**options):
    made = make_plan(SensingOperator(np.ones((1, 1, 2, 2))), 0.0, Made())
    return replace(made, **({"iterations": 1000, "tol": 1e-3, "least": 0, "deadline": None} | options))


def reasons(made, residuals, lasted=0.0, finishes=False):
    stopping = Stopping(made, float(np.linalg.norm(Y)))
    return [stopping.reason(state(r, n), lasted, finishes) for n, r in enumerate(residuals)]


@given(st.lists(st.floats(0, 5), min_size=1, max_size=9))
def test_the_guard_keeps_the_estimate_with_the_smallest_residual(residuals):
    guard = Guard()
    for n, residual in enumerate(residuals):
        guard.keep(state(residual, n), residual)
    assert guard.best is not None
    assert guard.best.residual.max() == min(residuals)


def test_below_the_noise_the_last_estimate_counts():
    guard = Guard(floor=0.5)
    for n, residual in enumerate((0.9, 0.1, 0.4, 0.7)):
        guard.keep(state(residual, n), residual)
    assert guard.best is not None
    assert guard.best.iteration == 2


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_guard_sees_what_is_not_finite(value):
    assert Guard(1.0).failure(state(value), np.nan) is Status.NOT_FINITE


def test_the_guard_sees_a_residual_beyond_all_use():
    guard = Guard(1.0)
    assert guard.failure(state(1), 1.0) is None, "as much as an estimate of nothing leaves"
    assert guard.failure(state(1000), 1000.0) is Status.DIVERGED


def test_the_guard_sees_an_estimate_larger_than_y_can_hold():
    """It keeps none of those, however small their residual is."""
    guard = Guard(most=2.0)
    assert guard.failure(state(1), 1.0, 2.0) is None
    assert guard.failure(state(1), 1.0, 200.0) is Status.DIVERGED
    for n, (residual, size) in enumerate([(0.5, 1.0), (0.4, 2.0), (0.1, 3.0)]):
        guard.keep(state(residual, n), residual, size)
    assert guard.best is not None
    assert guard.best.iteration == 1


@pytest.mark.parametrize(
    ("noise", "relative", "growth", "converges"),
    [(0.0, 0.5, 1.0, True), (0.0, 0.99, 1.0, False), (1.0, 0.99, 1.0, True), (0.0, 0.5, 1.1, False)],
)
def test_what_explains_nothing_or_grows_has_not_converged(noise, relative, growth, converges):
    stopping = Stopping(plan(), 2.0, noise)
    found = [stopping.reason(state(0.5, n), 0.0, False, relative, growth**n) for n in range(30)]
    assert (Status.CONVERGED in found) == converges


@given(st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_what_y_can_hold(values):
    """An x of 1 throughout, and the least-norm x that measures y."""
    op = SensingOperator(np.random.default_rng(0).random((2, 3, 2, 2)) < 0.7)
    y = np.reshape(values, (2, 2))
    least = op.project(np.zeros(op.shape), y)
    assert held(op, y) == pytest.approx(np.sqrt(op.masks.size + np.sum(least**2)), rel=1e-6)


@given(st.integers(0, 9))
def test_several_small_changes_in_a_row_are_a_plateau(large):
    """One large change among them begins the count anew; so do changes before the last prior serves."""
    quiet = reasons(plan(), [0.5] * 30).index(Status.CONVERGED)
    assert 1 < quiet < 10
    residuals = [1.0] * (large + 1) + [0.5] * 30
    if large + 1 <= quiet:
        assert reasons(plan(), residuals).index(Status.CONVERGED) == large + 1 + quiet
    assert reasons(plan(least=large), [0.5] * 30).index(Status.CONVERGED) == large + quiet


def test_a_change_of_the_tolerance_is_none():
    steps = np.arange(30)
    assert Status.CONVERGED in reasons(plan(tol=1e-3), 1 - 0.9e-3 * steps)
    assert Status.CONVERGED not in reasons(plan(tol=1e-3), 1 - 1.1e-3 * steps)
    assert Status.CONVERGED not in reasons(plan(tol=0), [0.5] * 30)


def test_the_number_of_iterations_is_the_largest():
    assert reasons(plan(iterations=3), [1, 0.9, 0.8, 0.7]) == [None, None, None, Status.ITERATIONS]


@pytest.mark.parametrize(
    ("left", "pace", "finishes", "stops"),
    [
        (2.5, Pace(), False, False),
        (0.5, Pace(), False, True),
        (2.5, Pace(slowest=5.0), False, True),
        (1.5, Pace(finish=1.0), True, True),
        (1.5, Pace(finish=1.0), False, False),
    ],
)
def test_time_for_one_more_iteration_and_for_finishing_must_be_left(left, pace, finishes, stops):
    made = plan(deadline=time.perf_counter() + left, paces=(pace,))
    found = reasons(made, [1, 0.9, 0.8], lasted=1.0, finishes=finishes)
    assert (found[2] is Status.TIME_BUDGET) == stops


def test_saturated_pixels_count_as_far_as_the_estimate_falls_short():
    one = replace(state(0), residual=np.array([[-3.0, 3.0], [0.0, 4.0]]))
    saturated = np.array([[True, True], [False, False]])
    assert relative_residual(one, 2.0, None) == pytest.approx(np.sqrt(34) / 2)
    assert relative_residual(one, 2.0, saturated) == pytest.approx(2.5)
