"""OFaNet: its layers against the paper's table, its variants, its input, and the files of its weights."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from untrained import make, measured

from pnp_sci.errors import DataUnavailableError, FormatError, InputError

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
amplifier = pytest.importorskip("ofanet_init.amplifier")
config = pytest.importorskip("ofanet_init.config")
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


def test_warping_fetches_what_the_flow_points_to():
    """What lies at p in the first lies at p + flow in the second."""
    x = torch.from_numpy(gaussian_filter(np.random.default_rng(0).random((64, 64)), 2).astype(np.float32))[None, None]
    second = torch.roll(x, (3, -2), (2, 3))
    uniform = torch.tensor([-2.0, 3.0])[None, :, None, None].expand(1, 2, 64, 64)
    assert torch.allclose(flow.warped(second, uniform)[..., 8:-8, 8:-8], x[..., 8:-8, 8:-8], atol=1e-5)


def test_flow_net_takes_any_size():
    net = make().flow
    frames = torch.rand(2, 1, 20, 26)
    assert net.flow(frames, frames.flip(0)).shape == (2, 2, 20, 26)


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
