"""OFaNet: its layers against the paper's table, its variants, its input, and what comes out of decode and solve."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.bench import compare, grid
from pnp_sci.errors import DataUnavailableError, FormatError, InputError
from pnp_sci.plugins import registry

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
fusion = pytest.importorskip("pnp_sci.accel.fusion")
half_precision = pytest.importorskip("pnp_sci.accel.inference").half_precision
amplifier = pytest.importorskip("ofanet_init.amplifier")
config = pytest.importorskip("ofanet_init.config")
decoder = pytest.importorskip("ofanet_init.decoder")
flow = pytest.importorskip("ofanet_init.flow")
network = pytest.importorskip("ofanet_init.network")
refine = pytest.importorskip("ofanet_init.refine")
separator = pytest.importorskip("ofanet_init.separator")
weights = pytest.importorskip("ofanet_init.files")

VARIANTS = {
    "OFaNet": {},
    "W/o DA": {"amplifier": False},
    "W/o DNS": {"dual": False},
    "W/o RN": {"refine": "none"},
    "W/o OF": {"flow": "none"},
    "W/o Br": {"flow": "forward"},
    "W/o JT": {"joint": False},
    "DA&DNS&BRRN": {"refine": "birecurrent"},
    "single view": {"views": 1},
    "two passes": {"passes": 2},
    "BRRN, two passes": {"refine": "birecurrent", "passes": 2},
}


def make(**fields):
    """An untrained model whose layers all do something."""
    torch.manual_seed(0)
    model = network.OFaNet(config.OFaNetConfig(**{"frames": 4} | fields))
    for layer in (*(model.flow.predict if model.flow else ()), *(net.cell.r[-1] for net in model.refiners)):
        torch.nn.init.normal_(layer.weight, std=0.1)
    return model.eval()


def measured(views=2, frames=4, rows=20, columns=26, seed=0):
    random = np.random.default_rng(seed)
    masks = torch.from_numpy((random.random((1, views, frames, rows, columns)) < 0.5).astype(np.float32))
    truth = torch.from_numpy(random.random((1, views, frames, rows, columns), np.float32))
    return (masks * truth).sum((1, 2)), masks


def outputs(module, *arguments):
    """Channels and size of what every convolution of a module gives, in order."""
    seen = []
    kinds = (torch.nn.Conv2d, torch.nn.ConvTranspose2d)
    hooks = [
        layer.register_forward_hook(lambda layer, _, out: seen.append((tuple(layer.kernel_size), *out.shape[1:3])))
        for layer in module.modules()
        if isinstance(layer, kinds)
    ]
    module(*arguments)
    for hook in hooks:
        hook.remove()
    return seen


def test_separator_is_the_papers_table():
    """Kernels, channels and sizes of the rows F_cnn1, F_cnn2 and F_cnn3 of its table, for B = 10 and 256 x 256."""
    branch = separator.Branch(15, 10)
    with torch.inference_mode():
        rows = outputs(branch, torch.zeros(1, 15, 256, 256))
    unit = [((3, 3), 64, 128), ((1, 1), 64, 128), ((3, 3), 64, 128)]
    assert rows[:4] == [((5, 5), 32, 256), ((3, 3), 64, 256), ((1, 1), 64, 256), ((3, 3), 64, 128)]
    assert rows[4:31] == 9 * unit
    assert rows[31:] == [((3, 3), 64, 256), ((1, 1), 64, 256), ((3, 3), 32, 256), ((1, 1), 10, 256)]
    layers = [(15, 32, 25), (32, 64, 9), (64, 64, 1), (64, 64, 9)]
    layers += 9 * [(64, 64, 9), (64, 64, 1), (64, 64, 9)]
    layers += [(128, 64, 9), (64, 64, 1), (64, 32, 9), (32, 10, 1)]
    expected = sum(inputs * channels * kernel + channels for inputs, channels, kernel in layers)
    count = sum(p.numel() for p in branch.parameters())
    print(f"one branch of the separator: {count} parameters")
    assert count == expected


def test_refine_net_is_the_papers_table():
    cell = refine.Cell(diversity=4, flows=2)
    channels = (1 + refine.EVIDENCE, 2, 4, refine.HIDDEN)
    frame, motion, images, hidden = (torch.zeros(1, count, 256, 256) for count in channels)
    with torch.inference_mode():
        features = [((5, 5), 20, 256), ((1, 1), 20, 256), ((3, 3), 20, 256), ((1, 1), 20, 256), ((3, 3), 20, 256)]
        assert outputs(cell.f_x, frame) == outputs(cell.f_d, images) == features
        for net in cell.f_f:
            assert outputs(net, motion) == [((5, 5), 40, 256), ((3, 3), 40, 256), ((1, 1), 40, 256)]
        unit = [((3, 3), 40, 256), ((1, 1), 40, 256), ((3, 3), 40, 256)]
        last = [((1, 3), 20, 256), ((3, 1), 20, 256), ((1, 3), 10, 256)]
        assert outputs(cell.f_h, hidden) == 6 * unit + last
        r = [((3, 3), 40, 256), ((1, 1), 30, 256), ((3, 3), 20, 256), ((1, 1), 20, 256), ((3, 3), 20, 256)]
        assert outputs(cell.r, hidden) == [*r, ((1, 1), 1, 256)]


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_decodes_any_size(name):
    model = make(**VARIANTS[name])
    y, masks = measured(views=model.config.views)
    with torch.inference_mode():
        first, refined = model(y, masks)
    assert first.shape == refined.shape == masks.shape
    assert torch.isfinite(refined).all()
    assert torch.equal(first, refined) == (model.config.refine == "none")


def test_variants_are_smaller_where_they_leave_something_out():
    sizes = {name: sum(p.numel() for p in make(**fields).parameters()) for name, fields in VARIANTS.items()}
    for name in ("W/o DA", "W/o DNS", "W/o RN", "W/o OF", "W/o Br", "single view"):
        assert sizes[name] < sizes["OFaNet"], name
    assert sizes["W/o JT"] == sizes["OFaNet"] < sizes["DA&DNS&BRRN"]


@pytest.mark.parametrize("name", ["OFaNet", "W/o JT", "DA&DNS&BRRN"])
def test_gradients_reach_the_flow_net_if_it_learns(name):
    model = make(**VARIANTS[name])
    model(*measured()).refined.square().mean().backward()
    reached = [p.grad is not None and bool(p.grad.abs().max() > 0) for p in model.flow.parameters()]
    assert all(reached) if model.config.joint else not any(reached)
    assert all(p.grad is not None for p in model.separator.parameters())


def test_a_window_refines_those_frames_only():
    model = make(flow="none")
    y, masks = measured()
    with torch.inference_mode():
        whole, part = model(y, masks), model(y, masks, window=slice(0, 2))
    assert torch.allclose(part.refined, whole.refined[:, :, :2], atol=1e-6)
    assert part.first.shape == masks.shape


def test_a_second_pass_goes_over_what_the_first_has_refined():
    """It sees what is left of the measurement then; the window and the gradients are those of the last."""
    model, (y, masks) = make(flow="none", passes=2), measured()
    with torch.inference_mode():
        images, once = model._images(y, masks), model(y, masks, passes=1)
        residual = (y - (masks * once.refined).sum((1, 2)))[:, None] / masks.sum((1, 2)).clamp(min=0.5)[:, None]
        again = model._refined(once.refined, network.through(masks, residual), images)
        twice, part = model(y, masks), model(y, masks, window=slice(0, 2))
    assert torch.equal(twice.first, once.first)
    assert torch.allclose(twice.refined, again, atol=1e-5)
    assert not torch.allclose(twice.refined, once.refined, atol=1e-2)
    assert torch.allclose(part.refined, twice.refined[:, :, :2], atol=1e-5)
    for passes, reached in ((1, True), (2, False)):
        model.zero_grad()
        model(y, masks, passes=passes).refined.sum().backward()
        assert all((p.grad is not None) == reached for p in model.separator.parameters())
        assert all(p.grad is not None for p in model.refiners.parameters())


@pytest.mark.parametrize(("views", "dual"), [(2, True), (2, False), (3, True)])
def test_in_all_orders_no_view_is_the_first(views, dual):
    """Then the views of the separator's video change places with their masks; in one order they become others."""
    model = make(views=views, dual=dual, refine="none", flow="none")
    masks = torch.rand(1, views, 4, 32, 32)
    y = masks.sum((1, 2))
    with torch.inference_mode():
        one, other = (model(y, m).first for m in (masks, masks.roll(1, 1)))
        assert not torch.allclose(one.roll(1, 1), other, atol=1e-3)
        there, back = (model(y, m, orders=views).first for m in (masks, masks.roll(1, 1)))
    assert torch.allclose(there.roll(1, 1), back, atol=1e-5)


def test_views_share_the_refine_net():
    """What it makes of a view does not depend on the place of that view."""
    model = make(frames=3)
    first = torch.rand(1, 2, 3, 32, 32)
    evidence = torch.rand(1, 2, 3, refine.EVIDENCE, 32, 32)
    images = torch.rand(1, 4, 32, 32)
    swapped = images[:, [1, 0, 3, 2]]
    with torch.inference_mode():
        there = model._refined(first, evidence, images)
        back = model._refined(first.flip(1), evidence.flip(1), swapped).flip(1)
        mistaken = model._refined(first, evidence, swapped)
    assert torch.allclose(there, back, atol=1e-5)
    assert not torch.allclose(there, mistaken, atol=1e-3)


def test_refine_net_sees_what_the_separator_has_missed():
    """The residual of the separator's video over the sum of the masks, through the mask of each frame."""
    model = make(flow="none", frames=3)
    y, masks = measured(frames=3)
    y = torch.cat([y, 2 * y])
    seen = []
    model.refiners[0].register_forward_pre_hook(lambda _, given: seen.append(given[1].unflatten(0, (2, 2))))
    with torch.inference_mode():
        first = model(y, masks, window=slice(1, 3)).first
    missed = (y - (masks * first).sum((1, 2))) / masks.sum((1, 2)).clamp(min=0.5)
    shown = masks[:, :, 1:].expand(2, -1, -1, -1, -1)
    assert torch.equal(seen[0][:, :, :, 0], shown)
    assert torch.allclose(seen[0][:, :, :, 1], network.LOUDER * shown * missed[:, None, None], atol=1e-5)


@pytest.mark.parametrize(
    "fields", [{"views": 0}, {"frames": 2.5}, {"refine": "all"}, {"flow": "backward"}, {"passes": 0}]
)
def test_configuration_names_what_is_wrong(fields):
    with pytest.raises(InputError, match=next(iter(fields))):
        config.OFaNetConfig(**fields)


def test_amplified_images_are_the_papers_equations():
    """With Y over 2 B for Y: the normalised measurement, D_1 to D_4."""
    y, masks = measured(frames=10, rows=40, columns=44)
    masks[:, :, 0] = 1  # no pixel is closed in a view
    plain, coded = y[0].numpy() / 20, masks[0].numpy().astype(np.float64)
    first, second = (plain / view.mean(0) for view in coded)

    def smooth(image):
        return gaussian_filter(image, amplifier.BLUR, radius=amplifier.RADIUS, mode="mirror")

    assert np.allclose(amplifier.normalised(y, masks)[0, 0], plain / coded.mean((0, 1)), rtol=1e-5)
    images = [first, second, first - smooth(first), second - smooth(second)]
    assert np.allclose(amplifier.diversity(y, masks)[0], images, atol=1e-5)


def test_pixels_where_masks_are_closed():
    """A view closed at a pixel gets the normalised measurement there; where all are closed, everything is 0."""
    y, masks = measured()
    masks[:, 0, :, 3, 5] = masks[:, :, :, 7, 7] = 0
    y[:, 7, 7] = 0
    images, common = amplifier.diversity(y, masks), amplifier.normalised(y, masks)
    assert images[0, 0, 3, 5] == common[0, 0, 3, 5]
    assert images[0, :2, 7, 7].abs().max() == common[0, 0, 7, 7] == 0
    assert torch.isfinite(images).all()


def test_flow_points_from_the_first_frame_to_the_second():
    """What lies at p in the first lies at p + flow in the second: warping and the flows agree on that."""
    x = torch.from_numpy(gaussian_filter(np.random.default_rng(0).random((64, 64)), 2).astype(np.float32))[None, None]
    first = (x - x.min()) / (x.max() - x.min())
    second = torch.roll(first, (3, -2), (2, 3))
    estimate = flow.DISFlow().flow(first, second)[0, :, 16:48, 16:48].mean((1, 2))
    assert torch.allclose(estimate, torch.tensor([-2.0, 3.0]), atol=0.5)
    uniform = torch.tensor([-2.0, 3.0])[None, :, None, None].expand(1, 2, 64, 64)
    assert torch.allclose(flow.warped(second, uniform)[..., 8:-8, 8:-8], first[..., 8:-8, 8:-8], atol=1e-5)


def test_flow_net_takes_any_size():
    net = make().flow
    frames = torch.rand(2, 1, 20, 26)
    assert net.flow(frames, frames.flip(0)).shape == (2, 2, 20, 26)


# what decode and solve make of it


@pytest.fixture
def trained(tmp_path, monkeypatch):
    """A folder of weights for 2 views of 4 frames, in place of the package's."""
    weights.save(tmp_path / "v2b4.safetensors", make())
    monkeypatch.setattr(weights, "FOLDER", tmp_path)
    decoder._network.cache_clear()
    yield tmp_path
    decoder._network.cache_clear()


@pytest.fixture(scope="module")
def small():
    return pnp_sci.datasets.embedded_scene(48)


@pytest.fixture
def case(small):
    masks = small.masks[:, :4]
    return pnp_sci.simulate(small.truth[:, :4], masks), masks


@pytest.mark.parametrize("model", ["ofanet", "ofanet-fast"])
@pytest.mark.parametrize("factor", [1e-6, 3.0, 1e6])
def test_decode_scales_with_the_measurement(trained, case, model, factor):
    y, masks = case
    x, scaled = (pnp_sci.decode(a * y, masks, model=model).x for a in (1.0, factor))
    assert x.shape == masks.shape
    assert np.allclose(scaled, factor * x, atol=2e-2 * factor * np.abs(x).max())


@pytest.mark.parametrize("model", ["ofanet", "ofanet-fast"])
def test_fused_or_not_it_decodes_the_same(trained, case, model, monkeypatch):
    outs, could = [], fusion._can_fuse
    for possible in (True, False):
        monkeypatch.setattr(fusion, "_can_fuse", lambda dtype, possible=possible: possible and could(dtype))
        decoder._network.cache_clear()
        outs.append(pnp_sci.decode(*case, model=model).x)
        modules = decoder._network(2, 4, torch.device("cpu")).modules()
        half = half_precision(torch.device("cpu"))
        fused = any(isinstance(module, fusion.Fused) for module in modules)
        assert fused == (possible and could(torch.bfloat16 if half else torch.float32))
    assert np.abs(outs[0] - outs[1]).mean() < 0.02 * np.abs(outs[0]).mean()


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


def test_missing_weights_are_named(trained, small):
    with pytest.raises(InputError, match=r"2 x 10 frames.*2 x 4"):
        pnp_sci.decode(small.y, small.masks, model="ofanet")


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
    decoder._network.cache_clear()
    whole, fast = (pnp_sci.decode(*case, model=model).x for model in ("ofanet", "ofanet-fast"))
    decoder._network.cache_clear()
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
    result = pnp_sci.solve(y, masks, init=init, iterations=5)
    assert result.settings["init"] == init
    assert result.history[0].residual == pytest.approx(start.history[0].residual, rel=1e-3)
    assert result.status.ok


def learned(x, sigma):
    return x.copy()


learned.learned = True


@pytest.mark.parametrize(
    ("frames", "prior", "lowest", "init"),
    [(4, learned, 0, "ofanet-fast"), (4, "tv", 0, "adjoint"), (3, learned, 0, "adjoint"), (4, learned, -1, "adjoint")],
    ids=["learned prior", "another", "no weights", "masks that the network cannot take"],
)
def test_first_estimate_that_is_chosen(trained, frames, prior, lowest, init):
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
    decoder._network.cache_clear()
    with pytest.raises(FormatError, match="not a safetensors file"):
        pnp_sci.solve(*case, learned, iterations=1)


@pytest.mark.parametrize("rows", [70, 256, 301])
def test_pictures_are_decoded_by_parts_without_a_seam(trained, monkeypatch, rows):
    rng = np.random.default_rng(0)
    masks = (rng.random((2, 4, rows, 32)) < 0.5).astype(np.float32)
    y = pnp_sci.simulate(rng.random(masks.shape, np.float32), masks)
    whole = pnp_sci.decode(y, masks, model="ofanet-fast").x
    monkeypatch.setattr(decoder, "ROWS", 64)
    assert np.abs(pnp_sci.decode(y, masks, model="ofanet-fast").x - whole).max() < 0.02 * np.ptp(whole)


def test_a_learned_prior_is_scored_from_the_start_that_it_gets(trained, case, monkeypatch):
    started = []
    monkeypatch.setitem(registry._registered["priors"], "learned", lambda: learned)
    inits = {"ofanet-fast": lambda op, y: started.append("network") or np.zeros(op.shape, op.dtype)}
    monkeypatch.setitem(registry._registered, "inits", inits)
    methods = grid(["learned", "tv"], iterations=2)
    scored = compare(*case, methods)
    assert len(started) == 2, "once for the score and once for the result, and never for tv"
    assert [trial.result.settings["init"] for trial in scored.trials] == ["ofanet-fast", "adjoint"]


def test_without_networks_the_first_estimate_is_a_plain_one(trained, case, monkeypatch):
    monkeypatch.setattr("pnp_sci.plugins.resolve.NETWORK", "not installed")
    assert pnp_sci.solve(*case, learned, iterations=2).settings["init"] == "adjoint"


def test_weights_come_back(tmp_path):
    model = make(refine="none", frames=3)
    digest = weights.save(tmp_path / "w.safetensors", model)
    again, same = weights.load(tmp_path / "w.safetensors")
    assert same == digest
    assert again.config == model.config
    assert all(torch.equal(v.half(), again.state_dict()[k].half()) for k, v in model.state_dict().items())


def test_weights_that_do_not_fit(tmp_path):
    with pytest.raises(DataUnavailableError, match=r"ofanet_init\.train"):
        weights.load(tmp_path / "absent.safetensors")
    (tmp_path / "text.safetensors").write_text("no weights")
    with pytest.raises(FormatError, match="not a safetensors file"):
        weights.load(tmp_path / "text.safetensors")


def test_a_later_stage_takes_over_what_it_knows(tmp_path):
    early, late = make(refine="none"), make()
    torch.nn.init.zeros_(early.separator.branches[0].cnn1[1].weight)
    weights.save(tmp_path / "dns.safetensors", early)
    flow_before = late.flow.predict[0].weight.clone()
    weights.start(late, tmp_path / "dns.safetensors")
    assert late.separator.branches[0].cnn1[1].weight.abs().max() == 0
    assert torch.equal(late.flow.predict[0].weight, flow_before)


def test_an_untrained_refine_net_changes_nothing():
    model = network.OFaNet(config.OFaNetConfig(frames=4)).eval()
    with torch.inference_mode():
        first, refined = model(*measured())
    assert torch.equal(first, refined)
