"""solve() on whole problems: quality, units, options, errors and the guard."""

import time

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import Status, datasets, solve
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError
from pnp_sci.pipeline.defaults import most_iterations
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import Joint


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def relative(a, b):
    return np.linalg.norm(np.asarray(a, float) - np.asarray(b, float)) / np.linalg.norm(np.asarray(b, float))


def test_recovers_the_embedded_scene():
    scene = datasets.embedded_scene(128)
    result = solve(scene.y, scene.masks, reference=scene.truth)
    assert result.x.shape == scene.truth.shape
    assert result.x.dtype == np.float32
    assert result.status.ok
    psnr = result.history["psnr"]
    assert psnr[-1] > psnr[0] + 6
    assert psnr[-1] == pytest.approx(np.mean(pnp_sci.psnr(result.x, scene.truth)), abs=1e-3)
    assert 0.5 < result.history[-1].ssim < 1
    assert result.history[-1].residual < 0.01


@pytest.mark.parametrize("pair", ["bear_blackswan", "car-b_car-w", "hike_hockey"])
def test_benchmark_pairs(pair, data):
    """At least the peers' GAP-TV minus 0.1 dB for every video."""
    peers = {"bear_blackswan": (23.85, 24.24), "car-b_car-w": (21.52, 22.10), "hike_hockey": (22.43, 23.93)}
    scene = datasets.dualview(pair)
    psnr = pnp_sci.psnr(solve(scene.y, scene.masks).x, scene.truth)
    assert (psnr >= np.array(peers[pair]) - 0.1).all(), psnr


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("factor", [1e-6, 1e-3, 255, 1e6])
def test_scale_equivariance(scene, factor, dtype):
    y = scene.y.astype(dtype)
    scaled, plain = (solve(dtype(a) * y, scene.masks).x for a in (factor, 1))
    assert relative(scaled, factor * plain) < 1e-4


@pytest.mark.parametrize("factor", [2.0, 1e3, 0.01])
def test_scaled_masks(scene, factor):
    """Masks times c make a video over c, to rounding: nothing divides by sum(masks)."""
    plain = solve(scene.y, scene.masks.astype(np.float32), iterations=40).x
    assert relative(factor * solve(scene.y, scene.masks * np.float32(factor), iterations=40).x, plain) < 1e-3


def test_view_permutation(scene):
    swapped = solve(scene.y, scene.masks[::-1], iterations=30).x[::-1]
    assert relative(swapped, solve(scene.y, scene.masks, iterations=30).x) < 1e-3


def test_several_measurements(scene):
    other = pnp_sci.simulate(scene.truth[:, ::-1], scene.masks)
    both = solve(np.stack([scene.y, other]), scene.masks, iterations=10, reference=np.stack([scene.truth] * 2))
    alone = solve(other, scene.masks, iterations=10)
    assert both.x.shape == (2, *scene.masks.shape)
    np.testing.assert_array_equal(both.x[1], alone.x)
    assert [r.measurement for r in both.history] == [0] * 11 + [1] * 11


def test_the_algorithms_agree(scene):
    gap = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60).x
    admm = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60, algorithm="admm").x
    assert relative(admm, gap) < 0.01
    plain = solve(scene.y, scene.masks, iterations=60, algorithm="plain-gap", reference=scene.truth).history["psnr"]
    assert plain[-1] > plain[0]


def test_time_budget(scene):
    """The call ends in time with a status that says so; 10 ** 6 iterations would not."""
    begin = time.perf_counter()
    result = solve(scene.y, scene.masks, iterations=10**6, tol=0, time_budget=0.3)
    assert time.perf_counter() - begin < 3
    assert result.status is Status.TIME_BUDGET
    assert np.isfinite(result.x).all()


def test_plateau_stops_the_solver(scene):
    result = solve(scene.y, scene.masks, tol=0.02)
    assert result.status is Status.CONVERGED
    assert len(result.history) < 60


def test_callback_stops_and_sees_every_state(scene):
    seen = []
    result = solve(scene.y, scene.masks, callback=lambda s: seen.append(s.iteration) or s.iteration == 5)
    assert result.status is Status.STOPPED
    assert seen == [0, 1, 2, 3, 4, 5]


def test_iterates_stay_as_they_were(scene):
    op = pnp_sci.SensingOperator(scene.masks)
    states, copies = [], []
    for state in pnp_sci.iterate(op, scene.y, pnp_sci.make_prior("tv"), np.zeros(op.shape, np.float32)):
        states.append(state.x)
        copies.append(state.x.copy())
        if state.iteration == 4:
            break
    for x, copy in zip(states, copies):
        np.testing.assert_array_equal(x, copy)


def test_a_diverging_prior_is_caught(scene):
    result = solve(scene.y, scene.masks, prior=lambda x, sigma: 3 * x, iterations=200)
    assert result.status is Status.DIVERGED
    assert np.isfinite(result.x).all()
    with pytest.raises(pnp_sci.errors.SolverError):
        result.raise_for_status()


def test_a_prior_that_returns_nan_is_caught(scene):
    def spoiled(x, sigma):
        spoiled.calls += 1
        return x * np.nan if spoiled.calls > 3 else x.copy()

    spoiled.calls = 0
    result = solve(scene.y, scene.masks, prior=spoiled)
    assert result.status is Status.NOT_FINITE
    assert np.isfinite(result.x).all()
    assert result.x.any()


def test_a_prior_may_return_what_numpy_understands(scene):
    """Lists, and values that float32 cannot hold, which the guard finds."""
    listed, plain = (solve(scene.y, scene.masks, p, iterations=3) for p in (lambda x, sigma: x.tolist(), "none"))
    np.testing.assert_array_equal(listed.x, plain.x)
    huge = solve(scene.y, scene.masks, lambda x, sigma: x + np.float64(1e300), iterations=3)
    assert huge.status is Status.NOT_FINITE
    assert np.isfinite(huge.x).all()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_decoder_that_fails_is_told(scene, value, monkeypatch):
    monkeypatch.setitem(registry._registered["decoders"], "spoiled", lambda op, y: np.full(op.shape, value))
    result = pnp_sci.decode(scene.y, scene.masks, "spoiled")
    assert result.status is Status.NOT_FINITE
    assert not result.x.any()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_value_that_no_mask_lets_through_is_caught(scene, value):
    """The guard looks at the residual alone."""
    masks = scene.masks.copy()
    masks[:, :, 3, 4] = 0

    def spoiled(x, sigma):
        x = x.copy()
        x[0, 0, 3, 4] = value
        return x

    result = solve(scene.y, masks, prior=spoiled, scene="full")
    assert result.status is Status.NOT_FINITE
    assert np.isfinite(result.x).all()


def test_stages_and_joint(scene):
    staged = solve(scene.y, scene.masks, prior=[("tv", 10), ("wavelet", 5)], tol=0)
    assert len(staged.history) == 16
    joint = solve(scene.y, scene.masks, prior="tv+wavelet", iterations=15, reference=scene.truth)
    assert joint.history["psnr"][-1] > joint.history["psnr"][0] + 2


def test_torch_module_as_prior(scene):
    torch = pytest.importorskip("torch")

    class Blur(torch.nn.Module):
        def forward(self, x, sigma):
            return torch.nn.functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)

    result = solve(scene.y, scene.masks, prior=Blur(), iterations=10, algorithm="plain-gap", reference=scene.truth)
    assert result.history["psnr"][-1] > result.history["psnr"][0]


def test_a_torch_module_that_returns_something_else_is_named(scene):
    torch = pytest.importorskip("torch")

    class Transpose(torch.nn.Module):
        def forward(self, x, sigma):
            return x.transpose(0, 1)

    class Two(torch.nn.Module):
        def forward(self, x, sigma):
            return x, x

    with pytest.raises(InputError, match=r"prior Transpose returns \(1, 20, .* was expected"):
        solve(scene.y, scene.masks, prior=Transpose(), iterations=1)
    with pytest.raises(InputError, match="prior Two returns tuple"):
        solve(scene.y, scene.masks, prior=Two(), iterations=1)


def test_a_module_that_works_in_place_leaves_its_input_alone():
    torch = pytest.importorskip("torch")

    class InPlace(torch.nn.Module):
        def forward(self, x, sigma):
            return x.zero_()

    x = np.ones((1, 2, 4, 4), np.float32)
    assert not pnp_sci.make_prior(InPlace())(x, 0.1).any()
    assert x.all()


def test_a_prior_that_has_been_made_may_be_given_again(scene):
    made = pnp_sci.make_prior([("tv", 2), ("wavelet", 1)])
    result = solve(scene.y, scene.masks, prior=made, iterations=3, scene="full")
    named = solve(scene.y, scene.masks, prior=[("tv", 2), ("wavelet", 1)], iterations=3, scene="full")
    np.testing.assert_array_equal(result.x, named.x)
    assert result.settings["prior"].startswith("Stages([(TV(")


def test_noise_is_regularised(scene):
    """With noise the limit does not fit y, and is better for it than one that does."""
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=0.1)
    aware = solve(y, scene.masks, reference=scene.truth)
    fitted = solve(y, scene.masks, noise=0, reference=scene.truth)
    assert aware.history["psnr"][-1] > fitted.history["psnr"][-1] + 1.5
    assert aware.history[-1].residual > 3 * fitted.history[-1].residual
    assert aware.settings["noise"][0] == pytest.approx(0.1 * scene.y.max(), rel=0.25)


def test_the_start_of_a_uniform_scene_is_the_scene():
    masks = pnp_sci.random_masks((2, 4, 32, 32))
    y = pnp_sci.SensingOperator(masks).forward(np.full(masks.shape, 0.5))
    result = solve(y, masks, iterations=30)
    assert np.abs(result.x - 0.5).max() < 0.02


def test_a_first_estimate_of_another_scale_is_named(scene):
    levels = np.round(255 * scene.truth).astype(np.uint8)
    with pytest.raises(InputError, match=r"init leaves a residual of 2\d\d times y: .* units of y"):
        solve(scene.y, scene.masks, init=levels)
    assert solve(255 * scene.y, scene.masks, init=levels, iterations=5).status.ok


def test_little_of_a_time_budget_goes_into_the_scene(scene, monkeypatch):
    """Whatever is not known by then to be simpler is modelled in full."""
    still = pnp_sci.simulate(np.repeat(scene.truth[:, :1], scene.masks.shape[1], 1), scene.masks)
    assert solve(still, scene.masks, "flow", iterations=1, time_budget=600).scene["still"]
    monkeypatch.setattr("pnp_sci.api.JUDGING", 0.0)
    result = solve(still, scene.masks, "flow", iterations=1, time_budget=600)
    assert result.scene["frames_modelled"] == result.scene["frames"]


def test_underflow_is_no_failure(scene):
    with np.errstate(all="raise"):
        for prior, options in (("tv", {}), ("flow", {"first": 42})):
            assert solve(scene.y, scene.masks, prior, iterations=45, **options).status.ok


def test_init_and_reference_in_users_units(scene):
    y, counts = 255 * scene.y, np.round(255 * scene.truth).astype(np.uint8)
    result = solve(y, scene.masks, "none", 255 * scene.truth, iterations=1)
    assert relative(result.x, 255 * scene.truth) < 1e-5
    result = solve(y, scene.masks, "none", counts, iterations=1, reference=counts)
    assert result.history["psnr"][0] > 50


def test_the_time_of_metrics_is_not_the_solvers(scene, monkeypatch):
    def slow(x, reference):
        time.sleep(0.1)
        return pnp_sci.psnr(x, reference)

    monkeypatch.setattr("pnp_sci.plugins.resolve.psnr", slow)
    solve(scene.y, scene.masks, iterations=1)  # compiles
    result = solve(scene.y, scene.masks, iterations=30, tol=0, reference=scene.truth)
    assert result.history[-1].seconds <= result.settings["seconds"] < 3


def idle(attribute):
    """A prior that does nothing, with an attribute that is true."""

    def prior(x, sigma):
        return x.copy()

    setattr(prior, attribute, True)
    return prior


@pytest.mark.parametrize(("effort", "calls", "fewer"), [("fast", 50, 50), ("balanced", 100, 60), ("best", 200, 80)])
def test_effort_is_a_number_of_iterations_fewer_for_thorough_priors(scene, effort, calls, fewer):
    priors = [idle(name) for name in ("plain", "learned", "thorough")]
    priors.append(Joint([idle("plain"), idle("thorough")]))
    results = [solve(scene.y, scene.masks, prior, effort=effort, noise=0) for prior in priors]
    assert [result.settings["iterations"] for result in results] == [calls, fewer, fewer, fewer]


def test_no_estimate_has_converged_before_a_thorough_prior_begins(scene):
    class Late:
        thorough, first, calls = True, 12, 0

        def __call__(self, x, sigma):
            self.calls += 1
            return np.zeros_like(x) if self.calls <= self.first else 0.5 * x

    still = solve(scene.y, scene.masks, lambda x, sigma: np.zeros_like(x), scene="full", algorithm="plain-gap")
    late = solve(scene.y, scene.masks, Late(), scene="full", algorithm="plain-gap")
    assert len(still.history) <= 12
    assert len(late.history) > 12 + 5


@pytest.mark.parametrize("name", ["flow", "bm3d", "ffdnet", "video", "both", "tv+flow"])
def test_priors_that_are_thorough(name):
    prior = pnp_sci.make_prior(name)
    assert getattr(prior, "learned", False) or prior.thorough
    assert prior.first == (60 if "flow" in name or name in ("video", "both") else 30)


def answering(answer, **attributes):
    """A prior that answers one value, with attributes such as `finish`."""

    def prior(x, sigma):
        return np.full_like(x, answer)

    vars(prior).update(attributes)
    return prior


def test_a_joint_prior_is_the_mean_of_its_members_by_their_shares():
    x = np.zeros((1, 2, 4, 4), np.float32)
    members = answering(0.4), answering(0.8), answering(0.1)
    assert np.allclose(Joint(members)(x, 0.1), 1.3 / 3)
    shared = Joint(members, [2, 1, 1])(x, 0.1)
    assert np.allclose(shared, 1.7 / 4)
    assert shared.dtype == x.dtype
    assert not hasattr(Joint(members), "finish")


def test_a_joint_prior_is_restless_while_a_member_is():
    members = answering(0.4), answering(0.8)
    joint = Joint(members)
    assert not joint.restless
    members[1].restless = True  # as priors become, in the course of a run
    assert joint.restless


def test_a_joint_prior_finishes_with_those_members_that_do():
    members = [answering(0, finish=lambda x, sigma: x + sigma), answering(0), answering(0, finish=lambda x, sigma: x)]
    x = np.ones((1, 2, 4, 4), np.float32)
    assert np.allclose(Joint(members, [3, 5, 1]).finish(x, 0.2), 1 + 0.2 * 3 / 4)


def test_solve_asks_a_joint_prior_to_finish(scene):
    whole = answering(0.5, finish=lambda x, sigma: np.full_like(x, 0.25))
    result = solve(scene.y, scene.masks, Joint([whole, answering(0.5)]), iterations=3, scene="full")
    assert np.allclose(result.x, 0.25 * result.settings["unit"][0])


@pytest.mark.parametrize("shares", [(), (1,), (1, 1, 1), (1, 0), (1, -1), (1, np.nan), (1, np.inf)])
def test_each_member_has_a_share_above_0(shares):
    with pytest.raises(InputError, match="number"):
        Joint([answering(0), answering(1)], shares)


def alternating(calm):
    """A prior whose answers alternate, and all that it has answered; after so many calls it is not restless."""
    answers = []

    class Prior:
        @property
        def restless(self):
            return len(answers) not in calm

        def __call__(self, x, sigma):
            answers.append(0.9 * x + (-1) ** len(answers) * sigma)
            return answers[-1]

    return Prior(), answers


@pytest.mark.parametrize("algorithm", ["gap", "admm"])
@pytest.mark.parametrize("calm", [(), (0, 1), (0, 1, 2, 3), (3,), range(7)])
def test_the_result_is_a_mean_while_the_prior_is_restless(scene, algorithm, calm):
    """Of all answers since, the n-th with weight n (n + 1) ... (n + 4); history and callback tell of the mean too."""
    prior, answers = alternating(calm)
    states = []
    result = solve(scene.y, scene.masks, prior, algorithm=algorithm, iterations=6, reference=scene.truth,
                   callback=states.append)  # fmt: skip
    again, same = alternating(range(7))
    solve(scene.y, scene.masks, again, algorithm=algorithm, iterations=6)
    assert all(np.array_equal(*pair) for pair in zip(answers, same, strict=True))  # the solver goes on without the mean
    op = pnp_sci.SensingOperator(scene.masks)
    y = states[0].residual + op.forward(states[0].x)
    for n, (answer, state) in enumerate(zip(answers, states[1:], strict=True), 1):
        since = answers[max((c for c in calm if c < n), default=0) : n] if n not in calm else [answer]
        mean = np.average(since, axis=0, weights=[np.prod(n + np.arange(5.0)) for n in range(1, len(since) + 1)])
        assert relative(state.x, mean) < 1e-6
        np.testing.assert_allclose(state.residual, y - op.forward(state.x), atol=1e-4)
        expected = np.linalg.norm(state.residual) / np.linalg.norm(y)
        assert result.history[n].residual == pytest.approx(expected, rel=1e-4)
    assert relative(result.x, mean * result.settings["unit"][0]) < 1e-6
    assert result.history[-1].psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x, scene.truth)), abs=1e-3)


def test_a_mean_does_not_reach_the_next_measurement(scene):
    results = []
    for y in (scene.y, np.stack([scene.y[::-1], scene.y])):
        video = solve(y, scene.masks, VideoLike(), iterations=5).x
        results.append(video if y.ndim == 2 else video[1])
    assert np.array_equal(*results)


class VideoLike:
    restless = True

    def __call__(self, x, sigma):
        return x + sigma * np.sin(np.arange(x.size, dtype=x.dtype)).reshape(x.shape)


@pytest.mark.parametrize(("grows", "status"), [(20.0, Status.DIVERGED), (np.nan, Status.NOT_FINITE)])
def test_the_guard_looks_at_what_the_solver_has_and_not_at_the_mean(scene, grows, status):
    def prior(x, sigma):
        calls.append(x)
        return x * np.float32(grows if len(calls) > 3 else 0.9)

    calls, found = [], []
    for prior.restless in (False, True):
        calls.clear()
        result = solve(scene.y, scene.masks, prior, algorithm="plain-gap", iterations=30)
        assert result.status is status
        assert np.isfinite(result.x).all()
        found.append(len(calls))
    assert found[0] == found[1]


@pytest.mark.parametrize("restless", [False, True])
def test_a_prior_may_finish_the_last_estimate(scene, restless):
    """Once a measurement; result, residual and PSNR are those of what it makes, and the solver's iterates are not."""

    class Finishing(VideoLike):
        def finish(self, x, sigma):
            finished.append(0.9 * x + np.float32(sigma))
            return finished[-1]

    finished, states = [], []
    Finishing.restless = restless
    y = np.stack([scene.y, 0.5 * scene.y])
    result = solve(y, scene.masks, Finishing(), iterations=4, reference=np.stack([scene.truth, 0.5 * scene.truth]),
                   callback=states.append)  # fmt: skip
    assert len(finished) == 2
    op = pnp_sci.SensingOperator(scene.masks)
    for n, (x, unit) in enumerate(zip(finished, result.settings["unit"])):
        assert relative(result.x[n], x * unit) < 1e-6
        assert relative(x, 0.9 * states[5 * n + 4].x + np.float32(states[5 * n + 4].sigma)) < 1e-6
        last = [record for record in result.history if record.measurement == n][-1]
        assert last.residual == pytest.approx(relative(op.forward(result.x[n]), y[n]), rel=1e-3)
        truth = (1 - 0.5 * n) * scene.truth
        assert last.psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x[n], truth)), abs=1e-3)


ENDS = {
    "iterations": ({"iterations": 3}, Status.ITERATIONS),
    "plateau": ({"tol": 1.0}, Status.CONVERGED),
    "callback": ({"callback": lambda state: state.iteration == 2}, Status.STOPPED),
    "still": ({"iterations": 3, "scene": pnp_sci.SceneModel((True, False), still=True)}, Status.ITERATIONS),
}


@pytest.mark.parametrize(("options", "status"), ENDS.values(), ids=ENDS)
def test_however_it_ends_the_last_estimate_is_finished(scene, options, status):
    def prior(x, sigma):
        return x.copy()

    prior.finish = lambda x, sigma: np.full_like(x, sigma)
    result = solve(scene.y, scene.masks, prior, noise=0, **options)
    assert result.status is status
    shown = np.array(result.scene["views"])
    assert relative(result.x[shown], np.full_like(result.x[shown], 0.05) * result.settings["unit"][0]) < 1e-5
    assert not result.x[~shown].any()


@pytest.mark.parametrize("options", [{"callback": lambda state: True}, {"time_budget": 0.0}])
def test_what_nothing_has_denoised_is_not_finished(scene, options):
    def prior(x, sigma):
        return x.copy()

    results = [solve(scene.y, scene.masks, prior, **options).x]
    prior.finish = lambda x, sigma: x * sigma
    results.append(solve(scene.y, scene.masks, prior, **options).x)
    assert np.array_equal(*results)


def test_a_finish_that_fails(scene):
    def prior(x, sigma):
        return x.copy()

    expected = solve(scene.y, scene.masks, prior, iterations=3)
    prior.finish = lambda x, sigma: x * np.nan
    result = solve(scene.y, scene.masks, prior, iterations=3)
    assert result.status is Status.NOT_FINITE
    assert np.array_equal(result.x, expected.x)
    assert result.history["residual"].tolist() == expected.history["residual"].tolist()
    prior.finish = lambda x, sigma: x[:, :1]
    with pytest.raises(InputError, match="finish"):
        solve(scene.y, scene.masks, prior, iterations=3)


def test_what_the_guard_ends_is_not_finished(scene):
    def prior(x, sigma):
        return x * np.float32(20)

    def finish(x, sigma):
        raise AssertionError("the guard has ended this run")

    prior.finish = finish
    assert solve(scene.y, scene.masks, prior, algorithm="plain-gap", iterations=30).status is Status.DIVERGED


@pytest.mark.parametrize("name", ["flow", "video"])
def test_a_last_estimate_is_averaged_along_its_motion(name):
    """Faint errors of their own leave the frames of a moving scene; it stays as it is where no motion was measured."""
    random = np.random.default_rng(0)
    picture = gaussian_filter(random.standard_normal((96, 96)), 2)
    picture = (0.5 + 0.2 * picture / picture.std()).astype(np.float32)
    truth = np.stack([np.stack([np.roll(picture, (v + b, b), (0, 1)) for b in range(6)]) for v in range(2)])
    x = truth + 0.005 * random.standard_normal(truth.shape, np.float32)
    prior = pnp_sci.make_prior(name)
    assert prior.finish(x, 0.05) is x  # no call so far
    for _ in range(prior.first + 1):
        prior(x, 0.05)
    better = prior.finish(x.copy(), 0.05)
    inside = (..., slice(12, -12), slice(12, -12))
    assert better.dtype == x.dtype
    assert np.std((better - truth)[inside]) < 0.7 * np.std((x - truth)[inside])
    for _ in range(prior.first + 1):
        prior(x, 0.05)
    other = np.stack([x[0], np.zeros_like(x[1])])
    assert np.array_equal(prior.finish(other, 0.05)[0], better[0])  # views do not mix
    assert prior.finish(x, 0.05) is x  # forgotten


@pytest.mark.parametrize(
    ("name", "options"), [("tv", {}), ("wavelet", {}), ("ffdnet", {"first": 0}), ("tv+ffdnet", {"first": 0})]
)
def test_not_restless(scene, name, options):
    prior = pnp_sci.make_prior(name, **options)
    solve(scene.y, scene.masks, prior, iterations=2, scene="full")
    assert not getattr(prior, "restless", False)


@pytest.mark.parametrize("name", ["bm3d", "flow", "ffdnet", "video", "both"])
@pytest.mark.parametrize("frames", [1, 3])
def test_restless_once_tv_no_longer_serves(name, frames):
    prior = pnp_sci.make_prior(name, first=2)
    rises = (name, frames) == ("ffdnet", 3)  # for long, where frames move
    x = np.random.default_rng(0).random((1, frames, 32, 32), np.float32)
    for _ in range(2):
        restless = []
        for _ in range(4):
            prior(x, 0.05)
            restless.append(prior.restless)
        assert restless == 2 * [False] + 2 * [not rises]
        prior.reset()
        assert not prior.restless


def test_settings_reproduce(scene):
    result = solve(scene.y, scene.masks, prior="tv", iterations=5, strength=0.5)
    s = result.settings
    again = solve(scene.y, scene.masks, s["prior"], s["init"], algorithm=s["algorithm"], iterations=s["iterations"],
                  noise=s["noise"][0], tol=s["tol"], seed=s["seed"], **s["prior_options"])  # fmt: skip
    assert relative(again.x, result.x) < 1e-5
    assert again.settings["y"] == s["y"]
    assert again.settings["init"] == s["init"] == "adjoint"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": np.ones((63, 64))}, "masks has 2 x 10 frames of 64 x 64, but y is 63 x 64"),
        ({"y": np.ones(5)}, "y has shape"),
        ({"y": np.array([["a"]])}, "y has dtype"),
        ({"masks": np.ones((2, 2))}, "masks has shape"),
        ({"prior": "no such"}, "prior is 'no such'.*auto, none.*tv.*wavelet"),
        ({"prior": 3}, "prior is 3"),
        ({"init": "no such"}, "init is 'no such'.*auto, adjoint"),
        ({"init": np.ones((1, 2))}, r"init has shape \(1, 2\)"),
        ({"algorithm": "no such"}, "algorithm is 'no such'.*gap.*admm"),
        ({"noise": -1}, "noise is -1"),
        ({"noise": "loud"}, "noise is 'loud'"),
        ({"iterations": 0}, "iterations is 0"),
        ({"tol": -1}, "tol is -1"),
        ({"tol": float("nan")}, "tol is nan"),
        ({"no_option": 3}, "takes no option no_option"),
        ({"strength": -1.0}, "strength is -1"),
        ({"reference": np.ones(3)}, "reference has shape"),
        ({"reference": np.ones((10, 2, 64, 64))}, r"reference has shape \(10, 2, 64, 64\)"),
        ({"reference": np.ones((2, 10, 64, 64), int)}, "reference has dtype int64: floats in .*uint8 or uint16"),
        ({"prior": "auto+tv"}, "'auto' stands alone"),
        ({"prior": [("tv", 1), ("auto", 1)]}, "'auto' stands alone"),
        ({"y": [[1], [1, 2]]}, "y is no array of numbers"),
        ({"masks": [[1], [1, 2]]}, "masks is no array of numbers"),
        ({"reference": "text"}, "reference has dtype"),
        ({"init": [[1], [1, 2]]}, "init is no array of numbers"),
        ({"init": dict}, "init has dtype object"),
        ({"prior": dict}, "prior is <class 'dict'>"),
        ({"prior": lambda x, sigma: None}, "what the prior returns has dtype object"),
        ({"prior": lambda x, sigma: x[0]}, "what the prior returns has shape"),
        ({"strength": "much"}, "prior 'tv' cannot be made with {'strength': 'much'}"),
        ({"algorithm": ["gap"]}, r"algorithm is \['gap'\]"),
        ({"scene": np.ones(3)}, "scene is array"),
        ({"sigma": 10**400}, "sigma is 1000"),
        ({"noise": np.complex64(1)}, "noise is"),
        ({"tol": None}, "tol is None"),
        ({"seed": -1}, "seed is -1"),
        ({"callback": 3}, "callback is 3"),
        ({"progress": np.ones(3)}, "progress is"),
        ({"device": 3}, "device is 3"),
    ],
)
def test_errors_name_the_argument(scene, change, message):
    arguments = {"y": scene.y, "masks": scene.masks, **change}
    with pytest.raises((InputError, InputTypeError, UnknownPluginError), match=message):
        solve(**arguments)


@pytest.mark.parametrize(
    ("name", "prior", "message"),
    [
        ("auto", dict, "name is 'auto'"),
        ("a+b", dict, "name is 'a\\+b'"),
        ("a:3", dict, "name is 'a:3'"),
        ("", dict, "name is ''"),
        ("three", 3, "prior is 3"),
    ],
)
def test_a_prior_whose_name_cannot_be_reached_is_not_registered(name, prior, message):
    with pytest.raises((InputError, InputTypeError), match=message):
        pnp_sci.register_prior(name, prior)


def test_non_finite_input_is_counted(scene):
    y = scene.y.copy()
    y[3, 4] = y[5, 6] = np.nan
    with pytest.raises(InputError, match=r"y has 2 values .* first at index \(3, 4\)"):
        solve(y, scene.masks)
    masks = scene.masks.astype(np.float32)
    masks[1, 2, 3, 4] = np.inf
    with pytest.raises(InputError, match=r"masks has 1 values .* \(1, 2, 3, 4\)"):
        solve(scene.y, masks)


def test_more_frames_take_a_thorough_prior_more_iterations():
    assert [most_iterations("fast", 60, frames) for frames in (1, 1000)] == [80, 80]
    assert most_iterations("balanced", 0, 20) == 60
    assert [most_iterations("balanced", 30, frames) for frames in (1, 20, 28, 40, 1000)] == [60, 60, 72, 80, 80]
    assert [most_iterations("best", 30, frames) for frames in (1, 12, 16, 20, 1000)] == [60, 60, 70, 80, 80]


def test_few_frames_take_a_plain_prior_fewer_iterations():
    assert [most_iterations("balanced", None, frames) for frames in (1, 2, 3, 4, 20)] == [55, 70, 85, 100, 100]
    assert most_iterations("fast", None, 1) == 50
