"""The first estimate: by name, as a video, or from a decoder."""

import subprocess
import sys
import types

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import SceneModel, datasets, solve
from pnp_sci.errors import FormatError, InputError, InputTypeError, UnknownPluginError
from pnp_sci.pipeline.start import first_estimate
from pnp_sci.plugins import registry
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import full


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def relative(a, b):
    return np.linalg.norm(np.asarray(a, float) - np.asarray(b, float)) / np.linalg.norm(np.asarray(b, float))


def test_init_and_reference_in_users_units(scene):
    y, counts = 255 * scene.y, np.round(255 * scene.truth).astype(np.uint8)
    result = solve(y, scene.masks, "none", 255 * scene.truth, iterations=1)
    assert relative(result.x, 255 * scene.truth) < 1e-5
    result = solve(y, scene.masks, "none", counts, iterations=1, reference=counts)
    assert result.history["psnr"][0] > 50


def test_a_first_estimate_of_another_scale_is_named(scene):
    levels = np.round(255 * scene.truth).astype(np.uint8)
    with pytest.raises(InputError, match=r"init leaves 2\d\d times y as residual: .* units of y"):
        solve(scene.y, scene.masks, init=levels)
    assert solve(255 * scene.y, scene.masks, init=levels, iterations=5).status.ok


def grey(problem, scene):
    return np.full(problem.op.shape, 0.5, problem.op.dtype)


def test_a_decoder_may_begin_by_name_as_a_function_or_as_an_object(scene, monkeypatch):
    """All the same first estimate; without noise all the same result."""
    monkeypatch.setitem(registry._registered["decoders"], "grey", lambda: grey)
    inits = "grey", grey, pnp_sci.as_decoder("grey")
    results = [solve(scene.y, scene.masks, init=init, iterations=4, noise=0.0) for init in inits]
    assert all(np.array_equal(result.x, results[0].x) for result in results)
    assert results[0].settings["init"] == "grey"
    assert not np.array_equal(results[0].x, solve(scene.y, scene.masks, iterations=4, noise=0.0).x)


def test_pixels_that_no_decoder_can_see_begin_as_their_neighbours(monkeypatch):
    """Single ones and large areas; in a mosaic as neighbours of the same colour."""

    def blind(problem, scene):
        return np.where(problem.op.gram > 0, problem.y / 3, 9.0) * np.ones(problem.op.shape)

    def begun(picture, seen, balance=None):
        op = pnp_sci.SensingOperator(np.ones((1, 3, 48, 48)) * seen)
        return first_estimate("blind", Problem(op, 3 * picture, 1.0, 0.0, balance=balance), full(op)).x

    monkeypatch.setitem(registry._registered["decoders"], "blind", lambda: blind)
    ramp, seen = np.ones((48, 1)) * np.linspace(0.4, 0.6, 48), np.ones((48, 48), bool)
    seen[2, 3] = seen[24, 5:7] = False
    x = begun(ramp, seen)
    np.testing.assert_allclose(x[..., seen], np.broadcast_to(ramp, x.shape)[..., seen], rtol=1e-12)
    np.testing.assert_allclose(x, np.broadcast_to(ramp, x.shape), atol=0.01)
    planes = np.kron([[0.9, 0.5], [0.2, 0.4]], np.ones((24, 24)))
    np.testing.assert_allclose(begun(planes, seen, np.ones((48, 48)))[0, 0], planes, atol=1e-6)
    seen[4:24, 10:30] = False
    assert np.abs(begun(ramp, seen) - 0.5).max() < 0.11
    assert not begun(ramp, False).any(), "there are no neighbours"


def test_a_function_sees_the_problem_and_the_scene(scene):
    """In the problem's units, and with what is modelled of the scene."""
    model, seen = SceneModel((True, False)), []

    def spy(problem, chosen):
        seen.append((problem, chosen))
        return grey(problem, chosen)

    result = solve(1000 * scene.y, scene.masks, init=spy, scene=model, iterations=1, noise=7.0)
    ((problem, chosen),) = seen
    assert chosen is model
    assert problem.op.shape == scene.masks.shape
    assert problem.unit == pytest.approx(result.settings["unit"][0])
    assert relative(problem.y * problem.unit, 1000 * scene.y) < 1e-6
    assert problem.typical_noise * problem.unit == pytest.approx(7.0)
    assert 0.5 < np.quantile(problem.y / scene.masks.sum((0, 1)).clip(1), 0.99) < 1.5


@pytest.mark.parametrize(("kind", "loaded", "start"), [
    ("strong", False, "adjoint"), ("strong", True, "ofanet-fast"), ("strong network", False, "ofanet-fast"),
])  # fmt: skip
def test_a_time_budget_is_not_spent_on_loading_torch(scene, monkeypatch, kind, loaded, start):
    """Unless the prior needs it anyway. Without a budget a strong prior waits for it."""
    from made_priors import Made

    monkeypatch.setitem(registry._registered["decoders"], "ofanet-fast", lambda: grey)
    for name in [name for name in sys.modules if name == "torch"]:
        monkeypatch.delitem(sys.modules, name)
    if loaded:
        monkeypatch.setitem(sys.modules, "torch", types.ModuleType("torch"))
    prior = Made(known=pnp_sci.Traits(strong=True, network="network" in kind))
    assert solve(scene.y, scene.masks, prior, time_budget=60, iterations=1).settings["init"] == start
    assert solve(scene.y, scene.masks, prior, iterations=1).settings["init"] == "ofanet-fast"


def test_without_torch_strong_priors_start_from_the_adjoint():
    """In a process that cannot import it; one with a time budget does not even try."""
    code = (
        "import sys, pnp_sci; s = pnp_sci.datasets.embedded_scene(48)\n"
        "r = pnp_sci.solve(s.y, s.masks, 'flow', time_budget=30, iterations=2)\n"
        "assert r.settings['init'] == 'adjoint'\n"
        "assert 'torch' not in sys.modules; sys.modules['torch'] = None\n"
        "for p in ('flow', 'bm3d', 'desci'):\n"
        "    assert pnp_sci.solve(s.y, s.masks, p, iterations=2).settings['init'] == 'adjoint', p\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("init", ["adjoint", "grey"])
def test_settings_name_the_first_estimate(scene, init, monkeypatch):
    monkeypatch.setitem(registry._registered["decoders"], "grey", lambda: grey)
    assert solve(scene.y, scene.masks, init=init, iterations=1).settings["init"] == init
    assert solve(scene.y, scene.masks, init="auto", iterations=1).settings["init"] == "adjoint"


def test_damaged_weights_are_told_and_not_passed_over(scene, monkeypatch):
    """With "auto", a decoder that has no weights for such masks is left out; one that cannot be read is an error."""

    def damaged():
        def decode(problem, scene):
            raise FormatError("weights cannot be read")

        return decode

    def unfit():
        def decode(problem, scene):
            raise InputError("no weights for such masks")

        return decode

    from made_priors import Made

    strong = Made(known=pnp_sci.Traits(strong=True))
    monkeypatch.setitem(registry._registered["decoders"], "ofanet-fast", unfit)
    assert solve(scene.y, scene.masks, strong, iterations=1).settings["init"] == "adjoint"
    monkeypatch.setitem(registry._registered["decoders"], "ofanet-fast", damaged)
    with pytest.raises(FormatError, match="cannot be read"):
        solve(scene.y, scene.masks, strong, iterations=1)


@pytest.mark.parametrize(
    ("init", "message"),
    [
        ("no such", "init is 'no such'.*auto, adjoint.*ofanet"),
        (np.ones((1, 2)), r"init has shape \(1, 2\)"),
        ([[1], [1, 2]], "init is no array of numbers"),
        (dict, "init is <class 'dict'>"),
        (lambda y: y, "init is <function"),
        (lambda problem, scene: problem.y, "init has shape"),
        (lambda problem, scene: None, "init is None: an array of real numbers"),
        (lambda problem, scene: np.full(problem.op.shape, np.nan), "init has .* NaN"),
    ],
)
def test_what_cannot_begin_is_named(scene, init, message):
    with pytest.raises((InputError, InputTypeError, UnknownPluginError), match=message):
        solve(scene.y, scene.masks, init=init, iterations=1)


def test_an_estimate_that_cancels_itself_is_not_used(scene, monkeypatch):
    """Large values of either sign measure y as well as others do."""
    op = pnp_sci.SensingOperator(scene.masks)
    wild = 30 * np.random.default_rng(0).standard_normal(op.shape).astype(np.float32)
    decode = lambda problem, _: problem.op.project(wild, problem.y)  # noqa: E731
    monkeypatch.setitem(registry._registered["decoders"], "wild", lambda: decode)
    result = solve(scene.y, scene.masks, init="wild", iterations=5)
    assert result.settings["init"] == "adjoint"
    assert "what 'wild' makes of y cancels itself" in result.remarks[0]
    assert np.array_equal(result.x, solve(scene.y, scene.masks, init="adjoint", iterations=5).x)


@pytest.mark.parametrize("prior", ["flow", "bm3d", "desci"])
def test_frames_that_no_pixel_sees_do_not_spoil_the_first_estimate(prior):
    """What a network makes of them is arbitrary; where nothing moves they would count in the mean of all frames."""
    pytest.importorskip("ofanet_init.decoder")
    masks = np.zeros((1, 4, 33, 40))
    masks[0, 0, 16, 20] = 1
    result = solve(np.random.default_rng(0).random((33, 40)), masks, prior)
    assert result.status.ok
    assert np.abs(result.x).max() < 2


def test_points_of_light_do_not_spoil_the_first_estimate():
    """The networks have not seen points ten times as bright as the rest."""
    pytest.importorskip("ofanet_init.decoder")
    dim = gaussian_filter(np.random.default_rng(0).random((96, 96)), 3)
    truth = np.repeat(0.1 * (dim - dim.min())[None, None] / np.ptp(dim), 8, 1).astype(np.float32)
    for i, j in np.random.default_rng(0).integers(4, 90, (4, 2)):
        truth[:, :, i, j] = 1
    masks = datasets.moving_masks(truth.shape, seed=3)
    y = pnp_sci.simulate(truth, masks)
    result = solve(y, masks, "video", scene="full")
    assert result.status.ok
    assert pnp_sci.psnr(result.x, truth) > 30
