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


def other_operation(x, *args):
    return torch.zeros_like(x)


other_operation.binary = other_operation


@pytest.mark.parametrize("operation", [None, no_such_operation, other_operation])
def test_without_what_is_private_to_torch_all_stays(monkeypatch, operation):
    monkeypatch.setattr(torch.ops.mkldnn, "_convolution_pointwise", operation, raising=False)
    fusion._can_fuse.cache_clear()
    try:
        plain = network()
        fusion.fuse(plain, torch.float32)
        assert not fused_layers(plain)
        assert run(plain, torch.rand(1, 3, 8, 8)).isfinite().all()
    finally:
        fusion._can_fuse.cache_clear()
