"""Fused convolutions: what they give is what the layers give one by one."""

import copy

import numba
import numpy as np
import pytest

import pnp_sci

torch = pytest.importorskip("torch")
from torch import nn  # noqa: E402

fusion = pytest.importorskip("pnp_sci.accel.fusion")


def fused_layers(network):
    return [module for module in network.modules() if isinstance(module, fusion.Fused)]


def network():
    """Every kind of convolution in a sequence, a residual unit, and a convolution of its own."""
    torch.manual_seed(0)
    return nn.ModuleDict(
        {
            "sequence": nn.Sequential(
                nn.Conv2d(3, 8, 5, padding=2),
                nn.LeakyReLU(0.1, inplace=True),
                nn.Conv2d(8, 8, (1, 3), stride=2, padding=(0, 1), bias=False),
                nn.ReLU(inplace=True),
                fusion.Residual(nn.Sequential(nn.Conv2d(8, 8, 3, padding=1), nn.ReLU(), nn.Conv2d(8, 8, 3, padding=1))),
                nn.Conv2d(8, 4, 1),
                nn.Tanh(),
                nn.Conv2d(4, 4, 3, padding=2, dilation=2, groups=2),
            ),
            "alone": nn.Conv2d(4, 2, 1),
        }
    )


def run(network, x):
    with torch.inference_mode():
        h = network["sequence"](x)
        return network["alone"](h.to(network["alone"].weight.dtype)).float()


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.bfloat16, 0.03)])
@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_fused_is_the_same(dtype, tolerance, layout):
    if not fusion._can_fuse(dtype):
        pytest.skip("this torch fuses nothing")
    apart = network()
    together = copy.deepcopy(apart)
    fusion.fuse(together, dtype)
    assert len(fused_layers(together)) == 6, "but for the one outside of a sequence"
    x = torch.rand(2, 3, 20, 14).contiguous(memory_format=layout)
    seen = x.clone()
    torch.testing.assert_close(run(together, x), run(apart, x), rtol=tolerance, atol=tolerance)
    assert torch.equal(x, seen), "what comes in is left as it is"
    again = copy.deepcopy(together)
    fusion.fuse(again, dtype)
    assert torch.equal(run(again, x), run(together, x))


def test_a_residual_unit_leaves_its_input():
    unit = fusion.Residual(nn.Sequential(nn.Conv2d(4, 4, 3, padding=1), nn.ReLU(), nn.Conv2d(4, 4, 1)))
    x = torch.rand(1, 4, 8, 8)
    expected = x + unit.body(x)
    torch.testing.assert_close(unit(x), expected)
    fusion.fuse(unit, torch.float32)
    seen = x.clone()
    with torch.inference_mode():
        torch.testing.assert_close(unit(x), expected.detach(), rtol=1e-5, atol=1e-5)
    assert torch.equal(x, seen)


def no_such_operation(*args):
    raise RuntimeError("no such operation")


class OtherSlope:
    """The operation itself, but for the slope of a rectifier."""

    def __init__(self, operation):
        self.operation, self.binary = operation, operation.binary

    def __call__(self, *args):
        *layer, kind, slope, algorithm = args
        return self.operation(*layer, kind, [0.0 for _ in slope], algorithm)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("change", [lambda operation: None, lambda operation: no_such_operation, OtherSlope])
def test_without_what_is_private_to_torch_all_stays(monkeypatch, change, dtype):
    if not fusion._can_fuse(dtype):
        pytest.skip("this torch fuses nothing")
    operation = torch.ops.mkldnn._convolution_pointwise
    monkeypatch.setattr(torch.ops.mkldnn, "_convolution_pointwise", change(operation))
    fusion._can_fuse.cache_clear()
    try:
        plain = network()
        fusion.fuse(plain, dtype)
        assert not fused_layers(plain)
        assert run(plain, torch.rand(1, 3, 8, 8)).isfinite().all()
    finally:
        fusion._can_fuse.cache_clear()


def test_the_check_leaves_random_numbers_alone():
    state = torch.random.get_rng_state()
    fusion._can_fuse.cache_clear()
    fusion._can_fuse(torch.float32)
    assert torch.equal(torch.random.get_rng_state(), state)


def test_state_of_a_fused_network_is_complete():
    whole = network()
    names = set(whole.state_dict())
    fusion.fuse(whole, torch.float32)
    assert set(whole.state_dict()) == names


@pytest.mark.parametrize("other", [{"padding_mode": "reflect", "padding": 1}, {"padding": "same"}])
def test_what_oneDNN_does_not_know_stays(other):
    layers = nn.Sequential(nn.Conv2d(2, 2, 3, **other))
    fusion.fuse(layers, torch.float32)
    assert not fused_layers(layers)


@pytest.mark.parametrize(
    ("channels", "size"),
    [((32, 32), (64, 64)), ((33, 24), (37, 130)), ((40, 40), (6, 15)), ((32, 56), (1, 1)), ((64, 16), (5, 2))],
    ids=str,
)
@pytest.mark.threads
@pytest.mark.parametrize("rectifier", [None, nn.ReLU(), nn.LeakyReLU(0.1)], ids=str)
def test_a_convolution_by_fewer_products_is_the_same(channels, size, rectifier):
    """Winograd's against torch's in double precision, with a bias where something rectifies, else with a sum."""
    torch.manual_seed(0)
    layer = nn.Conv2d(*channels, 3, padding=1, bias=rectifier is not None)
    x, added = torch.randn(2, channels[0], *size), torch.randn(2, channels[1], *size)
    with torch.inference_mode():
        expected = layer.double()(x.double())
        expected = rectifier(expected) if rectifier else expected + added.double()
        few, given = fusion.Winograd(layer.float(), rectifier, torch.float32), (x,) if rectifier else (x, added)
        result = few(*given)
        torch.testing.assert_close(result.double(), expected, rtol=1e-5, atol=3e-5)
        assert torch.equal(few(*(torch.cat([a, a[:1]]) for a in given))[:2], result), "frames do not mix"
        threads = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            assert torch.equal(few(*given), result), "threads do not count"
        finally:
            numba.set_num_threads(threads)


def test_which_convolutions_take_fewer_products(monkeypatch):
    """On a processor with vectors of eight, in single precision, wide ones of 3 x 3 pixels without a stride."""
    wide = nn.Conv2d(32, 40, 3, padding=1)
    others = [
        nn.Conv2d(16, 40, 3, padding=1), nn.Conv2d(32, 20, 3, padding=1), nn.Conv2d(32, 8, 3, padding=1),
        nn.Conv2d(32, 40, 5, padding=1), nn.Conv2d(32, 40, 3), nn.Conv2d(32, 40, 3, padding=1, stride=2),
        nn.Conv2d(32, 64, 3, padding=1, groups=2), nn.Conv2d(32, 40, 3, padding=1, dilation=2),
    ]  # fmt: skip
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX2")
    assert fusion.Winograd.serves(wide, torch.float32)
    assert not fusion.Winograd.serves(wide, torch.bfloat16)
    assert not any(fusion.Winograd.serves(layer, torch.float32) for layer in others)
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX512")
    assert not fusion.Winograd.serves(wide, torch.float32)


def test_a_residual_unit_ends_with_fewer_products(monkeypatch):
    if not fusion._can_fuse(torch.float32):
        pytest.skip("this torch fuses nothing")
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX2")
    torch.manual_seed(0)
    body = nn.Sequential(nn.Conv2d(32, 32, 3, padding=1), nn.ReLU(inplace=True), nn.Conv2d(32, 32, 3, padding=1))
    apart = fusion.Residual(body)
    few = copy.deepcopy(apart)
    fusion.fuse(few, torch.float32)
    assert [type(layer) for layer in fused_layers(few)] == [fusion.Winograd] * 2
    x = torch.randn(3, 32, 20, 22)
    with torch.inference_mode():
        torch.testing.assert_close(few(x), apart(x), rtol=1e-5, atol=3e-5)


@pytest.mark.parametrize("geometry", [(2, 2, 0), (3, 2, 1), (4, 2, 1), (3, 3, 1), (5, 2, 2)], ids=str)
@pytest.mark.parametrize("inputs", [5, 48, 64])
def test_strides_that_leave_a_single_column(geometry, inputs):
    """On CPUs with AMX the convolution itself gives arbitrary values there, in bfloat16."""
    if not fusion._can_fuse(torch.bfloat16):
        pytest.skip("this torch fuses nothing")
    torch.manual_seed(0)
    layer = nn.Conv2d(inputs, 32, *geometry)
    fused = copy.deepcopy(nn.ModuleList([layer]))
    fusion.fuse(fused, torch.bfloat16)
    for columns in range(1, 6):
        for rows in (4, 12, 16, 33):
            x = torch.randn(2, inputs, rows, columns).contiguous(memory_format=torch.channels_last)
            if columns + 2 * geometry[2] >= geometry[0]:
                with torch.inference_mode():
                    torch.testing.assert_close(fused[0](x).float(), layer(x), rtol=0.03, atol=0.05)


@pytest.mark.parametrize("shape", [(1, 1, 8, 64), (1, 2, 64, 8), (1, 1, 3, 100), (2, 1, 40, 5)])
def test_networks_serve_narrow_pictures(shape):
    ramp = np.broadcast_to(np.linspace(0.1, 0.9, max(shape)), (*shape[:2], min(shape[2:]), max(shape)))
    clean = ramp if shape[3] > shape[2] else ramp.swapaxes(2, 3)
    noisy = (clean + 0.05 * np.random.default_rng(0).standard_normal(shape)).astype(np.float32)
    for prior in ("ffdnet", "video"):
        assert np.abs(pnp_sci.denoise(noisy, 0.05, prior) - clean).max() < 0.15
