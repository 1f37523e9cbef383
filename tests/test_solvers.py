"""Single steps of the solvers against their formulas, and the solution that all of them lead to."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci import SensingOperator
from pnp_sci.sensing.problem import level
from pnp_sci.solvers import ALGORITHMS, admm_step, gap_step, plain_gap_step, start
from pnp_sci.solvers.gap import FASTEST, STEADY, TURNING, pace_after
from pnp_sci.solvers.plan import contrast, schedule_for
from priors.tv import TRUSTED, TV


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
    for pace in (1.0, 2.0, FASTEST):
        after = gap_step(op, y, soften, replace(state, pace=pace), 0.1, rho, saturated)
        for name in ("x", "residual", "dual"):
            np.testing.assert_allclose(getattr(after, name), getattr(state, name), atol=1e-4)


def test_the_pace_falls_where_a_constant_one_diverges(problem):
    """Without a prior a pace of 2 or more is too much."""
    op, y, x = problem
    free = constant = replace(start(op, y, x), pace=FASTEST)
    for _ in range(60):
        free = gap_step(op, y, lambda v, sigma: v.copy(), free, 0.1)
        constant = replace(gap_step(op, y, lambda v, sigma: v.copy(), constant, 0.1), pace=FASTEST)
    assert np.abs(free.residual).max() < 1e-9 < 1e9 < np.abs(constant.residual).max()


@given(
    pace=st.floats(1, FASTEST),
    seed=st.integers(0, 2**32 - 1),
    part=st.floats(-1.5, 1.5).filter(lambda part: min(abs(part - TURNING), abs(part - STEADY)) > 0.01),
    unit=st.floats(1e-3, 1e3),
)
def test_the_pace_follows_the_direction_of_moves(pace, seed, part, unit):
    """It stays in its range, does not depend on the unit, and is left alone by moves that are 0 or not finite."""
    move = np.random.default_rng(seed).standard_normal((3, 4))
    after = pace_after(pace, move, part * move)
    assert 1 <= after <= FASTEST
    assert after == pace_after(pace, unit * move, unit * part * move)
    assert (after < pace) == (part < TURNING and pace > 1)
    assert (after > pace) == (part > STEADY and pace < FASTEST)
    assert pace_after(pace, 0 * move, 0 * move) == pace_after(pace, move, np.nan * move) == pace


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
        states.append(run(step, (op, y, np.zeros_like(x)), TV(inner=30, time=0), 1500, sigma, rho))
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


def test_the_contrast_of_masks():
    """Half of 20 open is what the tolerance was made for; dense masks, and more of them, code less of y."""
    half, dense, many = (
        contrast(SensingOperator(pnp_sci.random_masks(shape, density)))
        for shape, density in (((2, 10, 32, 32), 0.5), ((2, 10, 32, 32), 0.95), ((2, 60, 32, 32), 0.5))
    )
    assert half > 0.95
    assert dense == pytest.approx(np.sqrt(0.05 / 0.95 / 20) / 0.22, rel=0.1)
    assert many == pytest.approx(np.sqrt(1 / 120) / 0.22, rel=0.1)
    for edge in (np.ones((2, 3, 4, 4)), np.zeros((2, 3, 4, 4)), np.ones((1, 1, 4, 4)), np.array([[[[1.0]], [[-1.0]]]])):
        assert contrast(SensingOperator(edge)) == 1


def test_the_first_estimate_reaches_pixels_that_no_mask_lets_light_to():
    masks = pnp_sci.random_masks((2, 4, 48, 48), 0.05)
    assert (masks.sum((0, 1)) == 0).mean() > 0.5
    op = SensingOperator(masks)
    estimate = level(op, op.forward(np.full(op.shape, 0.5, np.float32)))
    assert 0.35 < estimate.min() <= estimate.max() < 0.55
    assert not level(SensingOperator(np.zeros((1, 2, 5, 5))), np.ones((5, 5), np.float32)).any()
    lit = masks.any((0, 1))
    y = np.where(np.arange(48) < 24, op.forward(np.full(op.shape, 0.5, np.float32)), 0)
    assert not level(op, y)[:, :, :, 24:][..., lit[:, 24:]].any()  # what is measured as 0 is not filled


def planes_of(views, frames):
    return pnp_sci.SensingOperator(pnp_sci.random_masks((views, frames, 24, 24), seed=1))


def test_noise_counts_the_more_the_fewer_frames_there_are():
    """In units of the variance, at the same noise in a pixel of x; 20 frames have the same at any noise."""

    def product(op, in_x):
        noise = in_x * np.sqrt(np.mean(op.gram))
        return schedule_for(op, noise).product / noise**2 * (1 + in_x)

    loud = [product(planes_of(views, frames), 0.2) for views, frames in ((1, 1), (2, 1), (1, 8), (2, 6), (2, 10))]
    assert loud == sorted(loud, reverse=True)
    assert loud[0] > 5 * loud[-1]
    faint = [product(planes_of(views, frames), 1e-4) for views, frames in ((1, 1), (1, 8), (2, 10))]
    np.testing.assert_allclose([*faint, loud[-1]], 0.6, rtol=1e-3)


def test_sigma_goes_by_the_number_of_frames_where_there_is_no_noise():
    plans = [schedule_for(planes_of(views, frames), 0) for views, frames in ((2, 3), (1, 8), (2, 6), (2, 10), (2, 14))]
    np.testing.assert_allclose([plan.first for plan in plans], [0.05, 0.05, 0.05, 0.05, 0.0575], rtol=1e-3)
    assert all(plan.first == plan.last for plan in plans)
    assert schedule_for(planes_of(1, 8), 0, sigma=0.1).first == 0.1
    few, many = (schedule_for(planes_of(*shape), 2.0) for shape in ((1, 8), (2, 20)))
    assert 0.05 < few.last < few.first, "noise raises it, at first the more"
    assert 0.0575 < many.last < many.first


def test_without_noise_sigma_is_none_to_tv_and_takes_no_call_away():
    plan = schedule_for(planes_of(2, 20), 0)
    assert plan.first <= TRUSTED
    assert schedule_for(planes_of(2, 20), 1e-9).enough(50) == plan.enough(50) == 50


def test_a_sigma_of_zero_beside_noise_is_no_error():
    assert schedule_for(planes_of(2, 10), 0.3, sigma=0.0).enough(50) == 50


def test_noise_of_each_pixel_makes_its_own_product():
    op = planes_of(1, 8)
    noise = np.array([[0.0, 0.1], [0.3, 0.5]]).repeat(12, 0).repeat(12, 1)
    alone = [schedule_for(op, float(n)).product for n in noise.flat]
    np.testing.assert_allclose(schedule_for(op, noise).product, np.reshape(alone, noise.shape))


def test_a_noisy_still_scene_is_better_than_its_measurement():
    """One view that stands still: y over the sum of its masks shows it as noisy as it came."""
    scene = pnp_sci.datasets.embedded_scene(96)
    truth = np.repeat(scene.truth[:1, 4:5], 8, axis=1)
    masks = scene.masks[:1, :8]
    y = pnp_sci.simulate(truth, masks, noise=0.03)
    total = masks[0].sum(0, dtype=np.float32)
    divided = np.divide(y, total, out=np.zeros_like(y), where=total > 0)
    result = pnp_sci.solve(y, masks, "tv", scene=pnp_sci.SceneModel((True,), still=True))
    assert pnp_sci.psnr(result.x[0, 0], truth[0, 0]) > pnp_sci.psnr(divided, truth[0, 0]) + 5


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS))
def test_the_memory_order_of_y_does_not_matter(algorithm):
    scene = pnp_sci.datasets.embedded_scene(48)
    op = SensingOperator(scene.masks)
    ends = []
    for y in (scene.y, np.asfortranarray(scene.y)):
        states = pnp_sci.iterate(op, y, TV(), level(op, scene.y), algorithm=algorithm, noise=0.1)
        ends.append(next(s.x for s in states if s.iteration == 5))
    assert np.array_equal(*ends)
