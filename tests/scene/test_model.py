"""What is modelled of a scene, and what the result tells of it."""

import numpy as np
import pytest

from pnp_sci import SceneModel, SensingOperator, datasets, solve
from pnp_sci.errors import InputError, InputTypeError


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def test_one_answer_or_one_for_each_view():
    assert SceneModel((True, True), True) == SceneModel((1, 1), (1, 1))
    assert SceneModel((True, False), (True, False)).nothing_moves  # of what there is
    assert SceneModel((True, True), (False, False)).complete
    with pytest.raises(InputError, match="still has 1 values: 2 were expected"):
        SceneModel((True, True), (True,))
    with pytest.raises(InputTypeError, match="still is 7"):
        SceneModel((True, True), 7)


def test_views_are_no_indices(scene):
    assert SceneModel((1, 0)).views == (True, False)  # type: ignore[arg-type]
    for values in ((2, 0), ("yes", "no")):
        with pytest.raises(InputTypeError, match=r"views is .*a tuple of bool"):
            SceneModel(values)
    with pytest.raises(InputTypeError, match="views is 3"):
        SceneModel(3)  # type: ignore[arg-type]


MODELS = {
    "complete": SceneModel((True, True, True)),
    "dark": SceneModel((True, False, True)),
    "still": SceneModel((True, True, True), True),
    "dark and still": SceneModel((False, True, True), True),
    "one still": SceneModel((True, True, True), (False, True, False)),
    "dark and one still": SceneModel((True, False, True), (False, False, True)),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_is_modelled_measures_as_the_whole(model):
    """Of a video that the model shows, the reduced operator measures the same, and nothing is lost."""
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random((3, 4, 6, 5)), np.float64)
    x = rng.random(op.shape) * np.array(model.views)[:, None, None, None]
    still = np.array(model.still)
    x[still] = x[still][:, :1]
    reduced = model.reduce(op)
    kept = model.restrict(x)
    assert kept.shape == reduced.shape
    np.testing.assert_allclose(reduced.forward(kept), op.forward(x), atol=1e-12)
    np.testing.assert_allclose(model.expand(kept, op.shape), x, atol=1e-12)
    assert model.describe(op)["frames"] == 12


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_any_estimate_becomes_one_that_the_model_shows(model):
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random((3, 4, 6, 5)), np.float64)
    x = model.expand(rng.random(model.reduce(op).shape), op.shape)
    assert not x[~np.array(model.views)].any()
    for view, still in zip(x, model.still):
        if still:
            np.testing.assert_allclose(view, np.broadcast_to(view.mean(0), view.shape))


def test_a_model_by_hand(scene):
    result = solve(scene.y, scene.masks, scene=SceneModel((True, False)), iterations=5)
    assert not result.x[1].any()
    assert result.x[0].any()


@pytest.mark.parametrize("bad", ["half", 3, SceneModel((True,)), SceneModel((False, False))])
def test_errors_name_the_scene(scene, bad):
    with pytest.raises(InputError, match="scene"):
        solve(scene.y, scene.masks, scene=bad)


def test_what_stands_still_is_said_of_each_view(scene):
    """Of a dark view nothing is known, nor of one that is modelled by one frame, nor by priors that do not look."""
    for model, known in (
        (SceneModel((False, True)), (False, True)),
        (SceneModel((True, True), (True, False)), (False, True)),
        (SceneModel((True, True), True), (False, False)),
        (SceneModel((True, True)), (True, True)),
    ):
        y = np.stack([scene.y, 0.9 * scene.y])
        for one in solve(y, scene.masks, "tv", scene=model, iterations=41).scenes:
            assert [part is not None for part in one["at_rest"]] == list(known)
    assert solve(scene.y, scene.masks, "wavelet", scene="full", iterations=1).scene["at_rest"] == [None, None]
    joint = solve(scene.y, scene.masks, "wavelet+tv", scene="full", iterations=41, tol=0)
    assert all(0 <= part < 1 for part in joint.scene["at_rest"])
