"""A decoder that the solver begins with has a part in the result where there is noise."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.pipeline.blend import blended
from pnp_sci.plugins import registry
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem
from priors.flow import Flow

SHAPE = (2, 4, 32, 32)
EQUAL = np.float32(np.sqrt(0.0015))  # apart by this, two estimates count the same


def posed(noise, gram=1.0):
    masks = np.zeros(SHAPE, np.float32)
    masks[0, 0] = np.sqrt(gram)
    return Problem(SensingOperator(masks), np.zeros(SHAPE[2:], np.float32), 1.0, noise)


def share(problem, x, other):
    """What `other` counts, after a look at the mean that comes of it."""
    mean, shares = blended(problem, x, other)
    assert np.allclose(mean, x + np.reshape(shares, (-1, 1, 1, 1)) * (other - x), atol=1e-6)
    return np.array(shares)


def test_share_follows_the_difference():
    """Each view its own: at most 0.5, and less both for an estimate far away and for one close by."""
    x, other = np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    other[0], other[1, :, ::2] = 0.01, 0.2  # half of the pixels of view 1
    assert np.allclose(share(posed(10.0), x, other), [1e-4 / 0.0015, 0.0015 / 0.02], rtol=0.01)
    assert share(posed(10.0), x, x + EQUAL) == pytest.approx(0.5)
    assert (share(posed(10.0), x, x) == 0).all()


def test_share_follows_the_noise_in_a_pixel():
    x = np.zeros(SHAPE, np.float32)
    levels = [0, 1e-30, 0.02, 0.1, 0.2, 1e6]
    shares = np.array([share(posed(level), x, x + EQUAL) for level in levels])
    assert (shares[0] == 0).all()
    assert (np.diff(shares, axis=0) > 0).all()
    assert shares[3] == pytest.approx(0.25)
    assert shares[-1] == pytest.approx(0.5)
    assert share(posed(0.2, gram=4.0), x, x + EQUAL) == pytest.approx(0.25)  # masks twice as strong
    assert (share(posed(1.0, gram=0.0), x, x + EQUAL) == 0).all()


def test_noise_of_each_pixel():
    """Then its root mean square decides."""
    x, noise = np.zeros(SHAPE, np.float32), np.zeros(SHAPE[2:])
    noise[::2] = 0.1 * np.sqrt(2)
    assert share(posed(noise), x, x + EQUAL) == pytest.approx(0.25)


def test_what_is_not_finite_stays_as_it_is():
    x = np.zeros(SHAPE, np.float32)
    x[1, 2, 3, 4] = np.inf
    mean, shares = blended(posed(1.0), x, np.zeros(SHAPE, np.float32))
    assert mean is x
    assert shares == [0.0, 0.0]


@pytest.fixture(scope="module")
def embedded():
    return pnp_sci.datasets.embedded_scene(64)


@pytest.fixture
def smooth(monkeypatch):
    """A decoder, known as "smooth": every frame is y over the sum of the masks."""

    def decoder(problem, scene):
        op = problem.op
        return np.broadcast_to(problem.y / op.masks.sum((0, 1)).clip(1), op.shape).astype(op.dtype)

    monkeypatch.setitem(registry._registered["decoders"], "smooth", lambda: decoder)
    return decoder


@pytest.mark.parametrize("prior", ["tv", Flow(first=0)])  # flow has a finish of its own
def test_a_decoder_has_its_share_of_the_result(embedded, smooth, prior):
    """What is returned lies between the solver's estimate and the decoder's; so say history and settings."""
    y = np.stack([pnp_sci.simulate(embedded.truth, embedded.masks, noise, seed=3) for noise in (0.1, 0.03)])
    known = {"prior": prior, "scene": "full", "iterations": 9, "reference": np.stack([embedded.truth] * 2)}
    known["noise"] = 0.06 * float(y.max())  # an estimated one would be lowered from a decoder on only
    named, given = (pnp_sci.solve(y, embedded.masks, init=init, **known) for init in ("smooth", smooth))
    decoded = pnp_sci.decode(y, embedded.masks, model="smooth").x
    shares = np.array(named.settings["share"])
    assert shares.shape == (2, 2)
    assert (shares > 0.01).all()
    assert (shares <= 0.5).all()
    assert np.all(np.array(given.settings["share"]) == 0)
    expected = given.x + shares[..., None, None, None] * (decoded - given.x)
    assert np.allclose(named.x, expected, atol=2e-5)
    last = [record for record in named.history if record.iteration == 9]
    assert len(last) == 2
    for n, record in enumerate(last):
        assert record.psnr == pytest.approx(pnp_sci.psnr(named.x[n], embedded.truth).mean(), abs=1e-3)
        missing = y[n] - SensingOperator(embedded.masks).forward(named.x[n].astype(np.float64))
        assert record.residual == pytest.approx(np.linalg.norm(missing) / np.linalg.norm(y[n]), rel=1e-3)


def test_without_noise_the_solver_knows_better(embedded, smooth):
    named, given = (
        pnp_sci.solve(embedded.y, embedded.masks, init=init, iterations=10, noise=0.0) for init in ("smooth", smooth)
    )
    assert named.settings["share"] == [[0.0, 0.0]]
    assert np.array_equal(named.x, given.x)


def test_of_a_reduced_scene_each_view_that_is_modelled_has_one(embedded, smooth):
    """One of three is dark, one stands still: the decoder's estimate is reduced in the same way."""
    truth = np.stack([embedded.truth[0], np.repeat(embedded.truth[1][:1], 10, 0), 0 * embedded.truth[0]])
    masks = pnp_sci.random_masks(truth.shape, seed=2)
    y = pnp_sci.simulate(truth, masks, 0.05, seed=3)
    model = pnp_sci.SceneModel(views=(True, True, False), still=(False, True, False))
    known = {"scene": model, "iterations": 20}
    named, given = (pnp_sci.solve(y, masks, init=init, **known) for init in ("smooth", smooth))
    shares = np.array(named.settings["share"][0])
    assert shares.shape == (2,)
    assert (shares > 0.003).all()
    decoded = pnp_sci.decode(y, masks, model="smooth").x[:2]
    decoded[1] = decoded[1].mean(0)
    expected = given.x[:2] + shares[:, None, None, None] * (decoded - given.x[:2])
    assert np.allclose(named.x[:2], expected, atol=1e-4)
    assert not named.x[2].any()
