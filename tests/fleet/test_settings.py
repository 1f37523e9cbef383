"""What tells one run from another: equal settings for equal results, other settings for other results."""

import functools
from dataclasses import InitVar, dataclass
from pathlib import Path

import numpy as np
import pytest
from small import FAST, capture

import pnp_sci
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.fleet.settings import plain, settings_of
from pnp_sci.fleet.source import open_source

Y, MASKS = capture()


def scaled(factor):
    """Two priors of one name."""
    return lambda x, sigma: factor * x


def named(x, sigma):
    return 0.9 * x


@dataclass(frozen=True)
class Scaled:
    factor: float

    def __call__(self, x, sigma):
        return self.factor * x

    def method(self, x, sigma):
        return self.factor * x


class Other:
    def __call__(self, x, sigma):
        return x


@pytest.mark.parametrize(
    "prior", [scaled(0.5), lambda x, sigma: x, Scaled(0.5).method, functools.partial(named, sigma=1), Other()]
)
def test_what_its_name_does_not_describe_is_refused(prior):
    for value in (prior, [("tv", 3), (prior, 2)], {"inner": prior}):
        with pytest.raises(InputTypeError, match=r"prior is .*: .* give a dataclass instead"):
            plain("prior", value)


def test_it_is_refused_before_any_work(tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(InputTypeError, match="give a dataclass instead"):
        pnp_sci.reconstruct(Y, MASKS, tmp_path / "v.zarr", prior=scaled(0.5), iterations=3)
    assert not list(tmp_path.iterdir())


ARRAY = np.arange(8, dtype=np.float32)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Scaled(0.5), Scaled(0.6)),
        (named, scaled),
        (ARRAY, ARRAY[::-1]),
        (ARRAY, ARRAY.reshape(2, 4)),
        (ARRAY, ARRAY.view(np.int32)),
        (Scaled(1.0), Scaled(float("inf"))),
    ],
)
def test_different_values_differ(one, other):
    assert plain("prior", one) == plain("prior", one)
    assert plain("prior", one) != plain("prior", other)


@pytest.mark.parametrize("kind", [str, Path, Scaled])
def test_files_are_known_by_their_content(tmp_path, kind):
    weights = tmp_path / "net.safetensors"
    absent = plain("weights", kind(str(weights)))
    weights.write_bytes(b"first")
    first = plain("weights", kind(str(weights)))
    weights.write_bytes(b"other")
    other = plain("weights", kind(str(weights)))
    weights.write_bytes(b"first")
    assert plain("weights", kind(str(weights))) == first
    assert absent != first != other != absent


def test_other_weights_are_refused(client, tmp_path):
    file, out = tmp_path / "net.safetensors", tmp_path / "v.zarr"
    file.write_bytes(b"first")
    assert pnp_sci.reconstruct(Y, MASKS, out, client, prior=Weighed(file), iterations=3).ok
    file.write_bytes(b"other")
    with pytest.raises(InputError, match="options prior"):
        pnp_sci.reconstruct(Y, MASKS, out, client, prior=Weighed(file), iterations=3)


NONE = np.float32("nan")


@dataclass(frozen=True)
class Weighed:
    weights: Path
    most: float = float("inf")
    least: np.float32 = NONE

    def __call__(self, x, sigma):
        return 0.9 * x


def test_a_number_that_json_does_not_have_is_no_change(client, tmp_path):
    options = {"prior": Weighed(Path("none")), "iterations": 3}
    for _ in range(2):
        assert pnp_sci.reconstruct(Y, MASKS, tmp_path / "v.zarr", client, **options).ok


def test_arguments_of_a_dataclass_that_are_no_attributes_are_left_out():
    @dataclass
    class Made:
        factor: float
        half: InitVar[bool]

        def __post_init__(self, half):
            self.factor /= 1 + half

    assert plain("prior", Made(1.0, True)) == plain("prior", Made(0.5, False)) != plain("prior", Made(1.0, False))


def test_modules_are_known_by_weights_structure_and_attributes():
    torch = pytest.importorskip("torch")

    class Net(torch.nn.Module):
        def __init__(self, strength=1.0, weight=0.5, kernel=3, dtype=torch.float32, kept=None):
            super().__init__()
            self.strength, self.kept = strength, kept
            self.register_buffer("window", torch.tensor(2.0), persistent=False)
            self.inner = torch.nn.Conv2d(1, 1, kernel, padding="same", dtype=dtype)
            with torch.no_grad():
                for parameter in self.parameters():
                    parameter.fill_(weight)

    same = plain("prior", Net())
    assert plain("prior", Net()) == same
    assert plain("prior", Net(kept=object())) == plain("prior", Net(kept=object()))  # JSON has none: it is left out
    others = [Net(strength=2.0), Net(weight=0.25), Net(kernel=1), Net(dtype=torch.bfloat16), Net(dtype=torch.float64)]
    others.append(Net())
    others[-1].inner.padding_mode = "reflect"
    others.append(Net())
    others[-1].window.fill_(3)
    texts = [str(plain("prior", net)) for net in others]
    assert len({*texts, str(same)}) == len(others) + 1


def test_torch_is_among_the_versions():
    torch = pytest.importorskip("torch")
    settings = settings_of(open_source(Y), MASKS, None, FAST)
    assert settings["versions"]["torch"] == torch.__version__
