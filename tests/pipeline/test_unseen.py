"""An estimated noise is lowered to the error with which pixels are predicted that the solver has not seen."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.pipeline import tiles
from pnp_sci.pipeline import unseen as module
from pnp_sci.plugins import registry
from pnp_sci.plugins.protocols import Session, Traits

NOISE = 0.01  # of the largest y
SHAPE = (1, 8, 96, 96)
OPTIONS = {"prior": "flow", "init": "adjoint", "scene": "full"}


@pytest.fixture(scope="module")
def panned():
    """A texture that moves by a pixel from frame to frame: masks, and films of three measurements."""
    texture = gaussian_filter(np.random.default_rng(3).random((96, 120)), 1.5)
    texture = ((texture - texture.min()) / np.ptp(texture)).astype(np.float32)
    films = np.stack([texture[:, t : t + 96] for t in range(24)]).reshape(3, *SHAPE)
    return pnp_sci.random_masks(SHAPE, seed=9), films


def measured(panned, noise=0.0):
    masks, films = panned
    return pnp_sci.simulate(films[0], masks, noise, seed=4)


def estimate(masks, y):
    return pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)


@pytest.mark.parametrize("options", [{}, {"algorithm": "admm"}, {"backend": "torch"}])
def test_texture_is_not_taken_for_noise(panned, options):
    masks, films = panned
    y = measured(panned)
    result, before = (pnp_sci.solve(y, masks, **OPTIONS, **options, noise=n) for n in ("auto", estimate(masks, y)))
    assert result.settings["noise"][0] < 0.5 * estimate(masks, y)
    assert result.settings["plan"][0]["rho"] < 0.3 * before.settings["plan"][0]["rho"]
    gain = pnp_sci.psnr(result.x, films[0]) - pnp_sci.psnr(before.x, films[0])
    assert gain > (0.5 if "algorithm" in options else 3)


@pytest.mark.parametrize("noise", [0.01, 0.03])
@pytest.mark.parametrize("options", [{}, {"algorithm": "admm"}, {"algorithm": "plain-gap"}, {"init": "ofanet-fast"}])
def test_it_is_not_less_than_the_noise(panned, noise, options):
    masks, films = panned
    right = noise * float(pnp_sci.simulate(films[0], masks).max())
    used = pnp_sci.solve(measured(panned, noise), masks, **OPTIONS | options).settings["noise"][0]
    assert used > 0.85 * right


def test_flicker_is_not_taken_for_noise():
    smooth = gaussian_filter(np.random.default_rng(3).random((96, 96)), 4)
    flicker = np.array([1, 0.5, 0.9, 0.4, 0.8, 0.6])[:, None, None]
    truth = ((smooth - smooth.min()) / np.ptp(smooth) * flicker)[None].astype(np.float32)
    masks = pnp_sci.random_masks(truth.shape, seed=9)
    y = pnp_sci.simulate(truth, masks)
    result, before = (pnp_sci.solve(y, masks, **OPTIONS, noise=n) for n in ("auto", estimate(masks, y)))
    assert result.settings["noise"][0] < 0.6 * estimate(masks, y)
    assert pnp_sci.psnr(result.x, truth) > pnp_sci.psnr(before.x, truth) + 1


@pytest.mark.parametrize(
    "told", [{"noise": 0.5}, {"noise": 0.0}, {"noise": pnp_sci.Sensor(0.4, gain=0.01)}, {"sigma": 0.05}]
)
def test_what_is_known_stays(panned, told, monkeypatch):
    masks, _ = panned
    monkeypatch.setattr(module, "noise_of_prediction", lambda *_: pytest.fail("pixels were predicted"))
    pnp_sci.solve(measured(panned), masks, **OPTIONS | told, iterations=4)


@pytest.mark.parametrize("options", [{"prior": "tv"}, {"iterations": 1}, {"prior": "flow", "iterations": 40}])
def test_the_estimate_stays(panned, options, monkeypatch):
    """With weak priors, one call, or none after the warm-up: then all pixels are seen from the beginning."""
    masks, _ = panned
    monkeypatch.setattr(module, "noise_of_prediction", lambda *_: pytest.fail("pixels were predicted"))
    y = measured(panned)
    result, known = (
        pnp_sci.solve(y, masks, **{"iterations": 4} | OPTIONS | options, noise=n) for n in ("auto", estimate(masks, y))
    )
    np.testing.assert_allclose(result.x, known.x, atol=1e-5)


@dataclass(frozen=True)
class Watched(pnp_sci.Prior):
    """Returns what it is given, and notes in which pixels of y that has changed."""

    notes: list

    def traits(self, shape):
        return Traits(strong=True)

    def begin(self, shape, dtype):
        return WatchedSession(self.notes)


class WatchedSession(Session):
    def __init__(self, notes):
        self.notes, self.before = notes, None

    def __call__(self, v, sigma, out=None):
        if self.before is not None:
            self.notes.append(np.abs(v - self.before).max((0, 1)) > 0)
        self.before = v * np.float32(0.9)
        return self.before.copy()


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
def test_later_calls_see_all_pixels(panned, algorithm):
    masks, _ = panned
    notes = []
    given = {"algorithm": algorithm, "scene": "full", "init": "adjoint", "iterations": 10}
    pnp_sci.solve(measured(panned), masks, Watched(notes), **given)
    open_pixels = masks.any((0, 1))
    assert len(notes) == 9
    assert [bool((changed | ~open_pixels).all()) for changed in notes[5:]] == [True] * 4


def test_a_solve_does_not_converge_before_it_has_seen_all_pixels(panned):
    masks, _ = panned
    result = pnp_sci.solve(measured(panned), masks, **OPTIONS, tol=1.0)
    plan = result.settings["plan"][0]
    assert result.status.name == "CONVERGED"
    assert result.history[-1].iteration > (2 * plan["serves"][-1]["from"] + plan["iterations"]) // 3


@pytest.mark.parametrize("sequence", [True, 3])
def test_sequences_do_not_take_it_for_noise_either(panned, sequence):
    masks, films = panned
    y = np.stack([pnp_sci.simulate(film, masks) for film in films])
    first = estimate(masks, y[0])
    result, before = (pnp_sci.solve(y, masks, **OPTIONS, sequence=sequence, noise=n) for n in ("auto", first))
    assert max(result.settings["noise"]) < 0.5 * first
    gains = [pnp_sci.psnr(x, film) - pnp_sci.psnr(old, film) for x, old, film in zip(result.x, before.x, films)]
    assert np.min(gains) > 3


def test_tiles_do_not_take_it_for_noise_either(panned, monkeypatch):
    masks, films = panned
    film, masks = np.tile(films[0], (1, 1, 3, 1)), np.tile(masks, (1, 1, 3, 1))
    y = pnp_sci.simulate(film, masks)
    monkeypatch.setattr(tiles, "MOST", 8 * 160**2)
    result = pnp_sci.solve(y, masks, **OPTIONS)
    assert result.settings["noise"][0] < 0.5 * estimate(masks, y)
    before = pnp_sci.solve(y, masks, **OPTIONS, noise=estimate(masks, y))
    assert pnp_sci.psnr(result.x, film) > pnp_sci.psnr(before.x, film) + 2


def test_saturated_and_bad_pixels_say_nothing(panned):
    masks, _ = panned
    y = measured(panned, NOISE)
    bad = np.random.default_rng(1).random(y.shape) < 0.1
    top = float(np.quantile(y, 0.995))
    wild = np.where(bad, 1e3, np.minimum(y, top))
    used = pnp_sci.solve(wild, masks, **OPTIONS, noise=pnp_sci.Sensor(full_scale=top), bad=bad).settings["noise"][0]
    usual = pnp_sci.solve(y, masks, **OPTIONS).settings["noise"][0]
    assert used == pytest.approx(usual, rel=0.35)


def test_uncertainty_counts_with_it(panned):
    masks, films = panned
    result = pnp_sci.solve(measured(panned), masks, **OPTIONS, uncertainty=True)
    assert np.sqrt(np.mean((result.x - films[0]) ** 2)) == pytest.approx(
        np.sqrt(np.mean(result.uncertainty**2)), rel=0.6
    )


def test_small_pictures_keep_the_estimate(panned):
    masks, films = panned
    masks, film = masks[..., :48, :48], films[0][..., :48, :48]
    y = pnp_sci.simulate(film, masks)
    assert pnp_sci.solve(y, masks, **OPTIONS).settings["noise"][0] == pytest.approx(estimate(masks, y), rel=1e-4)


def test_decoders_begin_with_all_pixels(panned, monkeypatch):
    """Only the solver does not see some."""
    masks, _ = panned
    seen = []

    def half(problem, _):
        seen.append((problem.op.gram > 0) == masks.any((0, 1)))
        return np.full(problem.op.shape, 0.5, problem.op.dtype)

    monkeypatch.setitem(registry._registered["decoders"], "half", lambda: half)
    pnp_sci.solve(measured(panned), masks, **OPTIONS | {"init": "half", "iterations": 4})
    assert seen[0].all()
