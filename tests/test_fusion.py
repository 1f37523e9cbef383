"""Fused convolutions: what they give is what the layers give one by one."""

import copy

import pytest

torch = pytest.importorskip("torch")
from torch import nn  # noqa: E402

fusion = pytest.importorskip("pnp_sci.fusion")


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
