"""U-net, ADMM-net and BIRNAT: networks, decoders and their training; and what all decoders promise, OFaNet too."""

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from untrained import make as make_ofanet
from untrained import measured

import pnp_sci
from pnp_sci.errors import InputError
from pnp_sci.training.clips import Clip

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
admm_net = pytest.importorskip("ofanet_init.baselines.admm_net")
birnat = pytest.importorskip("ofanet_init.baselines.birnat")
config = pytest.importorskip("ofanet_init.baselines.config")
decoders = pytest.importorskip("ofanet_init.baseline_decoders")
fusion = pytest.importorskip("pnp_sci.accel.fusion")
half_precision = pytest.importorskip("pnp_sci.accel.inference").half_precision
prepared = pytest.importorskip("ofanet_init.prepared")
weights = pytest.importorskip("ofanet_init.files")

MODELS = ("unet", "admm-net", "birnat")
DECODERS = (*MODELS, "ofanet", "ofanet-fast")


def make(model, views=2, frames=4):
    """An untrained network whose layers all do something."""
    torch.manual_seed(0)
    network = weights.MODELS[model][0](config.BaselineConfig(views, frames))
    for parameter in network.parameters():
        if not parameter.detach().any():
            torch.nn.init.normal_(parameter, std=0.02)
    return network.eval()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Weights for 2 views of 4 frames, in place of the package's."""
    for model in MODELS:
        weights.save(tmp_path / f"{model}-v2b4.safetensors", make(model))
    weights.save(tmp_path / "v2b4.safetensors", make_ofanet())
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    prepared._loaded.cache_clear()
    yield tmp_path
    prepared._loaded.cache_clear()


def case(rows=20, columns=26, seed=0):
    y, masks = (part[0].numpy() for part in measured(rows=rows, columns=columns, seed=seed))
    return y, masks


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=6, deadline=None)
@given(views=st.integers(1, 3), frames=st.integers(1, 4), rows=st.integers(1, 2), columns=st.integers(1, 2))
def test_any_number_of_views_and_frames(model, views, frames, rows, columns):
    """Every estimate has the shape of the masks, and finite values."""
    y, masks = measured(views, frames, 16 * rows, 16 * columns)
    with torch.inference_mode():
        for video in make(model, views, frames)(y, masks):
            assert video.shape == masks.shape
            assert video.isfinite().all()


@pytest.mark.parametrize("model", MODELS)
def test_every_weight_learns(model):
    network = make(model)
    torch.stack(network(*measured(rows=32, columns=32))).square().sum().backward()
    still = [name for name, weight in network.named_parameters() if weight.grad is None or not weight.grad.any()]
    assert not still


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (33, 50)])
def test_pictures_of_any_size_are_decoded(folder, model, size):
    """As the upper left part of a picture that continues them: the last row and column are repeated."""
    y, masks = case(*size)
    margins = [(0, 48 - n % 48) for n in size]
    larger = np.pad(y, margins, "edge"), np.pad(masks, ((0, 0), (0, 0), *margins), "edge")
    network = prepared.trained(model, 2, 4, torch.device("cpu"))
    rounded = [(0, -n % network.multiple) for n in size]
    same = np.pad(y, rounded, "edge"), np.pad(masks, ((0, 0), (0, 0), *rounded), "edge")
    found = pnp_sci.decode(y, masks, model=model, noise=0).x
    assert np.isfinite(pnp_sci.decode(*larger, model=model, noise=0).x).all()
    whole = pnp_sci.decode(*same, model=model, noise=0).x
    assert np.allclose(found, whole[..., : size[0], : size[1]], atol=0.02 * np.abs(whole).max())


@pytest.mark.parametrize("model", MODELS)
def test_the_order_of_the_views_does_not_matter(folder, model):
    y, masks = case()
    one, other = (pnp_sci.decode(y, masks[::way], model=model).x[::way] for way in (1, -1))
    assert np.allclose(one, other, atol=1e-2 * np.abs(one).max())


@pytest.mark.parametrize("model", DECODERS)
@pytest.mark.parametrize("factor", [1e-6, 3.0, 1e6])
def test_decode_scales_with_the_measurement(folder, model, factor):
    y, masks = case()
    x, scaled = (pnp_sci.decode(a * y, masks, model=model).x for a in (1.0, factor))
    assert x.shape == masks.shape
    assert np.allclose(scaled, factor * x, atol=2e-2 * factor * np.abs(x).max())


@pytest.mark.parametrize("model", MODELS)
def test_the_decoded_video_measures_y(folder, model):
    y, masks = case()
    x = pnp_sci.decode(y, masks, model=model, noise=0).x
    assert np.abs((masks * x).sum((0, 1)) - y).max() < 1e-3 * y.max()


@pytest.mark.parametrize("model", DECODERS)
def test_fused_or_not_it_decodes_the_same(folder, model, monkeypatch):
    outs, could, cpu = [], fusion._can_fuse, torch.device("cpu")
    for possible in (True, False):
        monkeypatch.setattr(fusion, "_can_fuse", lambda dtype, possible=possible: possible and could(dtype))
        prepared._loaded.cache_clear()
        outs.append(pnp_sci.decode(*case(), model=model).x)
        modules = prepared.trained(model.removesuffix("-fast"), 2, 4, cpu).modules()
        fused = any(isinstance(module, fusion.Fused) for module in modules)
        assert fused == (possible and could(torch.bfloat16 if half_precision(cpu) else torch.float32))
    assert np.abs(outs[0] - outs[1]).mean() < 0.02 * np.abs(outs[0]).mean()


@pytest.mark.parametrize("model", MODELS)
def test_solvers_start_from_it(folder, model):
    assert pnp_sci.solve(*case(), prior="tv", init=model, iterations=2).settings["init"] == model


@pytest.mark.parametrize("model", MODELS)
def test_what_cannot_be_decoded(folder, model):
    y, masks = case()
    with pytest.raises(InputError, match=r"masks has 2 x 1 frames: .* has weights for 2 x 4 .*--model " + model):
        pnp_sci.decode(y, masks[:, :1], model=model)
    with pytest.raises(InputError, match="masks has negative values"):
        pnp_sci.decode(y, -masks, model=model)


@pytest.mark.parametrize("fields", [{"views": 0}, {"frames": 257}, {"views": 1.5}])
def test_configurations_that_cannot_be(fields):
    with pytest.raises(InputError, match=f"{next(iter(fields))} is .*a whole number from 1 to 256"):
        config.BaselineConfig(**fields)


def test_admm_net_is_admm(monkeypatch):
    """With known priors, its estimates are those of the formulas."""
    y, masks = measured(rows=20, columns=24)
    network = admm_net.ADMMNet(config.BaselineConfig(2, 4))
    torch.nn.init.normal_(network.gamma)
    for n, prior in enumerate(network.priors):
        monkeypatch.setattr(prior, "forward", lambda x, n=n: 0.5 * x + 0.1 * n)
    with torch.inference_mode():
        estimates = network(y, masks)
    phi, gammas = masks[0].numpy(), np.log1p(np.exp(network.gamma.detach().numpy()))
    theta, b = np.broadcast_to(y.numpy() / np.maximum(phi.sum((0, 1)), 0.5), phi.shape), 0.0
    found = []
    for n, gamma in enumerate(gammas):
        v = theta + b
        x = v + phi * (y.numpy() - (phi * v).sum((0, 1))) / ((phi**2).sum((0, 1)) + gamma)
        theta = 0.5 * (x - b) + 0.1 * n
        b = b - (x - theta)
        found.append(theta)
    assert len(estimates) == admm_net.OUTPUTS
    for estimate, expected in zip(estimates, found[-admm_net.OUTPUTS :]):
        assert np.allclose(estimate[0], expected, atol=1e-4)


@pytest.mark.parametrize("follow", [True, False])
def test_birnat_sees_what_the_measurement_leaves_for_a_frame(monkeypatch, follow):
    """That is y without the frames that it has, and without what stands for the frames to come."""
    y, masks = measured(rows=8, columns=8)
    random = torch.Generator().manual_seed(1)
    guess, last = (torch.rand((*masks.shape[:n], 8, 8), generator=random) for n in (3, 2))
    network = birnat.Recurrence(2)
    seen, before, states = [], [], []
    monkeypatch.setattr(network.see, "forward", lambda x: seen.append(x) or torch.zeros(1, birnat.SEEN, 4, 4))
    monkeypatch.setattr(network.before, "forward", lambda x: before.append(x) or torch.zeros(1, birnat.BEFORE, 4, 4))
    monkeypatch.setattr(network.blocks, "forward", lambda x: states.append(x) or x)
    monkeypatch.setattr(network.keep, "forward", lambda x: torch.full((1, birnat.HIDDEN, 4, 4), float(len(states))))
    monkeypatch.setattr(network.up, "forward", lambda x: torch.full((1, 2, 8, 8), 0.1 * len(states)))
    order = range(1, 4) if follow else range(2, -1, -1)
    video, hidden = network(y, masks, guess, last, torch.zeros(1, birnat.HIDDEN, 4, 4), order, follow)
    known = {order.start - order.step: last}
    for n, t in enumerate(order):
        own = masks[:, :, t]
        rest = sum(
            (masks[:, :, k] * known.get(k, guess[:, :, k])).sum(1) for k in range(4) if k != t
        )  # frames that it has, and what stands for the others
        assert torch.allclose(seen[n][:, 1], y - rest, atol=1e-5)
        assert torch.equal(seen[n][:, 2:4], own)
        assert torch.allclose(seen[n][:, 4:6], own * (y - rest)[:, None], atol=1e-5)
        assert torch.allclose(before[n], torch.cat([known[t - order.step], guess[:, :, t]], 1))
        assert (states[n][:, : birnat.HIDDEN] == n).all()
        known[t] = (known[t - order.step] if follow else guess[:, :, t]) + 0.1 * (n + 1)
    assert torch.allclose(video, torch.stack([known[t] for t in range(4)], 2))
    assert (hidden == 3).all()


def test_the_attention_of_birnat_is_that_of_the_formula():
    torch.manual_seed(0)
    attention = birnat.Attention(16)
    torch.nn.init.constant_(attention.scale, 0.5)
    x = torch.randn(2, 16, 10, 18)
    cells = torch.nn.functional.avg_pool2d(x, birnat.POOL, ceil_mode=True)
    given = attention.query(x), attention.key(cells), attention.value(cells)
    query, key, value = (part.flatten(2) for part in given)
    found = value @ (query.transpose(1, 2) @ key).softmax(2).transpose(1, 2)
    expected = x + 0.5 * attention.out(found.unflatten(2, x.shape[2:]))
    assert torch.allclose(attention(x), expected, atol=1e-5)


@pytest.mark.parametrize("model", MODELS)
def test_training_writes_weights_that_decode(model, tmp_path, monkeypatch):
    """Two steps; the file, put among the others, is found by its name."""
    cli = pytest.importorskip("ofanet_init.train.__main__")
    tasks = pytest.importorskip("ofanet_init.train.tasks")
    monkeypatch.setattr(tasks, "SIZE", 32)
    random = np.random.default_rng(0)
    films = [Clip(f"{name}_1", random.integers(0, 256, (6, 40, 40), np.uint8)) for name in ("ball", "car", "dog")]
    monkeypatch.setattr(cli, "load_clips", lambda folders: films)
    fixed = f"--model {model} --data {tmp_path} --out {tmp_path / 'run'} --steps 2 --frames 2 --crop 32 --batch 1"
    result = CliRunner().invoke(cli.main, [*fixed.split(), "--device", "cpu", "--validations", "1"])
    assert result.exit_code == 0, result.output
    network, digest = weights.load(tmp_path / "run" / f"{model}.safetensors", model)
    card = (tmp_path / "run" / f"{model}.md").read_text()
    assert digest in card
    assert f"--model {model} --data" in card
    (tmp_path / f"{model}-v2b2.safetensors").write_bytes((tmp_path / "run" / f"{model}.safetensors").read_bytes())
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    prepared._loaded.cache_clear()
    y, masks = (part[0].numpy() for part in measured(frames=2))
    assert np.isfinite(pnp_sci.decode(y, masks, model=model).x).all()
    prepared._loaded.cache_clear()
    assert network.config == config.BaselineConfig(2, 2)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--model unet --stage dns", "model is unet, but these options are for ofanet only: stage"),
        ("--model birnat --window 4", "these options are for ofanet only: window"),
        ("--model ofanet", "model is ofanet: --stage was expected"),
    ],
)
def test_options_of_ofanet_are_for_ofanet(words, named, tmp_path):
    cli = pytest.importorskip("ofanet_init.train.__main__")
    result = CliRunner().invoke(cli.main, [*words.split(), "--data", str(tmp_path)])
    assert isinstance(result.exception, InputError)
    assert named in str(result.exception)


def test_crops_of_a_size_that_the_network_cannot_take(tmp_path, monkeypatch):
    cli = pytest.importorskip("ofanet_init.train.__main__")
    films = [Clip(f"{name}_1", np.zeros((6, 40, 40), np.uint8)) for name in ("ball", "car", "dog")]
    monkeypatch.setattr(cli, "load_clips", lambda folders: films)
    words = f"--model unet --data {tmp_path} --out {tmp_path / 'run'} --steps 1 --crop 40"
    result = CliRunner().invoke(cli.main, words.split())
    assert str(result.exception) == "crop is 40: a multiple of 16 was expected for unet"
