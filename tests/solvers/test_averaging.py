"""The mean of estimates that fluctuate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_priors import Made

import pnp_sci
from pnp_sci import Traits, datasets, solve
from pnp_sci.solvers.averaging import RunningMean
from pnp_sci.solvers.state import State


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(32)


def mean_of(pictures):
    """The n-th of them weighted with n (n + 1) ... (n + 4)."""
    return np.average(pictures, axis=0, weights=[np.prod(n + np.arange(5.0)) for n in range(1, len(pictures) + 1)])


def relative(a, b):
    return np.linalg.norm(np.asarray(a, float) - np.asarray(b, float)) / np.linalg.norm(np.asarray(b, float))


@given(averages=st.lists(st.booleans(), min_size=1, max_size=9), seed=st.integers(0, 99))
def test_the_mean_is_of_all_since_averaging_began(averages, seed):
    rng = np.random.default_rng(seed)
    states = [
        State(n, rng.random((1, 1, 2, 3)), rng.random((2, 3)), np.zeros((2, 3))) for n in range(len(averages) + 1)
    ]
    mean, since = RunningMean(), []
    mean(states[0], False)
    for state, asked in zip(states[1:], averages):
        since = [*since, state] if asked else []
        before = state.x.copy(), state.residual.copy()
        found = mean(state, asked)
        expected = since or [state]
        np.testing.assert_allclose(found.x, mean_of([s.x for s in expected]), rtol=1e-9)
        np.testing.assert_allclose(found.residual, mean_of([s.residual for s in expected]), rtol=1e-9)
        assert found.iteration == state.iteration
        assert np.array_equal(before[0], state.x), "the solver goes on from the iterate itself"
        assert np.array_equal(before[1], state.residual)


def noting(answers, **traits):
    """A prior whose answers alternate, and all that it has answered."""

    def call(v, sigma):
        answers.append(0.9 * v + (-1) ** len(answers) * v.dtype.type(sigma))
        return answers[-1]

    return Made(call, known=Traits(**traits))


@pytest.mark.parametrize("algorithm", ["gap", "admm"])
@pytest.mark.parametrize("first", [0, 2, 5])
def test_the_result_is_a_mean_where_the_prior_asks_for_it(scene, algorithm, first):
    """Of all answers after the warm-up; history and callback tell of the mean too."""
    answers, same, states = [], [], []
    warmup = (noting(answers), first) if first else None
    result = solve(
        scene.y, scene.masks, noting(answers, average=True, warmup=warmup),
        algorithm=algorithm, iterations=6, tol=0, reference=scene.truth, callback=states.append,
    )  # fmt: skip
    solve(scene.y, scene.masks, noting(same), algorithm=algorithm, iterations=6, tol=0)
    assert all(np.array_equal(*pair) for pair in zip(answers, same, strict=True)), "the iterates know nothing of it"
    op = pnp_sci.SensingOperator(scene.masks)
    y = states[0].residual + op.forward(states[0].x)
    for n, state in enumerate(states[1:], 1):
        mean = mean_of(answers[first:n]) if n > first else answers[n - 1]
        assert relative(state.x, mean) < 1e-6
        np.testing.assert_allclose(state.residual, y - op.forward(state.x), atol=1e-4)
        expected = np.linalg.norm(state.residual) / np.linalg.norm(y)
        assert result.history[n].residual == pytest.approx(expected, rel=1e-4)
    assert relative(result.x, states[-1].x * result.settings["unit"][0]) < 1e-6
    assert result.history[-1].psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x, scene.truth)), abs=1e-3)


def test_a_mean_does_not_reach_the_next_measurement(scene):
    both = solve(np.stack([scene.y[::-1], scene.y]), scene.masks, noting([], average=True), iterations=4)
    alone = solve(scene.y, scene.masks, noting([], average=True), iterations=4)
    assert np.array_equal(both.x[1], alone.x)


@pytest.mark.parametrize(("grows", "status"), [(20.0, "DIVERGED"), (np.nan, "NOT_FINITE")])
def test_the_guard_looks_at_the_iterates_and_not_at_the_mean(scene, grows, status):
    """A run ends at the same iteration whether estimates are averaged or not."""
    found = []
    for average in (False, True):
        calls = []

        def call(v, sigma, calls=calls):
            calls.append(sigma)
            return v * np.float32(grows if len(calls) > 3 else 0.9)

        prior = Made(call, known=Traits(average=average))
        result = solve(scene.y, scene.masks, prior, algorithm="plain-gap", iterations=30)
        assert result.status.name == status
        assert np.isfinite(result.x).all()
        found.append(len(calls))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", ["bm3d", "flow", "desci", "ffdnet", "video", "wavelet", "tv+wavelet"])
@pytest.mark.parametrize("frames", [1, 3])
def test_which_priors_ask_for_it(name, frames):
    """Those that fluctuate; the images of `ffdnet` do not, but for its turns where there is a single frame."""
    if name in ("ffdnet", "video"):
        pytest.importorskip("torch")
    traits = pnp_sci.as_prior(name).traits((1, frames, 32, 32))
    assert traits.average == ((name, frames) != ("ffdnet", 3))


@pytest.mark.parametrize("name", ["tv", "none"])
def test_which_priors_do_not(name):
    assert not pnp_sci.as_prior(name).traits((1, 3, 32, 32)).average
