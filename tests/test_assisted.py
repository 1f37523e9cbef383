"""Networks that TV assists: whose turn it is, and how many turns noise leaves of use."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci import datasets
from pnp_sci.errors import DataUnavailableError, InputError, InputTypeError
from pnp_sci.plugins.resolve import make_prior
from pnp_sci.solvers.plan import ENOUGH, MORE, Schedule
from priors.assisted import DEMAND, FIRST, MOST, NOISY, Assisted
from priors.tv import TV


class Net:
    """Says what it was called with instead of denoising."""

    learned = True

    def __init__(self):
        self.loaded, self.sigmas, self.turns = 0, [], []

    def load(self):
        self.loaded += 1

    def __call__(self, x, sigma, turn):
        self.sigmas.append(sigma)
        self.turns.append(turn)
        return x.copy()


def assisted(first=3):
    return Assisted(Net(), TV(), TV(0.4), stronger=1.5, first=first)


def served(denoise, sigmas):
    """Which of these calls the network served."""
    turns = []
    for sigma in sigmas:
        before = len(denoise.net.sigmas)
        denoise(np.zeros((1, 2, 8, 8), np.float32), sigma)
        turns.append(len(denoise.net.sigmas) > before)
    return turns


def test_tv_has_the_first_calls_and_the_network_is_loaded_at_once():
    denoise = assisted()
    assert served(denoise, [0.05] * 5) == [False] * 3 + [True] * 2
    assert denoise.net.loaded == 5
    denoise.reset()
    assert served(denoise, [0.05] * 4) == [False] * 3 + [True]
    denoise(np.zeros((1, 2, 9, 8), np.float32), 0.05)  # another video
    assert len(denoise.net.sigmas) == 3


def test_the_network_waits_while_a_large_sigma_falls():
    assert served(assisted(0), [0.3, 0.2, 0.2, 0.2]) == [False, False, True, True]
    assert served(assisted(0), [0.3, 0.9 * NOISY, 0.8 * NOISY]) == [False, True, True]


def test_the_network_denoises_more_than_the_solver_asks_for_within_its_training():
    denoise = assisted(0)
    served(denoise, [0.02, 0.5])
    assert denoise.net.sigmas == [1.5 * 0.02, MOST]


def test_tv_takes_what_the_network_is_not_told(monkeypatch):
    denoise, sigmas = assisted(0), []
    monkeypatch.setattr(TV, "__call__", lambda self, x, sigma: sigmas.append(sigma) or x)
    served(denoise, [0.02, 0.5])
    assert sigmas == pytest.approx([0.02, 0.5 * 1.5 * 0.5 / MOST])


@given(noisy=st.floats(0.05, 1), noisier=st.floats(1, 3), most=st.integers(1, 300))
def test_noise_leaves_fewer_iterations_of_use(noisy, noisier, most):
    less, more = Schedule(0.1, 1, noisy).enough(most), Schedule(0.1, 1, noisy * noisier).enough(most)
    assert min(most, ENOUGH) <= more <= less <= min(most, ENOUGH + MORE)


def test_without_noise_all_iterations_are_of_use():
    assert Schedule(0, 0.05, 0.05).enough(110) == 110
    assert Schedule(0, 0, 0).enough(110) == 110
    assert Schedule(0, 0.1, 0.1).enough(300) == 300  # a given sigma is no noise


@pytest.mark.parametrize(
    ("attribute", "given", "expected"),
    [("learned", None, 50), ("thorough", None, 50), ("plain", None, 100), ("learned", 70, 70)],
)
def test_the_solver_stops_early_with_noise_only_what_is_thorough_and_has_no_number(attribute, given, expected):
    scene = datasets.embedded_scene(64)
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=0.1)
    prior = TV(time=0)
    setattr(prior, attribute, True)
    result = pnp_sci.solve(y, scene.masks, prior, tol=0, scene="full", iterations=given)
    assert len(result.history) - 1 == pytest.approx(expected, abs=2)
    again = pnp_sci.solve(y, scene.masks, prior, tol=0, scene="full", iterations=result.settings["iterations"])
    np.testing.assert_allclose(again.x, result.x, atol=1e-5)


def test_a_later_stage_begins_with_the_network():
    pytest.importorskip("torch")
    stages = make_prior([("ffdnet", 2), ("ffdnet", 3), ("tv", 1)])
    assert [getattr(denoiser, "first", None) for denoiser, _ in stages.stages] == [FIRST, 0, None]
    assert make_prior([("flow", 61), ("flow", 3)]).stages[1][0].first == 0
    assert make_prior([("tv", 2), ("video", 3)], first=1).stages[1][0].first == 1


def test_what_a_view_brings_anew_is_bounded_in_that_view_only():
    rng = np.random.default_rng(0)
    x, wild = np.zeros((2, 3, 16, 16), np.float32), rng.standard_normal((2, 3, 16, 16)).astype(np.float32)
    wild[1] *= 0.01
    denoise = Assisted(Net(), TV(), lambda x, sigma: x, stronger=1.5, first=FIRST)
    for _ in range(FIRST + 1):
        denoise(x, 0.05)
    bounded, free = denoise(wild, 0.05)  # Net returns what it sees
    assert np.sqrt(np.mean(bounded**2)) == pytest.approx(DEMAND * 0.05, rel=1e-4)
    np.testing.assert_allclose(bounded, wild[0] * (bounded[0, 0, 0] / wild[0, 0, 0, 0]), rtol=1e-4)
    np.testing.assert_allclose(free, wild[1], atol=1e-7)
    further = denoise(2 * wild, 0.05)[0]
    assert np.sqrt(np.mean((further - bounded) ** 2)) == pytest.approx(DEMAND * 0.05, rel=1e-4)
    np.testing.assert_array_equal(denoise(wild, 0.0), wild)
    denoise.reset()  # a new video
    for _ in range(FIRST):
        denoise(x, 0.05)
    np.testing.assert_array_equal(denoise(wild, 0.05), wild)


def test_the_network_sees_every_call_otherwise():
    denoise = assisted(2)
    served(denoise, [0.05] * 10)
    assert sorted(turn % 8 for turn in denoise.net.turns) == list(range(8))


def test_early_calls_and_those_after_tv_may_bring_anything():
    rng = np.random.default_rng(0)
    x, wild = np.zeros((1, 3, 16, 16), np.float32), rng.standard_normal((1, 3, 16, 16)).astype(np.float32)
    denoise = Assisted(Net(), TV(), lambda x, sigma: x, stronger=1.5, first=0)
    for _ in range(2):
        denoise(x, 0.05)
    np.testing.assert_array_equal(denoise(wild, 0.05), wild)
    for _ in range(FIRST):
        denoise(x, 0.05)
    denoise._before = 1.0
    denoise(x, 0.5)  # a large sigma falls: TV
    np.testing.assert_array_equal(denoise(wild, 0.05), wild)


def test_a_result_may_be_overwritten():
    denoise = assisted(0)
    x = np.full((1, 2, 8, 8), 0.5, np.float32)
    for _ in range(FIRST + 2):
        out = denoise(x, 0.05)
        out *= 100
    np.testing.assert_allclose(denoise(x, 0.05), x)


def test_a_network_from_the_start_keeps_blacks_and_whites():
    """Early estimates are nearly the mean: their range must not bind later ones."""
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(64)
    from_the_start, after_tv = (
        pnp_sci.solve(scene.y, scene.masks, "ffdnet", iterations=60, first=first, scene="full", reference=scene.truth)
        for first in (0, FIRST)
    )
    assert from_the_start.history[-1].psnr > after_tv.history[-1].psnr - 0.3
    assert from_the_start.x.min() < 0.05


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_another_type_begins_a_new_video_and_bad_input_is_an_error_at_once(name):
    pytest.importorskip("torch")
    denoise = make_prior(name, first=0)
    x = np.random.default_rng(0).random((1, 3, 32, 32))
    assert [denoise(x.astype(t), 0.05).dtype.name for t in ("float64", "float32")] == ["float64", "float32"]
    for bad in (x.astype(np.uint8), x[0], x.astype(np.float16)):
        with pytest.raises((InputError, InputTypeError), match="x "):
            make_prior(name)(bad, 0.05)
    with pytest.raises(InputError, match="sigma is inf"):
        make_prior(name)(x, np.inf)


def test_a_result_says_which_weights_made_it():
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    settings = pnp_sci.solve(scene.y, scene.masks, [("tv", 1), ("ffdnet", 1)]).settings
    assert settings["weights"] == [make_prior("ffdnet").sha256]
    assert "torch" in settings["versions"]
    assert make_prior("video").sha256 != make_prior("video").net._runner.sha256  # the image net's are in it
    assert pnp_sci.solve(scene.y, scene.masks, "tv", iterations=1).settings["weights"] == []


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_five_hundred_iterations_are_stable(name):
    pytest.importorskip("torch")
    truth, masks = (a[:, :6, :40, :40] for a in (datasets.embedded_scene(64).truth, datasets.embedded_scene(64).masks))
    y = pnp_sci.simulate(truth, masks)
    settings = {"iterations": 500, "first": 30, "sigma": 5 / 255, "tol": 0, "scene": "full", "reference": truth}
    cold, warm = (pnp_sci.solve(y, masks, name, init, **settings).history["psnr"] for init in ("adjoint", "auto"))
    print(f"{name}: {cold.max():.2f} dB at best, {cold[-1]:.2f} in the end, {warm[-1]:.2f} from a network")
    assert cold[cold.argmax() :].min() > cold.max() - 0.7
    assert cold.argmax() > 30  # the network has gained something
    assert warm[-1] > cold[-1] - 0.1, "a better start may be used up in the end, but no more than that"


@pytest.mark.parametrize("first", [-1, 1.5, "many"])
def test_an_unfit_first_is_named(first):
    with pytest.raises(InputError, match=r"first is.*>= 0"):
        assisted(first)


def test_video_is_better_than_flow_in_both_views():
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(128)
    flow, video = (pnp_sci.solve(scene.y, scene.masks, p, scene="full").x for p in ("flow", "video"))
    assert (pnp_sci.psnr(video, scene.truth) > pnp_sci.psnr(flow, scene.truth)).all()


@pytest.mark.parametrize(("effort", "prior", "iterations"), [("balanced", "video", 90), ("best", "both", 110)])
def test_auto_is_video_alone_or_with_flow(effort, prior, iterations):
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", effort=effort, noise=0, tol=0)
    assert result.settings["prior"] == prior
    assert result.settings["iterations"] == iterations


def test_both_are_left_to_video_where_nothing_shows_motion():
    pytest.importorskip("torch")
    x = datasets.embedded_scene(48).truth[:, :3]
    both, video = make_prior("both", first=0), make_prior("video", first=0)
    for still in (x[:, :1], x[..., :24, :24]):
        assert np.array_equal(both(still, 0.05), video(still, 0.05))
    assert not np.array_equal(both(x, 0.05), video(x, 0.05))
    assert both.first == 0
    assert make_prior("both").first == 60


@pytest.mark.parametrize("size", [(2, 1, 40, 40), (2, 3, 24, 24)])
def test_video_is_ffdnet_where_nothing_shows_motion(size):
    pytest.importorskip("torch")
    x = datasets.embedded_scene(48).truth[:, : size[1], : size[2], : size[3]].astype(np.float32)
    video, ffdnet = make_prior("video", first=2), make_prior("ffdnet", first=2)
    for sigma in (0.1, 0.05, 0.05, 0.05):  # the first two are TV's
        estimate = video(x, sigma)
        np.testing.assert_array_equal(estimate, ffdnet(x, sigma))
        x = estimate
    video.reset()
    np.testing.assert_array_equal(video(x, 0.1), make_prior("ffdnet", first=2)(x, 0.1))


@pytest.mark.parametrize("name", ["video", "both"])
def test_a_still_video_in_between_makes_a_moving_one_begin_anew(name):
    pytest.importorskip("torch")
    moving = datasets.embedded_scene(48).truth[:, :4].astype(np.float32)
    prior = make_prior(name, first=1)
    first = [prior(moving, 0.05) for _ in range(3)]
    still = moving[:, :1]
    prior(still, 0.05)
    np.testing.assert_array_equal(prior.finish(still, 0.05), still)
    assert not prior.restless
    for expected in first:
        np.testing.assert_array_equal(prior(moving, 0.05), expected)


def test_flow_and_video_together_beat_either():
    """They err differently, as what they are made of does."""
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(128)
    together, *alone = (
        pnp_sci.solve(scene.y, scene.masks, prior, scene="full", effort="best").x for prior in ("both", "flow", "video")
    )
    for x in alone:
        assert pnp_sci.psnr(together, scene.truth).mean() > pnp_sci.psnr(x, scene.truth).mean()


@pytest.mark.parametrize("effort", ["balanced", "best"])
def test_auto_without_torch_is_flow(monkeypatch, effort):
    monkeypatch.setattr("pnp_sci.pipeline.defaults.find_spec", lambda name: None)
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", effort=effort, iterations=2)
    assert result.settings["prior"] == pnp_sci.solve(scene.y, scene.masks, "flow", iterations=2).settings["prior"]


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_missing_weights_are_an_error_at_once(name, tmp_path):
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    with pytest.raises(DataUnavailableError, match="weights"):
        pnp_sci.solve(scene.y, scene.masks, name, weights=tmp_path / "none.safetensors", iterations=1)
