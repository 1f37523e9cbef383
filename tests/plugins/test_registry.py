"""Priors and decoders by name."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest

import pnp_sci
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError
from pnp_sci.plugins import registry


@pytest.fixture(autouse=True)
def _forget(monkeypatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(registry, "_registered", {"priors": {}, "decoders": {}})


BAD = [
    ("auto", dict, "name is 'auto'"),
    ("a+b", dict, "name is 'a\\+b'"),
    ("a:3", dict, "name is 'a:3'"),
    ("a,b", dict, "name is 'a,b'"),
    ("", dict, "name is ''"),
    (3, dict, "name is 3"),
    ("three", 3, "{kind} is 3"),
]


@pytest.mark.parametrize(("name", "factory", "message"), BAD)
@pytest.mark.parametrize("kind", ["prior", "decoder"])
def test_a_plugin_whose_name_cannot_be_reached_is_not_registered(kind, name, factory, message):
    register = {"prior": pnp_sci.register_prior, "decoder": pnp_sci.register_decoder}[kind]
    with pytest.raises((InputError, InputTypeError), match=message.format(kind=kind)):
        register(name, factory)


def test_built_in_names_are_taken():
    with pytest.raises(InputError, match="auto and none"):
        pnp_sci.register_prior("none", dict)
    with pytest.raises(InputError, match="auto and adjoint"):
        pnp_sci.register_decoder("adjoint", dict)


def test_what_is_registered_is_found_and_made_from_options():
    pnp_sci.register_prior("over", lambda by=2: lambda x, sigma: x / by)
    assert "over" in registry.available("priors")
    assert "over" not in registry.available("decoders")
    x = np.ones((1, 1, 4, 4))
    assert pnp_sci.denoise(x, 0.1, "over").max() == 0.5
    assert pnp_sci.denoise(x, 0.1, "over", by=4).max() == 0.25


def test_a_registered_prior_goes_before_an_installed_one():
    pnp_sci.register_prior("tv", lambda: lambda x, sigma: 0 * x)
    assert not pnp_sci.denoise(np.ones((1, 1, 4, 4)), 0.1, "tv").any()


@pytest.mark.parametrize(
    ("missing", "command"), [("safetensors.torch", r'pip install "\.\[learned\]"'), ("cupy", "pip install cupy")]
)
def test_a_plugin_that_lacks_a_module_says_how_to_get_it(monkeypatch, missing, command):
    def load(self):
        raise ModuleNotFoundError(f"No module named {missing!r}", name=missing)

    monkeypatch.setattr(EntryPoint, "load", load)
    with pytest.raises(UnknownPluginError, match=rf"prior 'tv' needs the module '{missing}'.*{command}"):
        pnp_sci.as_prior("tv")


def test_unknown_names_are_listed_with_those_there_are():
    with pytest.raises(UnknownPluginError, match=r"prior is 'no such'.*auto, none.*tv.*wavelet"):
        registry.load("priors", "no such")


@pytest.mark.parametrize(("kind", "argument"), [("prior", "prior"), ("decoder", "init")])
def test_a_plugin_itself_in_place_of_its_factory_is_explained(monkeypatch, kind, argument):
    monkeypatch.setitem(registry._registered, f"{kind}s", {})
    getattr(pnp_sci, f"register_{kind}")("mine", lambda first, second: first)
    with pytest.raises(InputTypeError, match=f"{kind} 'mine' needs first and second.*as lambda: my_{kind} does"):
        pnp_sci.solve(np.ones((8, 8)), np.ones((1, 2, 8, 8)), **{argument: "mine"})
