"""The backend torch on the CPU against numba: the same steps, the same total variation, solves within 0.05 dB."""

import subprocess
import sys

import numpy as np
import pytest
from operators_and_priors import by_name

import pnp_sci
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.plugins.combine import begun
from pnp_sci.plugins.on_host import OnHost
from pnp_sci.solvers.iterate import ALGORITHMS
from pnp_sci.solvers.state import start
from priors.tv import TV

torch = pytest.importorskip("torch")
TorchBackend = pytest.importorskip("pnp_sci.solvers.torch_backend").TorchBackend
CPU = TorchBackend.on("cpu")


def soften(x, sigma):
    """A denoiser of arrays and tensors: every pixel towards zero."""
    return x / (1 + sigma)


@pytest.fixture(scope="module")
def scene():
    return pnp_sci.datasets.embedded_scene(64)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("rho", ["none", "number", "picture"])
@pytest.mark.parametrize("bounded", [False, True])
def test_steps_are_the_same(algorithm, rho, bounded):
    rng = np.random.default_rng(3)
    masks = (rng.random((2, 5, 12, 9)) < 0.5).astype(float)
    masks[..., 4, 4] = 0  # a pixel that all masks leave closed
    op = pnp_sci.SensingOperator(masks)
    y = op.forward(rng.random(op.shape)) + 0.1 * rng.standard_normal(op.shape[2:])
    rho = {"none": 0.0, "number": 0.7, "picture": rng.random(y.shape)}[rho]
    saturated = rng.random(y.shape) < 0.2 if bounded else None
    step, x = ALGORITHMS[algorithm], rng.random(op.shape)
    ours, theirs = start(op, y, x), start(CPU.operator(op), CPU.put(y), CPU.put(x))
    for _ in range(6):
        ours = step(op, y, soften, ours, 0.1, rho, saturated)
        theirs = step(CPU.operator(op), CPU.put(y), soften, theirs, 0.1, CPU.put(rho), CPU.put(saturated))
    assert ours.pace == theirs.pace
    for name in ("x", "residual", "dual"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), atol=1e-12)


@pytest.mark.parametrize("prior", [TV(), TV(time=0), TV(time=0.3, inner=3), TV(isotropic=False)], ids=repr)
def test_total_variation_is_the_same(prior):
    """Also from the 40th call on, which measures weights along time and still pixels; duals have 30 bits or more."""
    rng = np.random.default_rng(1)
    scene = np.repeat(rng.random((2, 1, 20, 70)), 4, 1)
    scene[0, :, 5:9, 10:30] = rng.random((4, 4, 20))
    x = v = scene + 0.05 * rng.standard_normal(scene.shape)
    ours, theirs = prior.begin(v.shape, v.dtype), prior.begin_on(v.shape, v.dtype, "cpu")
    for _ in range(43):
        expected, came = ours(x, 0.04), theirs(torch.from_numpy(x), 0.04)
        np.testing.assert_allclose(came, expected, atol=1e-7)
        x = (v + expected) / 2
    np.testing.assert_allclose(theirs.facts()["still"], ours.facts()["still"], atol=1e-6)


@pytest.mark.parametrize("prior", ["tv", "tv+wavelet", by_name("ffdnet")])
def test_solves_are_within_a_twentieth_of_a_dB(prior, scene):
    results = [pnp_sci.solve(scene.y, scene.masks, prior, iterations=65, backend=name) for name in ("numba", "torch")]
    numba, torch = (pnp_sci.psnr(result.x, scene.truth).mean() for result in results)
    assert abs(numba - torch) < 0.05
    assert [result.settings["backend"] for result in results] == ["numba", "torch"]


@pytest.mark.parametrize("prior", ["flow", by_name("video")])
def test_priors_of_motion_are_not_worse_than_with_numba(prior, scene):
    """Flow and weights are not rounded to integers on tensors, so that results differ in the second digit."""
    how = {"init": "adjoint", "first": 20, "iterations": 30}
    results = [pnp_sci.solve(scene.y, scene.masks, prior, backend=name, **how) for name in ("numba", "torch")]
    numba, torch = (pnp_sci.psnr(result.x, scene.truth).mean() for result in results)
    assert -0.05 < torch - numba < 0.15


def test_noise_saturation_and_averages_are_treated_alike(scene):
    """A noisy, saturated measurement through ADMM, with what is returned scored in every iteration."""
    y = scene.y + 0.3 * np.random.default_rng(0).standard_normal(scene.y.shape).astype(np.float32)
    sensor = pnp_sci.Sensor(full_scale=float(np.quantile(y, 0.95)))
    y = np.minimum(y, sensor.full_scale)
    for algorithm in ALGORITHMS:
        numba, torch = (
            pnp_sci.solve(
                y, scene.masks, noise=sensor, algorithm=algorithm, iterations=15, reference=scene.truth, backend=name
            )
            for name in ("numba", "torch")
        )
        assert len(numba.history) == len(torch.history)
        np.testing.assert_allclose(numba.history[-1].psnr, torch.history[-1].psnr, atol=0.01)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_sequences_are_treated_alike(scene, algorithm):
    """Each measurement through masks of its own, one of them saturated."""
    masks = np.stack([scene.masks, np.roll(scene.masks, 3, axis=-1), scene.masks])
    y = np.stack([pnp_sci.simulate(scene.truth, own) for own in masks])
    sensor = pnp_sci.Sensor(0.05, full_scale=float(np.quantile(y, 0.99)))
    y = np.minimum(y, sensor.full_scale)
    how = {"sequence": True, "iterations": 10, "scene": "full", "noise": sensor, "algorithm": algorithm}
    numba, torch = (pnp_sci.solve(y, masks, backend=name, **how).x for name in ("numba", "torch"))
    np.testing.assert_allclose(torch, numba, atol=2e-4)


def test_a_prior_of_arrays_serves_tensors():
    """A function gets arrays of numpy, as by the other backend."""
    seen = []

    def halve(x, sigma):
        seen.append(type(x))
        return x / 2

    prior = pnp_sci.as_prior(halve)
    for wrong in (lambda x, sigma: None, lambda x, sigma: x + 1j, lambda x, sigma: x[:1, :1]):
        with pytest.raises((InputError, InputTypeError), match="what the prior returns"):
            begun(pnp_sci.as_prior(wrong), (1, 2, 4, 4), np.dtype("f4"), "cpu")(torch.ones(1, 2, 4, 4), 0.1)
    session = begun(prior, (1, 2, 4, 4), np.dtype("f4"), "cpu")
    v = torch.ones(1, 2, 4, 4)
    assert isinstance(session, OnHost)
    assert float(session(v, 0.1, out=v).max()) == 0.5
    assert seen == [np.ndarray]


def test_a_callback_sees_tensors_and_stops(scene):
    states = []
    result = pnp_sci.solve(
        scene.y, scene.masks, backend="torch", callback=lambda s: states.append(s) or len(states) > 2
    )
    assert len(states) == 3
    assert all(isinstance(state.x, torch.Tensor) for state in states)
    assert result.x.shape == scene.truth.shape


def test_a_budget_of_time_is_kept(scene):
    result = pnp_sci.solve(scene.y, scene.masks, backend="torch", time_budget=3.0)
    assert result.settings["seconds"] < 4


@pytest.mark.parametrize("prior", ["tv", "wavelet", "none"])
def test_a_device_that_cannot_be_used_is_told(prior, scene):
    for how in (
        {"device": "nonsense"},
        {"device": "nonsense", "backend": "torch"},
        {"device": "nonsense", "backend": "numba"},
    ):
        with pytest.raises(InputError, match=r"device.*nonsense"):
            pnp_sci.solve(scene.y, scene.masks, prior, **how)
    with pytest.raises(InputError, match="backend"):
        pnp_sci.solve(scene.y, scene.masks, prior, backend="jax")


def test_nothing_loads_torch_unasked():
    code = """
import sys, pnp_sci
scene = pnp_sci.datasets.embedded_scene(32)
pnp_sci.solve(scene.y, scene.masks, iterations=2)
assert "torch" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=100)
