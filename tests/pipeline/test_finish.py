"""What priors make of the last estimate, however a run has ended."""

import numpy as np
import pytest
from made_priors import Made, answering
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import SceneModel, Status, Traits, datasets, solve
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import Joint, Stages


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def relative(a, b):
    return np.linalg.norm(np.asarray(a, float) - np.asarray(b, float)) / np.linalg.norm(np.asarray(b, float))


@pytest.mark.parametrize("average", [False, True])
def test_a_prior_may_finish_the_last_estimate(scene, average):
    """Once a measurement; result, residual and PSNR are those of what it makes, and the solver's iterates are not."""

    def call(v, sigma):
        return v + sigma * np.sin(np.arange(v.size, dtype=v.dtype)).reshape(v.shape)

    def end(x, sigma):
        finished.append(0.9 * x + np.float32(sigma))
        return finished[-1]

    finished, states = [], []
    y = np.stack([scene.y, 0.5 * scene.y])
    result = solve(y, scene.masks, Made(call, end, Traits(average=average)), iterations=4, callback=states.append,
                   reference=np.stack([scene.truth, 0.5 * scene.truth]))  # fmt: skip
    assert len(finished) == 2
    op = pnp_sci.SensingOperator(scene.masks)
    for n, (x, unit) in enumerate(zip(finished, result.settings["unit"])):
        assert relative(result.x[n], x * unit) < 1e-6
        assert relative(x, 0.9 * states[5 * n + 4].x + np.float32(states[5 * n + 4].sigma)) < 1e-6
        last = [record for record in result.history if record.measurement == n][-1]
        assert last.residual == pytest.approx(relative(op.forward(result.x[n]), y[n]), rel=1e-3)
        truth = (1 - 0.5 * n) * scene.truth
        assert last.psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x[n], truth)), abs=1e-3)


def quarter(x, sigma):
    return np.full_like(x, 0.25)


@pytest.mark.parametrize(
    "prior",
    [
        Joint([answering(0.5, end=quarter), answering(0.5, end=quarter)]),
        Stages([(answering(0.5), 2), (answering(0.5, end=quarter), 1)]),
        answering(0.5, end=quarter, warmup=(answering(0.5), 2)),
    ],
    ids=["joint", "stages", "warm-up"],
)
def test_combinations_finish(scene, prior):
    result = solve(scene.y, scene.masks, prior, iterations=3, scene="full")
    assert np.allclose(result.x, 0.25 * result.settings["unit"][0])


def test_a_prior_that_has_not_served_does_not_finish(scene):
    warming = answering(0.5, end=quarter, warmup=(answering(0.5), 10))
    result = solve(scene.y, scene.masks, warming, iterations=3, scene="full")
    assert not np.allclose(result.x, 0.25 * result.settings["unit"][0])


ENDS = {
    "iterations": ({"iterations": 3}, Status.ITERATIONS),
    "plateau": ({"tol": 1.0}, Status.CONVERGED),
    "callback": ({"callback": lambda state: state.iteration == 2}, Status.STOPPED),
    "still": ({"iterations": 3, "scene": SceneModel((True, False), still=True)}, Status.ITERATIONS),
}


@pytest.mark.parametrize(("options", "status"), ENDS.values(), ids=ENDS)
def test_however_it_ends_the_last_estimate_is_finished(scene, options, status):
    prior = Made(lambda v, sigma: v, lambda x, sigma: np.full_like(x, 3 * sigma))
    result = solve(scene.y, scene.masks, prior, noise=0, **options)
    assert result.status is status
    shown = np.array(result.scene["views"])
    expected = np.full_like(result.x[shown], 3 * result.history[-1].sigma * result.settings["unit"][0])
    assert relative(result.x[shown], expected) < 1e-5
    assert not result.x[~shown].any()


@pytest.mark.parametrize("options", [{"callback": lambda state: True}, {"time_budget": 0.0}])
def test_what_nothing_has_denoised_is_not_finished(scene, options):
    ends = None, lambda x, sigma: x * sigma
    results = [solve(scene.y, scene.masks, Made(end=end), **options).x for end in ends]
    assert np.array_equal(*results)


def test_a_finish_that_fails(scene):
    """The estimate with the smallest residual comes back, as after any failure."""
    states = []
    result = solve(
        scene.y, scene.masks, Made(end=lambda x, sigma: x * np.nan), iterations=3, scene="full", callback=states.append
    )
    assert result.status is Status.NOT_FINITE
    best = min(states, key=lambda state: np.linalg.norm(state.residual))
    assert np.array_equal(result.x, best.x * np.float32(result.settings["unit"][0]))
    assert result.history[-1].iteration == best.iteration
    with pytest.raises(InputError, match="finish"):
        solve(scene.y, scene.masks, Made(end=lambda x, sigma: x[:, :1]), iterations=3)


def test_what_the_guard_ends_is_not_finished(scene):
    def end(x, sigma):
        raise AssertionError("the guard has ended this run")

    prior = Made(lambda v, sigma: v * np.float32(20), end)
    assert solve(scene.y, scene.masks, prior, algorithm="plain-gap", iterations=30).status is Status.DIVERGED


@pytest.mark.parametrize("name", ["flow", "video"])
def test_a_last_estimate_is_averaged_along_its_motion(name):
    """Faint errors of their own leave the frames of a moving scene; it stays as it is where no motion was measured."""
    if name == "video":
        pytest.importorskip("torch")
    random = np.random.default_rng(0)
    picture = gaussian_filter(random.standard_normal((96, 96)), 2)
    picture = (0.5 + 0.2 * picture / picture.std()).astype(np.float32)
    truth = np.stack([np.stack([np.roll(picture, (v + b, b), (0, 1)) for b in range(6)]) for v in range(2)])
    x = truth + 0.005 * random.standard_normal(truth.shape, np.float32)
    session = pnp_sci.as_prior(name).begin(x.shape, x.dtype)
    assert session.finish(x, 0.05) is x  # no call so far
    session(x.copy(), 0.05)
    better = session.finish(x.copy(), 0.05)
    inside = (..., slice(12, -12), slice(12, -12))
    assert better.dtype == x.dtype
    assert np.std((better - truth)[inside]) < 0.7 * np.std((x - truth)[inside])
    session(x.copy(), 0.05)
    other = np.stack([x[0], np.zeros_like(x[1])])
    assert np.array_equal(session.finish(other, 0.05)[0], better[0])  # views do not mix
    assert session.finish(x, 0.05) is x  # forgotten
