"""Displacement of frames by the pull of the data."""

import itertools

import numpy as np
import pytest
from made_priors import Made
from scipy.ndimage import gaussian_filter, uniform_filter

import pnp_sci
from pnp_sci import SensingOperator, datasets
from pnp_sci.plugins.combine import Joint
from pnp_sci.plugins.mosaic import Mosaicked
from pnp_sci.plugins.protocols import Traits
from pnp_sci.solvers import iterate
from pnp_sci.solvers.backend import NUMBA
from pnp_sci.solvers.displacement import FARTHEST, REACH, TUNED, WINDOW, displace
from pnp_sci.solvers.gap import gap_step
from pnp_sci.solvers.schedule import schedule_for
from priors.flow import Flow

GAIN = 0.05  # dB on the embedded scene, at least


def texture(shape=(2, 3, 64, 80), dtype=np.float64):
    """Smooth random frames of standard deviation 0.2."""
    x = gaussian_filter(np.random.default_rng(0).standard_normal(shape), (0, 0, 2, 2))
    return (0.5 + 0.2 * x / x.std()).astype(dtype)


def white(shape, seed=1):
    return np.random.default_rng(seed).standard_normal(shape)


def slopes(x):
    padded = np.pad(x, ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge")
    return (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2, (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2


def moved(x, v, noise):
    """What is added to v."""
    after = v.copy()
    displace(x, after, noise)
    return after - v


def reference(x, v, noise):
    """The same by a linear system for each block, with the filters of scipy; height and width are even."""
    down, across = slopes(x)

    def mean(a):
        blocks = a.reshape(*a.shape[:2], a.shape[2] // 2, 2, a.shape[3] // 2, 2).mean((3, 5))
        for _ in range(2):
            blocks = uniform_filter(blocks, (1, 1, 2 * REACH + 1, 2 * REACH + 1), mode="nearest")
        return blocks

    gradient = np.stack([down, across], -1)
    outer = np.stack([np.stack([mean(a * b) for b in (down, across)], -1) for a in (down, across)], -2)
    outer += noise**2 / (WINDOW * TUNED.expected**2) * np.eye(2)
    pull = np.stack([mean(a * (v - x)) for a in (down, across)], -1)
    d = np.linalg.solve(outer, pull[..., None])[..., 0]
    d /= np.maximum(np.linalg.norm(d, axis=-1, keepdims=True) / FARTHEST, 1)
    return np.clip((gradient * d.repeat(2, 2).repeat(2, 3)).sum(-1), -noise, noise)


def test_it_solves_the_equations_of_lucas_and_kanade():
    x = texture()
    v = x + 0.1 * white(x.shape) + 0.3 * slopes(x)[0]
    np.testing.assert_allclose(moved(x, v, 0.05), reference(x, v, 0.05), atol=1e-12)


def test_a_displacement_is_found_in_noise():
    x = texture()
    pull = 0.3 * slopes(x)[0] - 0.2 * slopes(x)[1]
    found = moved(x, x + pull + 0.05 * white(x.shape), 0.05)
    assert pull.std() < 0.05, "the noise is stronger than what is looked for"
    assert np.corrcoef(found.ravel(), pull.ravel())[0, 1] > 0.95
    assert 0.7 < np.vdot(found, pull) / np.vdot(pull, pull) < 1


def test_noise_alone_displaces_little():
    x = texture()
    assert moved(x, x + 0.05 * white(x.shape), 0.05).std() < 0.1 * 0.05


def test_more_noise_is_believed_less():
    x = texture()
    pull = 0.3 * slopes(x)[0]
    found = [np.vdot(moved(x, x + pull, noise), pull) / np.vdot(pull, pull) for noise in (0.05, 0.2, 1.0)]
    assert found[0] > 0.7
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.1


def test_a_displacement_has_a_bound():
    x = texture()
    added = moved(x, x + 100 * slopes(x)[1], 0.01)
    assert np.all(np.abs(added) <= FARTHEST * np.hypot(*slopes(x)) * (1 + 1e-9))


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_no_more_than_the_noise_is_added(noise):
    x = texture()
    added = moved(x, x + 0.5 * slopes(x)[0], noise)
    assert np.abs(added).max() == pytest.approx(noise)


@pytest.mark.parametrize("prior", ["flow", "video"])
def test_masks_of_low_contrast_are_solved(prior):
    """Without the bound, pulls along the edges of the estimate were doubled, and it diverged."""
    truth = np.ascontiguousarray(pnp_sci.datasets.embedded_scene(96).truth[:, :3])
    masks = np.random.default_rng(0).uniform(0.4, 1, truth.shape).astype(np.float32)
    masks[1] *= 0.5
    y = pnp_sci.simulate(truth, masks)
    result, smooth = (pnp_sci.solve(y, masks, p, init="adjoint", scene="full") for p in (prior, "tv"))
    assert result.status.ok
    assert np.mean(pnp_sci.psnr(result.x, truth)) > np.mean(pnp_sci.psnr(smooth.x, truth)) + 2


def test_frames_do_not_influence_each_other():
    x = texture()
    v = x + 0.1 * white(x.shape)
    together = moved(x, v, 0.05)
    alone = moved(x[1:, 2:], v[1:, 2:], 0.05)
    np.testing.assert_allclose(together[1:, 2:], alone, atol=1e-14)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (1, 2, 1, 9), (2, 2, 7, 5)])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_flat_frames_of_any_size_stay_as_they_are(shape, noise):
    x = np.full(shape, 0.3, np.float32)
    v = x + white(shape).astype(np.float32)
    assert np.array_equal(moved(x, v, noise), np.zeros(shape))


@pytest.mark.parametrize("shape", [(2, 3, 64, 80), (1, 2, 33, 47), (1, 1, 2, 3)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tensors_are_displaced_as_arrays_are(shape, dtype):
    torch = pytest.importorskip("torch")
    x = texture(shape, dtype)
    v = (x + 0.1 * white(shape)).astype(dtype)
    tensor = torch.tensor(v)
    displace(torch.tensor(x), tensor, 0.05)
    np.testing.assert_allclose(tensor.numpy() - v, moved(x, v, 0.05), atol=1e-6 if dtype == np.float32 else 1e-14)


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def blurred(got):
    """A function that keeps what it is called with."""

    def call(v, sigma):
        got.append(v.copy())
        return gaussian_filter(v, (0, 0, 1, 1))

    return call


def seen(scene, sigma=0.05, noise=0.0, join=False, **options):
    """What a prior gets in three calls; its traits are options."""
    got = []
    prior = Made(blurred(got), known=Traits(**options))
    op = SensingOperator(scene.masks)
    start = scene.truth.astype(np.float32)
    prior = Joint([prior, Made()]) if join else prior
    states = pnp_sci.iterate(op, scene.y, prior, start, sigma=sigma, noise=noise)
    return got, [state.x.copy() for state in itertools.islice(states, 4)]


@pytest.mark.parametrize("noise", [0.0, 0.3, "of each pixel"])
@pytest.mark.parametrize("join", [False, True])
def test_a_prior_that_follows_motion_gets_displaced_frames(scene, monkeypatch, noise, join):
    made, own = [], iterate.displace

    def kept(x, v, noise):
        made.append((x.copy(), v.copy(), noise))
        own(x, v, noise)

    monkeypatch.setattr(iterate, "displace", kept)
    of_y = np.linspace(0.1, 0.5, scene.y.size).reshape(scene.y.shape) if noise == "of each pixel" else noise
    got, estimates = seen(scene, noise=of_y, motion=True, join=join)
    op = SensingOperator(scene.masks)
    _, rho = schedule_for(op, of_y, 0.05).at(0)
    assert [given for _, _, given in made] == pytest.approx(3 * [0.05 + np.mean(rho) / op.gram.mean()], rel=1e-5)
    for (x, v, given), estimate, frames in zip(made, estimates, got):
        assert np.array_equal(x, estimate)
        displace(x, v, given)
        assert np.array_equal(frames, v)


def test_other_priors_get_none(scene, monkeypatch):
    monkeypatch.setattr(iterate, "displace", lambda *_: pytest.fail("displaced"))
    assert len(seen(scene)[0]) == 3


@pytest.mark.parametrize("sigma", [0.0, 5e-5])
def test_nothing_is_displaced_where_nothing_is_denoised(scene, sigma):
    (plain, _), (followed, _) = seen(scene, sigma), seen(scene, sigma, motion=True)
    assert all(map(np.array_equal, plain, followed))


@pytest.mark.parametrize("sigma", [1e-3, 1.0, 1e19, 1e30, 1e200])
def test_any_sigma_leaves_finite_frames(scene, sigma):
    got, _ = seen(scene, sigma, noise=1e-3, motion=True)
    assert all(np.isfinite(frames).all() for frames in got)


def test_mosaics_have_seams_and_are_not_displaced():
    shape = (1, 4, 64, 64)
    assert Flow().traits(shape).motion
    assert not Mosaicked(Flow(), pnp_sci.Mosaic("RGGB")).traits(shape).motion


def test_tensors_in_the_loop(scene):
    pytest.importorskip("torch")
    from pnp_sci.solvers.torch_backend import TorchBackend

    ends = []
    for backend in (NUMBA, TorchBackend.on("cpu")):
        with backend.running():
            op, prior = SensingOperator(scene.masks), Made(lambda v, sigma: 0.9 * v, known=Traits(motion=True))
            session = iterate.InTurn(iterate.turns(prior, op.shape), op.shape, op.dtype)
            schedule = schedule_for(op, 0.3)
            arrays = map(backend.put, (scene.y.astype(np.float32), scene.truth.astype(np.float32)))
            y, x = arrays
            states = iterate.states(backend.operator(op), y, session, x, gap_step, schedule)
            ends.append(backend.get(next(itertools.islice(states, 4, None)).x))
    np.testing.assert_allclose(*ends, atol=1e-5)


def test_a_warm_up_gets_none(scene, monkeypatch):
    calls = []
    monkeypatch.setattr(iterate, "displace", lambda *_: calls.append(1))
    seen(scene, motion=True, warmup=(Made(), 2))
    assert len(calls) == 1


@pytest.mark.parametrize("algorithm", ["gap", "admm"])
def test_flow_gains(scene, monkeypatch, algorithm):
    def solved():
        x = pnp_sci.solve(scene.y, scene.masks, "flow", init="adjoint", algorithm=algorithm, scene="full").x
        return np.mean(pnp_sci.psnr(x, scene.truth))

    with_it = solved()
    monkeypatch.setattr(iterate, "displace", lambda *_: None)
    assert with_it > solved() + GAIN


def test_the_option_of_flow():
    assert not Flow(displace=False).traits((1, 4, 64, 64)).motion
