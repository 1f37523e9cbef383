"""Arguments that cannot be used: the error names them, what came and what was expected."""

from pathlib import Path

import numpy as np
import pytest

import pnp_sci
from pnp_sci import datasets, solve
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": np.ones((63, 64))}, "masks has 2 x 10 frames of 64 x 64, but y is 63 x 64"),
        ({"y": np.ones(5)}, "y has shape"),
        ({"y": np.ones((64, 64, 1))}, r"y has shape \(64, 64, 1\).*rows and columns last"),
        ({"y": np.ones((64, 64, 3))}, r"y has shape \(64, 64, 3\).*rows and columns last.*mosaic="),
        ({"y": "meas.mat"}, "y is 'meas.mat': an array .*read_measurement"),
        ({"masks": Path("masks.mat")}, "masks is PosixPath|masks is WindowsPath.*read_masks"),
        ({"y": None}, "y is None: an array"),
        ({"y": np.array([["a"]])}, "y has dtype"),
        ({"masks": np.ones((2, 2))}, "masks has shape"),
        ({"prior": "no such"}, "prior is 'no such'.*auto, none.*tv.*wavelet"),
        ({"prior": 3}, "prior is 3"),
        ({"algorithm": "no such"}, "algorithm is 'no such'.*gap.*admm"),
        ({"noise": -1}, "noise is -1"),
        ({"noise": "loud"}, "noise is 'loud'"),
        ({"iterations": 0}, "iterations is 0"),
        ({"iterations": 10**20}, "iterations is 1000.*a whole number from 1 to"),
        ({"tol": -1}, "tol is -1"),
        ({"tol": float("nan")}, "tol is nan"),
        ({"no_option": 3}, "takes no option no_option"),
        ({"strength": -1.0}, "strength is -1"),
        ({"reference": np.ones(3)}, "reference has shape"),
        ({"reference": np.ones((10, 2, 64, 64))}, r"reference has shape \(10, 2, 64, 64\)"),
        ({"reference": np.ones((2, 10, 64, 64), int)}, "reference has dtype int64: floats in .*uint8 or uint16"),
        ({"prior": "auto+tv"}, "prior is 'auto'.*not in a combination.*tv, video"),
        ({"prior": [("tv", 1), ("auto", 1)]}, "prior is 'auto'.*not in a combination.*tv, video"),
        ({"y": [[1], [1, 2]]}, "y is no array of numbers"),
        ({"masks": [[1], [1, 2]]}, "masks is no array of numbers"),
        ({"reference": "text"}, "reference is 'text': an array.*read_video"),
        ({"prior": lambda x: x}, r"prior is <function.*which takes \(x\)"),
        ({"sigma": np.ones(3000)}, r"sigma is an array \(3000,\) of float64: a finite"),
        ({"prior": dict}, "prior is <class 'dict'>"),
        ({"prior": lambda x, sigma: None}, "what the prior returns is None: an array"),
        ({"prior": lambda x, sigma: x[0]}, "what the prior returns has shape"),
        ({"strength": "much"}, "strength is 'much': a finite number > 0"),
        ({"isotropic": "no"}, "isotropic is 'no': True or False"),
        ({"algorithm": ["gap"]}, r"algorithm is \['gap'\]"),
        ({"scene": np.ones(3)}, "scene is array"),
        ({"sigma": 10**400}, "sigma is 1000"),
        ({"noise": np.complex64(1)}, "noise is"),
        ({"tol": None}, "tol is None"),
        ({"seed": -1}, "seed is -1"),
        ({"callback": 3}, "callback is 3"),
        ({"progress": np.ones(3)}, "progress is"),
        ({"device": 3}, "device is 3"),
    ],
)
def test_errors_name_the_argument(scene, change, message):
    arguments = {"y": scene.y, "masks": scene.masks, **change}
    with pytest.raises((InputError, InputTypeError, UnknownPluginError), match=message):
        solve(**arguments)


@pytest.mark.parametrize(("sigma", "told"), [(25, True), (1.0, False), (0.05, False), (None, False)])
def test_a_sigma_in_grey_levels_is_noticed(scene, caplog, sigma, told):
    """sigma is in units where x spans [0, 1], whatever the units of y are."""
    remarks = solve(scene.y * 255, scene.masks, sigma=sigma, iterations=1).remarks
    assert any("sigma is 25" in remark for remark in remarks) == told
    assert any("sigma is 25" in message and "0.098" in message for message in caplog.messages) == told


def test_non_finite_input_is_counted(scene):
    y = scene.y.copy()
    y[3, 4] = y[5, 6] = np.nan
    with pytest.raises(InputError, match=r"y has 2 values .* first at index \(3, 4\)"):
        solve(y, scene.masks)
    masks = scene.masks.astype(np.float32)
    masks[1, 2, 3, 4] = np.inf
    with pytest.raises(InputError, match=r"masks has 1 values .* \(1, 2, 3, 4\)"):
        solve(scene.y, masks)


@pytest.mark.parametrize("swapped", [True, False])
def test_frames_given_as_views_are_noticed(scene, caplog, swapped):
    """Ten views of two frames are solved, but it is said that they may be two views of ten."""
    masks = scene.masks.swapaxes(0, 1) if swapped else scene.masks
    remarks = solve(scene.y, masks, iterations=1).remarks
    for texts in (remarks, caplog.messages):
        assert any("10 views of 2 frames" in text and "swapaxes" in text for text in texts) == swapped


def test_settings_can_be_given_again(scene):
    """What a result says of `sequence` is what solves so again."""
    alone = solve(scene.y, scene.masks, iterations=2)
    again = solve(scene.y, scene.masks, iterations=2, sequence=alone.settings["sequence"])
    assert (again.x == alone.x).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda op, y: pnp_sci.estimate_noise(op, y, light="auto"), "light is 'auto': an array"),
        (lambda op, y: pnp_sci.estimate_noise(op, y, light=np.ones(3)), r"light has shape \(3,\): \(2, 10, 1, 1\)"),
        (lambda op, y: pnp_sci.estimate_noise(op, y, light=np.full((2, 10, 1, 1), np.nan)), "light has 20 values"),
        (lambda op, y: pnp_sci.adjoint_mismatch(op, seed=-1), "seed is -1: a whole number >= 0"),
        (lambda op, y: pnp_sci.adjoint_mismatch(op, seed="a"), "seed is 'a': a whole number"),
        (lambda op, y: pnp_sci.random_masks(np.array(3)), r"shape is array\(3\): \(views"),
        (lambda op, y: pnp_sci.moving_masks(np.array(3)), r"shape is array\(3\): \(views"),
        (lambda op, y: pnp_sci.SequenceOperator(np.array(3)), r"parts is array\(3\): a sequence"),
        (lambda op, y: pnp_sci.check_fit(y, op, frame_order="no"), "frame_order is 'no': True or False"),
        (lambda op, y: pnp_sci.check_fit(y, op, frame_order=np.ones(3)), "frame_order is array"),
        (lambda op, y: pnp_sci.register(y, op, each_view=np.ones(3)), "each_view is array"),
        (lambda op, y: pnp_sci.psnr(op.masks, op.masks, peak=5e-324), "reference spans 0 to 1: values"),
    ],
)
def test_errors_of_other_functions_name_the_argument(scene, call, message):
    with pytest.raises((InputError, InputTypeError), match=message):
        call(pnp_sci.SensingOperator(scene.masks), scene.y)


def test_a_module_that_takes_no_sigma_is_no_prior(scene):
    torch = pytest.importorskip("torch")
    for module in (torch.nn.Identity(), torch.nn.Conv2d(1, 1, 3)):
        with pytest.raises(InputTypeError, match=r"prior is .*which takes \(input"):
            pnp_sci.denoise(scene.truth, 0.1, module)
        with pytest.raises(InputTypeError, match=r"model is .*which takes \(input"):
            pnp_sci.decode(scene.y, scene.masks, model=module)
    for operator, dtype in (
        (pnp_sci.SensingOperator, torch.tensor(2)),
        (pnp_sci.TorchSensingOperator, np.ones(3)),
    ):
        with pytest.raises(InputTypeError, match="dtype is "):
            operator(scene.masks, dtype=dtype)


@pytest.mark.parametrize(
    "call",
    [
        lambda a: next(pnp_sci.iterate(a, a[0, 0], "tv", a)),
        lambda a: pnp_sci.denoise(a, a, "tv"),
        lambda a: pnp_sci.random_masks(a),
        lambda a: pnp_sci.recommend(1.0, like=a),
        lambda a: pnp_sci.adjoint_mismatch(a),
        lambda a: pnp_sci.citations(a),
        lambda a: pnp_sci.SensingOperator(a, dtype=a),
        lambda a: pnp_sci.as_prior([a, a, a]),
    ],
)
def test_a_message_does_not_print_arrays(call):
    with pytest.raises((InputError, InputTypeError)) as raised:
        call(np.ones((2, 10, 64, 64), np.float32))
    assert len(str(raised.value)) < 300
