"""decode(): a video from a decoder alone."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Sensor, Status, datasets, decode
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError
from pnp_sci.plugins import registry
from pnp_sci.scene import choose
from pnp_sci.sensing.scene_model import SceneModel


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


class Told:
    """A decoder that notes what it is told, and returns 0.5 everywhere."""

    def __init__(self, needs_scene):
        self.needs_scene, self.told = needs_scene, []

    def __call__(self, problem, scene):
        self.told.append((problem, scene))
        return np.full(problem.op.shape, 0.5, problem.op.dtype)


@pytest.fixture(scope="module")
def still(scene):
    return pnp_sci.simulate(np.repeat(scene.truth[:, :1], scene.masks.shape[1], 1), scene.masks)


def test_a_decoder_that_needs_the_scene_is_told_it(scene, still):
    told = Told(needs_scene=True)
    result = decode(np.stack([scene.y, still]), scene.masks, told)
    assert [model.nothing_moves for _, model in told.told] == [False, True]
    assert [one["still"] for one in result.scenes] == [False, True]
    asked = SceneModel((True, False))
    assert decode(scene.y, scene.masks, told, scene=asked).scene["views"] == (True, False)
    assert told.told[-1][1] is asked


def test_no_scene_is_looked_for_where_none_is_needed(scene, still, monkeypatch):
    monkeypatch.setattr(choose, "judge", lambda *given, **more: pytest.fail("the scene was judged"))
    reasons = []
    for needed, asked in ((False, "auto"), (False, SceneModel((True, False))), (False, "full"), (True, "full")):
        found = decode(still, scene.masks, Told(needs_scene=needed), scene=asked).scene
        assert not found["still"]
        reasons.append(found["reason"])
    assert reasons == [*["not judged: the decoder does not need it"] * 2, *["as asked for"] * 2]


@pytest.mark.parametrize(("noise", "expected"), [(0.25, 0.25), (Sensor(0.5), 0.5)])
def test_a_decoder_is_told_the_noise(scene, noise, expected):
    told = Told(needs_scene=False)
    result = decode(scene.y, scene.masks, told, noise=noise)
    problem, _ = told.told[0]
    assert problem.typical_noise * problem.unit == pytest.approx(expected)
    assert result.settings["noise"] == [pytest.approx(expected)]
    with pytest.raises(InputError, match="noise is -1"):
        decode(scene.y, scene.masks, told, noise=-1)


def test_the_result_is_in_the_users_units_and_says_so(scene):
    result = decode(np.stack([scene.y, 10 * scene.y]), scene.masks, Told(needs_scene=False))
    assert result.status is Status.DECODED
    assert [record.iteration for record in result.history] == [0, 0]
    op = pnp_sci.SensingOperator(scene.masks)
    for x, y, unit, record in zip(result.x, (scene.y, 10 * scene.y), result.settings["unit"], result.history):
        np.testing.assert_allclose(x, 0.5 * unit, rtol=1e-6)
        expected = np.linalg.norm(y - op.forward(x)) / np.linalg.norm(y)
        assert record.residual == pytest.approx(expected, rel=1e-4)
    assert result.settings["unit"][1] == pytest.approx(10 * result.settings["unit"][0], rel=1e-5)


def test_a_registered_decoder_takes_its_options(scene, monkeypatch):
    monkeypatch.setattr(registry, "_registered", {"priors": {}, "decoders": {}})
    pnp_sci.register_decoder("level", lambda grey=0.5: lambda problem, scene: np.full(problem.op.shape, grey))
    result = decode(scene.y, scene.masks, "level", grey=0.25)
    assert result.x.max() == pytest.approx(0.25 * result.settings["unit"][0])
    assert (result.settings["model"], result.settings["model_options"]) == ("level", {"grey": 0.25})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_decoder_that_fails_is_told(scene, value):
    result = decode(scene.y, scene.masks, lambda problem, scene: np.full(problem.op.shape, value))
    assert result.status is Status.NOT_FINITE
    assert not result.x.any()
    assert result.history[-1].residual == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": "no such"}, "model is 'no such': .*ofanet"),
        ({"model": "adjoint"}, "model is 'adjoint': .*ofanet"),
        ({"model": 3}, "model is 3"),
        ({"model": lambda problem, scene: problem.y}, "what the decoder returns has shape"),
        ({"model": "ofanet", "no_option": 1}, "'ofanet'.*no_option"),
        ({"scene": "half"}, "scene is 'half'"),
        ({"y": np.ones((3, 3))}, "but y is 3 x 3"),
    ],
)
def test_errors_name_the_argument(scene, arguments, message):
    given = {"y": scene.y, "masks": scene.masks, "model": Told(needs_scene=False)} | arguments
    with pytest.raises((InputError, InputTypeError, UnknownPluginError), match=message):
        decode(**given)
