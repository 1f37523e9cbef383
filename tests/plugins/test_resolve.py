"""What stands for a prior or a decoder, and one call of a prior."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_priors import Made

import pnp_sci
from pnp_sci import Decoder, Prior
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import FunctionPrior, Joint, Stages
from pnp_sci.plugins.resolve import FunctionDecoder
from priors.tv import TV
from priors.wavelet import Wavelet


def halve(x, sigma):
    return x / 2


@pytest.mark.parametrize(
    ("thing", "expected"),
    [
        ("tv", TV()),
        (TV(inner=3), TV(inner=3)),
        ("tv + wavelet", Joint([TV(), Wavelet()])),
        ([("tv", 3), (halve, 2)], Stages([(TV(), 3), (FunctionPrior(halve), 2)])),
        ([("tv+wavelet", 1)], Stages([(Joint([TV(), Wavelet()]), 1)])),
        (halve, FunctionPrior(halve)),
    ],
    ids=["name", "prior", "names", "stages", "names in a stage", "function"],
)
def test_what_stands_for_a_prior(thing, expected):
    prior = pnp_sci.as_prior(thing)
    assert isinstance(prior, Prior)
    assert prior == expected
    assert pnp_sci.as_prior(prior) is prior


@pytest.mark.parametrize(
    ("prior", "option"),
    [
        ("tv", "isotropic"),
        ("tv", "still"),
        ("flow", "still"),
        ("flow", "displace"),
        ("desci", "motion"),
        ("desci", "exact"),
    ],
)
@pytest.mark.parametrize("value", ["no", "x", 1, None])
def test_what_is_true_or_false_is_not_taken_by_its_truth_value(prior, option, value):
    with pytest.raises(InputError, match=f"{option} is {value!r}: True or False"):
        pnp_sci.as_prior(prior, **{option: value})
    assert pnp_sci.as_prior(prior, **{option: np.False_}) == pnp_sci.as_prior(prior, **{option: False})


@pytest.mark.parametrize(
    ("prior", "option"),
    [("tv", "strength"), ("wavelet", "strength"), ("wavelet", "levels"), ("flow", "tolerance"), ("desci", "beside")],
)
@pytest.mark.parametrize("value", ["2", None, [2]])
def test_numbers_are_numbers(prior, option, value):
    with pytest.raises(InputError, match=rf"{option} is .*: a .*(number|whole number).* was expected"):
        pnp_sci.as_prior(prior, **{option: value})


def test_options_reach_the_priors_that_take_them():
    assert pnp_sci.as_prior("tv+wavelet", strength=0.7, shifts=2) == Joint([TV(0.7), Wavelet(0.7, shifts=2)])
    assert pnp_sci.as_prior("wavelet", seed=5).seed == 5
    with pytest.raises(InputError, match="prior 'tv' takes no option shifts, side"):
        pnp_sci.as_prior("tv", shifts=2, side=3)


@pytest.mark.parametrize("thing", [None, 3, TV, dict, len, [], [("tv",)], [3], ["tv", "ab"], lambda x: x, object()])
def test_what_stands_for_none(thing):
    with pytest.raises(InputTypeError, match=r"prior is .* was expected"):
        pnp_sci.as_prior(thing)


@pytest.mark.parametrize("calls", [0, -1, 2.5, "many"])
def test_a_stage_has_a_whole_number_of_iterations(calls):
    with pytest.raises(InputError, match="iterations of a stage of prior is"):
        pnp_sci.as_prior([("tv", 1), ("wavelet", calls)])


def test_a_function_of_no_signature_is_taken():
    assert isinstance(pnp_sci.as_prior(np.multiply), FunctionPrior)


def test_what_has_no_sessions_is_no_prior():
    for thing in (len, halve, object(), "tv", lambda x, sigma: x):
        assert not isinstance(thing, Prior)
    assert isinstance(Made(), Prior)


# ---- one call --------------------------------------------------------------------------------------------------------


@given(dtype=st.sampled_from(["f2", "f4", "f8", ">f4", "u1", "i8", "?"]), order=st.sampled_from("CF"))
def test_denoise_takes_any_numbers_and_returns_a_new_array(dtype, order):
    x = np.asarray(np.random.default_rng(0).integers(0, 2, (2, 3, 6, 5)), dtype, order=order)
    before = x.copy()
    for prior in ("none", halve, lambda v, sigma: v.tolist()):
        out = pnp_sci.denoise(x, 0.1, prior)
        assert out.dtype == (np.float64 if dtype == "f8" else np.float32)
        assert not np.shares_memory(out, x)
    assert np.array_equal(x, before)
    np.testing.assert_array_equal(pnp_sci.denoise(x, 0.1, halve), before.astype(out.dtype) / 2)


def test_denoise_makes_no_use_of_the_warm_up():
    warmed = Made(halve, known=pnp_sci.Traits(warmup=(Made(), 30)))
    assert pnp_sci.denoise(np.ones((1, 1, 4, 4)), 0.1, warmed).max() == 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.ones((4, 4))}, r"x has shape \(4, 4\)"),
        ({"x": np.ones((1, 0, 4, 4))}, r"x has shape \(1, 0, 4, 4\)"),
        ({"x": np.ones((1, 1, 4, 4), complex)}, "x has dtype complex"),
        ({"x": np.full((1, 1, 4, 4), np.nan)}, "x has 16 values that are NaN"),
        ({"sigma": -1}, "sigma is -1"),
        ({"sigma": float("nan")}, "sigma is nan"),
        ({"sigma": "loud"}, "sigma is 'loud'"),
        ({"prior": "no such"}, "prior is 'no such'"),
        ({"prior": lambda x, sigma: x[0]}, "what the prior returns has shape"),
        ({"strength": -1}, "strength is -1"),
    ],
)
def test_denoise_names_the_argument(change, message):
    with pytest.raises((InputError, InputTypeError), match=message):
        pnp_sci.denoise(**({"x": np.ones((1, 1, 4, 4)), "sigma": 0.1, "prior": "tv"} | change))


# ---- decoders --------------------------------------------------------------------------------------------------------


class Constant:
    """A decoder of one grey level, which asks for no scene."""

    needs_scene = False

    def __call__(self, problem, scene):
        return np.full(problem.op.shape, 0.5, problem.op.dtype)


def test_what_stands_for_a_decoder():
    constant = Constant()
    assert isinstance(constant, Decoder)
    assert pnp_sci.as_decoder(constant) is constant
    made = pnp_sci.as_decoder(lambda problem, scene: np.zeros(problem.op.shape))
    assert isinstance(made, FunctionDecoder)
    assert made.needs_scene, "a function may make use of the scene"


@pytest.mark.parametrize("thing", [None, 3, Constant, dict, lambda y: y, [], object()])
def test_what_stands_for_no_decoder(thing):
    with pytest.raises(InputTypeError, match=r"is .*: a name or a callable"):
        pnp_sci.as_decoder(thing)


def test_options_of_a_decoder_go_with_its_name(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {"priors": {}, "decoders": {}})
    pnp_sci.register_decoder("constant", lambda grey=0.5: lambda problem, scene: np.full(problem.op.shape, grey))
    scene = pnp_sci.datasets.embedded_scene(16)
    result = pnp_sci.decode(scene.y, scene.masks, "constant", grey=0.25)
    assert np.ptp(result.x) == 0
    with pytest.raises(InputError, match=r"'constant'.*no_option"):
        pnp_sci.as_decoder("constant", no_option=3)
    with pytest.raises(InputError, match="options grey: the name of a decoder was expected"):
        pnp_sci.as_decoder(Constant(), grey=0.25)


def test_an_unknown_decoder_is_named_with_those_there_are():
    with pytest.raises(UnknownPluginError, match=r"'no such'.*ofanet"):
        pnp_sci.as_decoder("no such")
