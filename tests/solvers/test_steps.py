"""Single steps of the solvers against their formulas, and the solution that all of them lead to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pnp_sci import SensingOperator
from pnp_sci.solvers.admm import admm_step
from pnp_sci.solvers.gap import gap_step, pace_after, plain_gap_step
from pnp_sci.solvers.iterate import ALGORITHMS
from pnp_sci.solvers.state import start
from priors.tv import TV


def soften(x, sigma):
    """A denoiser with nothing hidden: every pixel towards its frame's mean."""
    return (x + sigma * x.mean((2, 3), keepdims=True)) / (1 + sigma)


@pytest.fixture(params=["binary", "grey"])
def problem(request):
    rng = np.random.default_rng(5)
    masks = rng.random((2, 4, 7, 6))
    if request.param == "binary":
        masks = masks < 0.5
        masks[..., 0, 0] = True
    x = rng.random(masks.shape)
    op = SensingOperator(masks, np.float64)
    return op, op.forward(x), rng.random(masks.shape)


def fastest():
    """The pace that moves in one and the same direction end with."""
    pace, move = 1.0, np.ones((1, 1))
    for _ in range(100):
        pace = pace_after(pace, move, move)
    return pace


def run(step, problem, denoise, iterations, sigma=0.1, rho=0.0):
    op, y, x = problem
    state = start(op, y, x)
    for _ in range(iterations):
        state = step(op, y, denoise, state, sigma, rho)
    return state


def test_accelerated_gap_is_the_accumulated_measurement(problem):
    """y_acc <- y_acc + tau (y - Phi x);  v <- x + Phi^T (y_acc - Phi x) / gram;  x <- D(v), from masks alone."""
    op, y, x = problem
    masks = op.masks.astype(float)
    gram, accumulated, state = (masks**2).sum((0, 1)), y.copy(), start(op, y, x)
    paces = set()
    for _ in range(12):
        paces.add(state.pace)
        measured = (masks * x).sum((0, 1))
        accumulated = accumulated + state.pace * (y - measured)
        x = soften(x + masks * (accumulated - measured) / gram, 0.1)
        state = gap_step(op, y, soften, state, 0.1)
    assert len(paces) > 1
    np.testing.assert_allclose(state.x, x, rtol=1e-9)


@pytest.mark.parametrize("kind", ["one rho", "a rho for each pixel", "saturated"])
def test_what_stays_as_it_is_at_one_pace_does_at_any(problem, kind):
    """Of a state that hardly changes any more, x, residual and multiplier; a wrong leak changes x by 0.01."""
    op, y, _ = problem
    rho = 0.7 if kind == "one rho" else np.linspace(0.1, 0.9, y.size).reshape(y.shape)
    saturated = y > np.quantile(y, 0.7) if kind == "saturated" else None
    state = start(op, y, np.zeros(op.shape))
    for _ in range(3000):
        state = gap_step(op, y, soften, state, 0.1, rho, saturated)
    for pace in (1.0, 2.0, fastest()):
        after = gap_step(op, y, soften, replace(state, pace=pace), 0.1, rho, saturated)
        for name in ("x", "residual", "dual"):
            np.testing.assert_allclose(getattr(after, name), getattr(state, name), atol=1e-4)


def test_the_pace_falls_where_a_constant_one_diverges(problem):
    """Without a prior a pace of 2 or more is too much."""
    op, y, x = problem
    free = constant = replace(start(op, y, x), pace=fastest())
    for _ in range(60):
        free = gap_step(op, y, lambda v, sigma: v.copy(), free, 0.1)
        constant = replace(gap_step(op, y, lambda v, sigma: v.copy(), constant, 0.1), pace=fastest())
    assert np.abs(free.residual).max() < 1e-9 < 1e9 < np.abs(constant.residual).max()


PARTS = np.linspace(-1.5, 1.5, 25)  # of a move, that are found again in the next


@given(pace=st.floats(1, fastest()), seed=st.integers(0, 2**32 - 1), power=st.integers(-10, 10))
def test_the_pace_follows_the_direction_of_moves(pace, seed, power):
    """The more of a move comes again, the faster; within its range, and in any unit."""
    move = np.random.default_rng(seed).standard_normal((3, 4))
    after = [pace_after(pace, move, part * move) for part in PARTS]
    assert after == sorted(after)
    assert after == [pace_after(pace, 2.0**power * move, 2.0**power * part * move) for part in PARTS]
    assert 1 <= after[0] <= pace <= after[-1] <= fastest()
    assert after[0] < pace or pace == 1
    assert after[-1] > pace or pace == fastest()


@given(pace=st.floats(1, fastest()))
def test_a_move_of_nothing_leaves_the_pace_alone(pace):
    move = np.ones((3, 4))
    for first, second in ((0 * move, 0 * move), (move, np.nan * move), (np.nan * move, move)):
        assert pace_after(pace, first, second) == pace


def test_the_multiplier_of_a_bound_is_never_negative(problem):
    op, y, x = problem
    op = SensingOperator(op.masks, np.float32)
    y, saturated = y.astype(np.float32), y > np.quantile(y, 0.5)
    state = replace(start(op, y, x.astype(np.float32)), pace=1.5625)
    for _ in range(20):
        state = gap_step(op, y, soften, state, 0.1, 0.05, saturated)
        assert (state.dual[saturated] >= 0).all()
        assert (state.x.dtype, state.dual.dtype, state.residual.dtype) == (np.float32,) * 3


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_plain_gap_is_its_formula(problem, rho):
    op, y, x = problem
    masks = op.masks.astype(float)
    for _ in range(12):
        x = soften(x + masks * (y - (masks * x).sum((0, 1))) / ((masks**2).sum((0, 1)) + rho), 0.1)
    np.testing.assert_allclose(run(plain_gap_step, problem, soften, 12, rho=rho).x, x, rtol=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_admm_is_its_formula(problem, rho):
    """z minimises ||y - Phi z||^2 + rho ||z - (x - u)||^2, x <- D(z + u), u <- u + z - x."""
    op, y, x = problem
    masks = op.masks.astype(float)
    u = np.zeros_like(x)
    for _ in range(12):
        z = x - u
        z = z + masks * (y - (masks * z).sum((0, 1))) / ((masks**2).sum((0, 1)) + rho)
        x = soften(z + u, 0.1)
        u = u + z - x
    np.testing.assert_allclose(run(admm_step, problem, soften, 12, rho=rho).x, x, rtol=1e-8)


@pytest.mark.parametrize("step", ALGORITHMS.values(), ids=ALGORITHMS.keys())
@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_states_stay_as_they_are(problem, step, rho):
    """A step changes neither the state that came in, nor y, and says what it did."""
    op, y, _ = problem
    state = run(step, problem, soften, 3, rho=rho)
    kept = [a.copy() for a in (state.x, state.residual, state.dual, y)]
    after = step(op, y, soften, state, 0.1, rho)
    assert all(np.array_equal(a, b) for a, b in zip(kept, (state.x, state.residual, state.dual, y)))
    assert (state.iteration, after.iteration, after.sigma) == (3, 4, 0.1)
    np.testing.assert_allclose(after.residual, y - op.forward(after.x), atol=1e-12)
    assert not np.array_equal(after.x, state.x)


@pytest.mark.parametrize("step", ALGORITHMS.values(), ids=ALGORITHMS.keys())
def test_without_a_prior_the_measurement_is_met_at_once(problem, step):
    state = run(step, problem, lambda x, sigma: x.copy(), 1)
    accelerated = np.abs(start(*problem).residual).max() if step is gap_step else 0  # overshoots by the first residual
    np.testing.assert_allclose(np.abs(state.residual).max(), accelerated, atol=1e-12)


@pytest.mark.parametrize("step", ALGORITHMS.values(), ids=ALGORITHMS.keys())
def test_dead_pixels_do_no_harm(step):
    masks = np.random.default_rng(0).random((2, 3, 5, 5)) < 0.5
    masks[..., 2, 2] = False
    op = SensingOperator(masks)
    y = op.forward(np.full(op.shape, 0.5))
    offset = y.copy()
    offset[2, 2] = 0.5  # a black level, which nothing can explain
    for rho in (0.0, 0.5):
        dark, lit = (run(step, (op, m, np.zeros(op.shape, np.float32)), soften, 50, rho=rho) for m in (y, offset))
        assert np.isfinite(dark.x).all()
        assert np.isfinite(dark.dual).all()
        np.testing.assert_array_equal(dark.x, lit.x)


def total_variation(x):
    padded = np.pad(x, ((0, 0), (0, 0), (0, 1), (0, 1)), mode="edge")
    return np.hypot(padded[..., 1:, :-1] - x, padded[..., :-1, 1:] - x).sum()


@pytest.mark.parametrize("rho", [0.0, 0.4])
def test_gap_and_admm_have_the_same_limit(rho):
    """Both minimise ``||y - Phi x||^2 / (2 rho) + sigma TV(x)``, or TV(x) subject to ``Phi x = y`` where rho is 0."""
    rng = np.random.default_rng(0)
    x = np.zeros((1, 2, 10, 10))
    x[0, 0, 2:6, 3:8], x[0, 1, 3:7, 4:9] = 1, 0.7
    op = SensingOperator(rng.random(x.shape) < 0.6, np.float64)
    y = op.forward(x) + 0.05 * rng.standard_normal(x.shape[2:]) * (op.gram > 0)
    sigma = 0.1

    def objective(state):
        data = (state.residual**2).sum() / (2 * rho) if rho else 0.0
        return data + sigma * total_variation(state.x)

    states = []
    for step in (gap_step, admm_step):
        session = TV(inner=30, time=0).begin(op.shape, op.dtype)
        states.append(run(step, (op, y, np.zeros_like(x)), session, 1500, sigma, rho))
    gap, admm = states
    assert objective(gap) == pytest.approx(objective(admm), rel=1e-3)
    np.testing.assert_allclose(gap.x, admm.x, atol=5e-3)
    if rho:
        np.testing.assert_allclose(gap.residual, admm.residual, atol=5e-3)
        alive = op.gram > 0
        np.testing.assert_allclose(gap.residual[alive], (rho * gap.dual / np.maximum(op.gram, 1))[alive], atol=1e-3)
        assert np.abs(gap.residual).max() > 0.05
    else:
        assert np.abs(gap.residual).max() < 1e-3
        assert np.abs(admm.residual).max() < 1e-3
    perturbed = gap.x + 0.02 * rng.standard_normal(x.shape)
    perturbed = perturbed if rho else op.project(perturbed, y)
    assert objective(start(op, y, perturbed)) > objective(gap)
