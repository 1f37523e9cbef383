"""OFaNet as a decoder: what decode and solve make of it."""

from dataclasses import dataclass

import numpy as np
import pytest
from untrained import make

import pnp_sci
from pnp_sci.bench import compare, grid
from pnp_sci.errors import FormatError, InputError
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import FunctionSession
from pnp_sci.plugins.protocols import Prior, Traits
from pnp_sci.plugins.resolve import as_decoder

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
decoder = pytest.importorskip("ofanet_init.decoder")
prepared = pytest.importorskip("ofanet_init.prepared")
network = pytest.importorskip("ofanet_init.network")
weights = pytest.importorskip("ofanet_init.files")


@pytest.fixture
def trained(tmp_path, monkeypatch):
    """A folder of weights for 2 views of 4 frames, in place of the package's."""
    weights.save(tmp_path / "v2b4.safetensors", make())
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    prepared._loaded.cache_clear()
    yield tmp_path
    prepared._loaded.cache_clear()


@pytest.fixture(scope="module")
def small():
    return pnp_sci.datasets.embedded_scene(48)


@pytest.fixture
def case(small):
    masks = small.masks[:, :4]
    return pnp_sci.simulate(small.truth[:, :4], masks), masks


@pytest.mark.parametrize(("noise", "passes"), [(0, 2), (0.1, 1)])
def test_a_noisy_measurement_is_refined_once(trained, monkeypatch, small, noise, passes):
    weights.save(trained / "v2b10.safetensors", make(frames=10, passes=2))
    seen, refined = [], network.OFaNet._refined
    monkeypatch.setattr(network.OFaNet, "_refined", lambda *given: seen.append(1) or refined(*given))
    pnp_sci.decode(pnp_sci.simulate(small.truth, small.masks, noise), small.masks, model="ofanet")
    assert len(seen) == passes


@pytest.mark.parametrize("kind", [np.uint8, np.float64])
def test_decode_takes_masks_of_any_type_and_scale(trained, case, kind):
    y, masks = case
    x = pnp_sci.decode(y, masks, model="ofanet-fast").x
    other = pnp_sci.decode(100 * y, masks.astype(kind) * kind(100), model="ofanet-fast").x
    assert np.allclose(other, x, atol=2e-2 * np.abs(x).max())


@pytest.mark.parametrize("model", ["ofanet", "ofanet-fast"])
@pytest.mark.parametrize("shape", [(2, 3), (2, 2), (1, 8), (1, 7), (1, 4)])
def test_fewer_frames_take_the_weights_for_more(trained, small, shape, model):
    count = shape[0] * shape[1]
    masks, truth = (a.reshape(-1, 48, 48)[:count].reshape(*shape, 48, 48) for a in (small.masks, small.truth))
    y = pnp_sci.simulate(truth, masks)
    x = pnp_sci.decode(y, masks, model=model).x
    assert x.shape == truth.shape
    assert np.abs((masks * x).sum((0, 1)) - y).mean() < 0.05 * y.mean(), "it measures y"
    assert pnp_sci.solve(y, masks, init=model, iterations=1).settings["init"] == model


def test_own_weights_come_first(trained, case):
    before = pnp_sci.decode(*case, model="ofanet-fast").x
    y, masks = case
    fewer = pnp_sci.simulate(before[:, :3].clip(0), masks[:, :3]), masks[:, :3]
    by_more = pnp_sci.decode(*fewer, model="ofanet-fast").x
    weights.save(trained / "v2b3.safetensors", make(frames=3))
    prepared._loaded.cache_clear()
    assert not np.array_equal(pnp_sci.decode(*fewer, model="ofanet-fast").x, by_more)
    assert np.array_equal(pnp_sci.decode(y, masks, model="ofanet-fast").x, before)


@pytest.mark.parametrize(("views", "frames"), [(1, 6), (1, 14), (1, 20), (2, 8), (2, 12)])
def test_shipped_weights_serve_fewer_frames(views, frames):
    """They are better than total variation on a scene that they have never seen."""
    scene = pnp_sci.datasets.embedded_scene(96)
    truth = np.concatenate([scene.truth, scene.truth[:, ::-1]], 1)[:views, :frames]
    masks = pnp_sci.moving_masks(truth.shape)
    y = pnp_sci.simulate(truth, masks)
    decoded, tv = pnp_sci.decode(y, masks, model="ofanet-fast"), pnp_sci.solve(y, masks, "tv", effort="fast")
    assert np.mean(pnp_sci.psnr(decoded.x, truth)) > np.mean(pnp_sci.psnr(tv.x, truth))


@pytest.mark.parametrize("shape", [(2, 10), (1, 9), (1, 3), (2, 1), (3, 2)])
def test_missing_weights_are_named(trained, small, shape):
    """So are those for more than twice as many frames: a network with mostly empty places shows little of the scene."""
    masks = np.resize(small.masks, (*shape, 48, 48))
    with pytest.raises(InputError, match=rf"{shape[0]} x {shape[1]} frames.*2 x 4"):
        pnp_sci.decode(small.y, masks, model="ofanet")


def test_negative_masks_are_refused(trained, case):
    y, masks = case
    with pytest.raises(InputError, match="negative"):
        pnp_sci.decode(y, masks - 0.5, model="ofanet")


def test_unusable_device_is_named(trained, case):
    with pytest.raises(InputError, match="device"):
        pnp_sci.decode(*case, model="ofanet", device="nonsense")


def test_nothing_is_refined_where_nothing_moves(trained, small, case, monkeypatch):
    y, masks = case
    still = np.repeat(small.truth[:, :1], 4, axis=1)
    monkeypatch.setattr(network.OFaNet, "_refined", lambda *_: pytest.fail("the refine net was called"))
    x = pnp_sci.decode(pnp_sci.simulate(still, masks), masks, model="ofanet").x
    assert np.ptp(x, axis=1).max() < 1e-6
    with pytest.raises(pytest.fail.Exception):
        pnp_sci.decode(y, masks, model="ofanet")


def test_a_missing_refine_net_is_said(case, tmp_path, monkeypatch, caplog):
    weights.save(tmp_path / "v2b4.safetensors", make(refine="none"))
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    prepared._loaded.cache_clear()
    whole, fast = (pnp_sci.decode(*case, model=model).x for model in ("ofanet", "ofanet-fast"))
    prepared._loaded.cache_clear()
    assert np.array_equal(whole, fast)
    assert "no refine net for 2 x 4" in caplog.text


def test_shipped_weights_start_well():
    """Ten iterations from the trained separator are better than ten from nothing, on a scene it has never seen."""
    scene = pnp_sci.datasets.embedded_scene(96)
    warm, cold = (
        pnp_sci.solve(scene.y, scene.masks, init=init, iterations=10, reference=scene.truth).history[-1].psnr
        for init in ("ofanet-fast", "adjoint")
    )
    assert warm > cold + 1


@pytest.mark.parametrize("init", ["ofanet", "ofanet-fast"])
def test_warm_start(trained, case, init):
    y, masks = case
    start = pnp_sci.decode(y, masks, model=init)
    result = pnp_sci.solve(y, masks, "flow", init=init, iterations=5)
    assert result.settings["init"] == init
    assert result.settings["unit"] == start.settings["unit"]
    assert result.history[0].residual == pytest.approx(start.history[0].residual, rel=1e-3)
    assert result.status.ok


@dataclass(frozen=True)
class Strong(Prior):
    """Says that it is strong, and assumes nothing."""

    def traits(self, shape):
        return Traits(strong=True)

    def begin(self, shape, dtype):
        return FunctionSession(lambda x, sigma: x.copy())


strong = Strong()


@pytest.mark.parametrize(
    ("frames", "prior", "lowest", "init"),
    [(4, strong, 0, "ofanet-fast"), (4, "tv", 0, "adjoint"), (5, strong, 0, "adjoint"), (4, strong, -1, "adjoint")],
    ids=["strong prior", "another", "no weights", "masks that the network cannot take"],
)
def test_first_estimate_that_is_chosen(trained, frames, prior, lowest, init, monkeypatch):
    monkeypatch.setattr("pnp_sci.pipeline.start.CANCELS", np.inf)  # the network has random weights
    rng = np.random.default_rng(0)
    masks = rng.uniform(lowest, 1, (2, frames, 32, 32)).astype(np.float32)
    y = np.stack([pnp_sci.simulate(rng.random(masks.shape, np.float32), masks) for _ in range(2)])
    result = pnp_sci.solve(y, masks, prior, scene="full", iterations=3)
    assert result.settings["init"] == init
    assert np.array_equal(result.x, pnp_sci.solve(y, masks, prior, init, scene="full", iterations=3).x)
    other = {"adjoint": "ofanet-fast", "ofanet-fast": "adjoint"}[init]
    if lowest == 0 and frames == 4:
        assert not np.allclose(result.x, pnp_sci.solve(y, masks, prior, other, scene="full", iterations=3).x)


def test_damaged_weights_are_an_error_and_not_a_plain_start(case, tmp_path, monkeypatch):
    (tmp_path / "v2b4.safetensors").write_text("no weights")
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    prepared._loaded.cache_clear()
    with pytest.raises(FormatError, match="not a safetensors file"):
        pnp_sci.solve(*case, strong, iterations=1)


@pytest.mark.parametrize("rows", [70, 256, 301])
def test_pictures_are_decoded_by_parts_without_a_seam(trained, monkeypatch, rows):
    rng = np.random.default_rng(0)
    masks = (rng.random((2, 4, rows, 32)) < 0.5).astype(np.float32)
    y = pnp_sci.simulate(rng.random(masks.shape, np.float32), masks)
    whole = pnp_sci.decode(y, masks, model="ofanet-fast").x
    monkeypatch.setattr(decoder, "ROWS", 64)
    assert np.abs(pnp_sci.decode(y, masks, model="ofanet-fast").x - whole).max() < 0.02 * np.ptp(whole)


def test_a_strong_prior_is_scored_from_the_start_that_it_gets(trained, case, monkeypatch):
    started = []

    def decode(problem, scene):
        started.append("network")
        return np.zeros(problem.op.shape, problem.op.dtype)

    monkeypatch.setitem(registry._registered["priors"], "strong", Strong)
    monkeypatch.setitem(registry._registered["decoders"], "ofanet-fast", lambda: decode)
    scored = compare(*case, grid(["strong", "tv"], iterations=2))
    assert len(started) == 2, "once for the score and once for the result, and never for tv"
    assert [trial.result.settings["init"] for trial in scored.trials] == ["ofanet-fast", "adjoint"]


def test_without_networks_the_first_estimate_is_a_plain_one(trained, case, monkeypatch):
    monkeypatch.setattr("pnp_sci.pipeline.start.DECODER", "not installed")
    assert pnp_sci.solve(*case, strong, iterations=2).settings["init"] == "adjoint"


@pytest.mark.parametrize("name", ["ofanet", "ofanet-fast"])
def test_a_decoder_is_the_same_for_decode_and_for_solve(trained, case, name):
    """By name or as an object, with the problem and the scene model that `solve` with a strong prior makes."""
    y, masks = case
    video, by_object = (pnp_sci.decode(y, masks, model=model, noise=0).x for model in (name, as_decoder(name)))
    np.testing.assert_array_equal(by_object, video)
    seen = []
    given = {"prior": strong, "init": as_decoder(name), "noise": 0}
    unit = pnp_sci.solve(y, masks, **given, iterations=1).settings["unit"][0]
    pnp_sci.solve(y, masks, **given, callback=lambda state: seen.append(state.x) or True)
    np.testing.assert_allclose(unit * seen[0], video, atol=0.02 * np.ptp(video))


def test_the_separator_alone_asks_for_no_scene_model():
    assert not as_decoder("ofanet-fast").needs_scene
    assert as_decoder("ofanet").needs_scene
