"""The torch twin: the same numbers as the numpy operator, the right gradients, batches, devices, errors."""

import numpy as np
import pytest
from operators_and_priors import OPERATORS

from pnp_sci import SensingOperator, adjoint_mismatch
from pnp_sci.errors import InputError, InputTypeError

torch = pytest.importorskip("torch")
Twin = pytest.importorskip("pnp_sci.sensing.torch_operator").TorchSensingOperator

NO_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
DEVICES = ["cpu", pytest.param("cuda", marks=NO_GPU)]


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


@pytest.fixture(params=OPERATORS.values(), ids=OPERATORS.keys())
def masks(request):
    return request.param


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_equals_numpy(masks, dtype, device):
    op, twin = SensingOperator(masks, dtype), Twin(masks, getattr(torch, dtype), device)
    rng = np.random.default_rng(3)
    x, y = (rng.standard_normal(shape).astype(dtype) for shape in (op.shape, op.shape[2:]))
    assert (twin.shape, twin.masks.dtype == torch.uint8) == (op.shape, op.masks.dtype == np.uint8)
    for ours, theirs in (
        (twin.gram, op.gram),
        (twin(x), op.forward(x)),
        (twin.adjoint(y), op.adjoint(y)),
        (twin.project(x, y), op.project(x, y)),
        (twin.project(x, y, 0.5), op.project(x, y, 0.5)),
    ):
        assert (ours.dtype, ours.device.type) == (getattr(torch, dtype), device)
        rtol = 1e-5 if dtype == "float32" else 1e-12
        np.testing.assert_allclose(ours.cpu(), theirs, rtol=rtol, atol=rtol * (1 + np.abs(theirs).max()))


def test_adjoint(masks):
    assert adjoint_mismatch(Twin(masks, torch.float64)) < 1e-12


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_batches(masks, batch):
    twin = Twin(masks, torch.float64)
    x, y = torch.randn(*batch, *twin.shape), torch.randn(*batch, *twin.shape[2:])
    x, y = x.double(), y.double()
    out = twin.project(x, y, 0.1)
    assert (out.shape, twin(x).shape, twin.adjoint(y).shape) == (x.shape, y.shape, x.shape)
    for n in np.ndindex(batch):
        torch.testing.assert_close(out[n], twin.project(x[n], y[n], 0.1))
        torch.testing.assert_close(twin(x)[n], twin(x[n]))


@pytest.mark.parametrize("name", ["signed", "dead pixels", "one pixel"])
def test_gradients(name):
    """Of all three maps in x and y, and in a learned rho, against finite differences."""
    twin = Twin(OPERATORS[name], torch.float64)
    x = torch.randn(twin.shape, dtype=torch.float64, requires_grad=True)
    y = torch.randn(twin.shape[2:], dtype=torch.float64, requires_grad=True)
    rho = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(twin, x)
    assert torch.autograd.gradcheck(twin.adjoint, y)
    assert torch.autograd.gradcheck(twin.project, (x, y))
    assert torch.autograd.gradcheck(twin.project, (x, y, rho))


def test_gradient_of_the_data_term_is_the_adjoint():
    twin = Twin(OPERATORS["signed"], torch.float64)
    x, y = torch.randn(twin.shape, dtype=torch.float64, requires_grad=True), torch.randn(twin.shape[2:])
    ((twin(x) - y) ** 2 / 2).sum().backward()
    torch.testing.assert_close(x.grad, twin.adjoint(twin(x) - y).detach())


def test_dead_pixels_have_a_finite_gradient():
    twin = Twin(np.zeros((1, 2, 3, 3)))
    x = torch.randn(twin.shape, requires_grad=True)
    twin.project(x, torch.ones(3, 3)).sum().backward()
    assert torch.equal(x.grad, torch.ones_like(x))


def test_is_a_module():
    """Buffers travel with state_dict and with casts; masks of one byte stay so; nothing is trainable."""
    masks = OPERATORS["binary"]
    twin = Twin(masks)
    other = Twin(np.ones_like(masks))
    other.load_state_dict(twin.state_dict())
    assert torch.equal(other.masks, twin.masks)
    assert torch.equal(other.gram, twin.gram)
    assert list(twin.parameters()) == []
    double = Twin(masks).double()
    assert (double.dtype, double.masks.dtype) == (torch.float64, torch.uint8)
    assert double(np.zeros(double.shape)).dtype == torch.float64
    assert "2 x 10 masks of 9 x 7" in repr(twin)


def test_masks_of_a_tensor_are_copied():
    masks = torch.ones(2, 3, 4, 5)
    twin = Twin(masks)
    masks.zero_()
    assert twin.gram.min() == 6


def test_rho_for_all_for_each_measurement_and_for_each_pixel():
    """Also where as many measurements as columns make two readings possible."""
    random = np.random.default_rng(0)
    twin = Twin(random.random((2, 3, 4, 5)), torch.float64)
    x, y, rho = (torch.from_numpy(random.random(shape)) for shape in ((5, 2, 3, 4, 5), (5, 4, 5), (5,)))
    one_by_one = torch.stack([twin.project(x[n], y[n], float(rho[n])) for n in range(5)])
    torch.testing.assert_close(twin.project(x, y, rho), one_by_one)
    torch.testing.assert_close(twin.project(x, y, rho[:, None, None].expand(5, 4, 5)), one_by_one)
    torch.testing.assert_close(twin.project(x[0], y, rho), torch.stack([twin.project(x[0], *a) for a in zip(y, rho)]))


OP = Twin(np.ones((2, 3, 4, 5)))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: Twin(torch.ones(3, 4)), InputError, r"masks has shape \(3, 4\).*views, frames"),
        (lambda: Twin(torch.full((1, 1, 2, 2), torch.nan)), InputError, "masks has 4 .*NaN"),
        (lambda: Twin(np.ones((1, 1, 2, 2)), torch.float16), InputTypeError, "dtype is torch.float16.*float32"),
        (lambda: OP(torch.ones(3, 4, 5)), InputError, r"x has shape \(3, 4, 5\).*\(\.\.\., 2, 3, 4, 5\) was expected"),
        (lambda: OP(np.ones((2, 3, 4, 5), complex)), InputTypeError, "x has dtype complex128.*real"),
        (lambda: OP.adjoint(torch.ones(4, 5) + 0j), InputTypeError, "y has dtype torch.complex64.*real"),
        (lambda: OP.adjoint(torch.ones(5, 4)), InputError, r"y has shape \(5, 4\).*\(\.\.\., 4, 5\)"),
        (lambda: OP.project(torch.ones(OP.shape), torch.ones(4, 5), -1.0), InputError, "rho is -1.0.*>= 0"),
    ],
)
def test_errors(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_gradients_of_the_multiplier_are_finite_in_closed_pixels():
    masks = torch.ones(1, 2, 3, 4)
    masks[..., 1, 2] = 0
    op = Twin(masks)
    residual = torch.ones(3, 4, requires_grad=True)
    after, move = op.multiplier(torch.zeros(3, 4), residual, 2.0, 0.0)
    (after + move).sum().backward()
    expected = torch.full((3, 4), 3.0)
    expected[1, 2] = 0
    assert residual.grad is not None
    assert torch.equal(residual.grad, expected)
