"""Beside deepinv: our operator in its algorithms, its denoisers in our solver."""

import numpy as np
import pytest
from operators_and_priors import OPERATORS

import pnp_sci
from pnp_sci.datasets import embedded_scene
from pnp_sci.errors import InputError

torch = pytest.importorskip("torch")


def _import_deepinv():
    """deepinv imports torchvision, whose wheel for CUDA declares no operators beside a torch for the CPU."""
    try:
        import torchvision  # noqa: F401
    except RuntimeError:  # nothing here calls what is declared
        library = torch.library.Library("torchvision", "DEF")
        for name in ("nms", "qnms"):
            library.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    except ImportError:
        pass
    return pytest.importorskip("deepinv")


deepinv = _import_deepinv()
from pnp_sci.sensing.deepinv_physics import SensingPhysics  # noqa: E402


@pytest.fixture(autouse=True)
def seed():
    torch.manual_seed(0)


@pytest.fixture(scope="module")
def scene():
    return embedded_scene(64)


@pytest.fixture(params=OPERATORS.values(), ids=OPERATORS.keys())
def physics(request):
    return SensingPhysics(request.param, max_iter=200, tol=1e-9)


def test_is_adjoint_and_equals_the_operator(physics):
    op = pnp_sci.SensingOperator(physics.op.masks.numpy())
    assert torch.equal(SensingPhysics(op).op.masks, physics.op.masks)
    x = torch.randn(3, *physics.img_size, dtype=physics.op.dtype)
    y = physics(x)
    assert y.shape == (3, 1, *op.shape[2:])
    np.testing.assert_allclose(y[1, 0], op.forward(x[1].numpy()), rtol=1e-4, atol=1e-4)
    assert physics.adjointness_test(u=x) < 1e-5


def test_closed_forms_equal_the_iterations_of_deepinv(physics):
    physics.op = pnp_sci.TorchSensingOperator(physics.op.masks, torch.float64)
    plain = deepinv.physics.LinearPhysics(physics.A, physics.A_adjoint, physics.img_size, max_iter=500, tol=1e-10)
    z, y = (torch.randn(2, *shape, dtype=torch.float64) for shape in (physics.img_size, (1, *physics.img_size[2:])))
    gamma = torch.tensor([2.0, 0.1], dtype=torch.float64) / physics.op.gram.max()
    ours, theirs = physics.prox_l2(z, y, gamma), plain.prox_l2(z, y, gamma[:, None, None, None, None])
    torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(physics.prox_l2(z[:1], y[:1], float(gamma[0])), ours[:1])
    torch.testing.assert_close(physics.prox_l2(None, y, gamma), physics.prox_l2(0 * z, y, gamma))
    seen = physics.A(z)  # a measurement that some video has: the shortest of them has it too
    torch.testing.assert_close(physics.A(physics.A_dagger(seen)), seen)
    torch.testing.assert_close(physics.A_dagger(seen), plain.A_dagger(seen), rtol=1e-4, atol=1e-4)


class Blur(torch.nn.Module):
    """A denoiser that does the same in any unit."""

    def forward(self, x, sigma):
        frames = x.reshape(-1, 1, *x.shape[-2:])
        return torch.nn.functional.avg_pool2d(frames, 3, 1, 1, count_include_pad=False).reshape(x.shape)


def test_half_quadratic_splitting_of_deepinv_is_plain_gap(scene):
    zeros = np.zeros(scene.masks.shape, np.float64)
    ours = pnp_sci.solve(
        np.float64(scene.y), scene.masks, prior=Blur(), init=zeros, algorithm="plain-gap", scene="full",
        noise=0.0, sigma=0.1, iterations=20, tol=0,
    )  # fmt: skip
    physics = SensingPhysics(np.float64(scene.masks))
    splitting = deepinv.optim.HQS(
        deepinv.optim.L2(), deepinv.optim.PnP(Blur()), stepsize=1e9, sigma_denoiser=0.1, max_iter=20
    )
    with torch.no_grad():
        y = torch.tensor(scene.y, dtype=torch.float64)[None, None]
        theirs = splitting(y, physics, init=torch.tensor(zeros)[None])
    np.testing.assert_allclose(ours.x, theirs[0], atol=2e-5)  # ours hands modules float32


def test_a_network_unrolled_through_the_physics_learns():
    physics = SensingPhysics(torch.rand(2, 3, 8, 8))
    strength = torch.tensor(1.0, requires_grad=True)
    y = physics(torch.rand(4, 2, 3, 8, 8))
    physics.prox_l2(physics.A_adjoint(y), y, strength).square().sum().backward()
    assert strength.grad is not None
    assert strength.grad.abs() > 0


DENOISERS = {
    "TVDenoiser": lambda: deepinv.models.TVDenoiser(n_it_max=10),
    "MedianFilter": lambda: deepinv.models.MedianFilter(),
    "DRUNet": lambda: deepinv.models.DRUNet(1, 1, nc=(4, 4, 4, 4), nb=1, pretrained=None),
}


@pytest.mark.parametrize("name", DENOISERS)
def test_denoisers_of_deepinv_are_priors(name):
    """Each frame as they would denoise it themselves, at any size, in the solver's type."""
    denoiser = DENOISERS[name]()
    x = np.random.default_rng(0).random((2, 3, 20, 17))
    out = pnp_sci.denoise(x, 0.1, denoiser)
    assert (out.shape, out.dtype) == (x.shape, x.dtype)
    with torch.inference_mode():
        alone = DENOISERS[name]() if name == "TVDenoiser" else denoiser  # this one remembers
        expected = alone(torch.tensor(x, dtype=torch.float32).reshape(6, 1, 20, 17), 0.1)
    np.testing.assert_allclose(out.reshape(6, 1, 20, 17), expected, atol=1e-6)


def test_total_variation_of_deepinv_solves(scene):
    prior = deepinv.models.TVDenoiser(n_it_max=10)
    result = pnp_sci.solve(scene.y, scene.masks, prior=prior, iterations=60, reference=scene.truth)
    psnr = [record.psnr for record in result.history]
    assert psnr[-1] > psnr[0] + 1
    assert result.settings["prior"].startswith("TVDenoiser")


def test_a_denoiser_with_a_memory_forgets_it_where_a_video_begins(scene):
    y = np.stack([scene.y, np.ascontiguousarray(scene.y[::-1])])
    prior = deepinv.models.TVDenoiser(n_it_max=5)
    both = pnp_sci.solve(y, scene.masks, prior=prior, iterations=3, scene="full")
    alone = pnp_sci.solve(y[1], scene.masks, prior=prior, iterations=3, scene="full")
    np.testing.assert_allclose(both.x[1], alone.x, atol=1e-6)


def test_bad_input_is_named():
    with pytest.raises(InputError, match="masks"):
        SensingPhysics(np.ones((3, 3)))
    physics = SensingPhysics(np.ones((2, 3, 4, 5)))
    with pytest.raises(InputError, match="x has shape"):
        physics(torch.ones(1, 2, 3, 4, 4))
    with pytest.raises(InputError, match=r"x has shape \(2, 3, 4, 5\)"):
        physics(torch.ones(2, 3, 4, 5))
    for wrong in (torch.ones(7, 2, 4, 5), torch.ones(7, 4, 5)):
        with pytest.raises(InputError, match=r"y has shape \(7, .*\(N, 1, H, W\)"):
            physics.A_adjoint(wrong)
    with pytest.raises(InputError, match="rho"):
        physics.prox_l2(None, torch.ones(1, 1, 4, 5), -1.0)
