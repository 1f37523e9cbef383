"""What the solver knows of a prior comes from its traits alone: no name and no type of object counts."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from operators_and_priors import by_name, learned

import pnp_sci
from pnp_sci import as_prior, datasets
from pnp_sci.plugins.combine import FunctionSession
from pnp_sci.plugins.protocols import Prior, Traits
from priors.ffdnet import FFDNet
from priors.tv import TV

SHAPE = (2, 10, 64, 64)


def halved(x, sigma):
    return x / (1 + sigma)


@dataclass(frozen=True)
class Theirs(Prior):
    """A prior of somebody else, that says of itself what it is given."""

    known: Traits = field(default_factory=Traits)

    def traits(self, shape):
        return self.known

    def begin(self, shape, dtype):
        return FunctionSession(halved)


PLAIN = [
    "tv",
    "wavelet",
    "tv+wavelet",
    halved,
    Theirs(),
    Theirs(Traits(network=True)),
    TV(),
    [("tv", 3), (Theirs(), 4)],
]
NAMES = ["tv", "wavelet", "tv+wavelet", "a function", "a third party's", "a weak network", "an object", "stages"]


@pytest.fixture(scope="module")
def case():
    scene = datasets.embedded_scene(64)
    return scene.y, scene.masks


@pytest.mark.parametrize("prior", PLAIN, ids=NAMES)
def test_what_is_plain_says_so_and_starts_from_the_adjoint(prior, case):
    assert not as_prior(prior).traits(SHAPE).strong
    assert pnp_sci.solve(*case, prior, iterations=1).settings["init"] == "adjoint"


@pytest.mark.parametrize(
    "prior",
    [
        by_name("ffdnet"),
        by_name("video"),
        learned("flow", name="no network"),
        learned("video+tv", name="beside a classical one"),
        learned(FFDNet(), name="an object", weights="ffdnet"),
        learned(Theirs(Traits(strong=True)), name="a third party's"),
    ],
)
def test_what_is_strong_starts_from_a_decoder(prior, case):
    assert as_prior(prior).traits(SHAPE).strong
    assert pnp_sci.solve(*case, prior, iterations=1).settings["init"] == "ofanet-fast"


def test_a_module_of_torch_is_as_plain_as_a_function(case):
    torch = pytest.importorskip("torch")

    class Halved(torch.nn.Module):
        def forward(self, x, sigma):
            return x / (1 + sigma)

    assert as_prior(Halved()).traits(SHAPE) == as_prior(halved).traits(SHAPE)
    module, function = (pnp_sci.solve(*case, p, iterations=5) for p in (Halved(), halved))
    assert module.settings["init"] == "adjoint"
    np.testing.assert_allclose(module.x, function.x, atol=1e-5)


@pytest.mark.parametrize("effort", ["fast", "balanced", "best"])
def test_plain_priors_have_the_same_number_of_iterations(case, effort):
    counts = {
        pnp_sci.solve(*case, prior, effort=effort, callback=lambda state: True).settings["iterations"]
        for prior in ("tv", "tv+wavelet", halved, Theirs(), TV())
    }
    assert len(counts) == 1


def test_what_is_strong_has_fewer_iterations_whoever_wrote_it(case):
    plain, strong = (
        pnp_sci.solve(*case, Theirs(traits), callback=lambda state: True, scene="full").settings["iterations"]
        for traits in (Traits(), Traits(strong=True))
    )
    assert strong < plain


def test_a_warmup_serves_first_and_while_sigma_is_large(case):
    """Whatever its prior is: three calls, and one more of sigma 0.2; what follows is of the prior itself."""
    told = []

    def seen(name):
        return as_prior(lambda x, sigma: told.append(name) or x)

    @dataclass(frozen=True)
    class Warm(Theirs):
        def begin(self, shape, dtype):
            return seen("prior").begin(shape, dtype)

    warm = Warm(Traits(warmup=(seen("warm-up"), 3), serves_below=0.1))
    pnp_sci.solve(*case, warm, iterations=5, sigma=0.05, scene="full")
    assert told == ["warm-up"] * 3 + ["prior"] * 2
    told.clear()
    pnp_sci.solve(*case, warm, iterations=5, sigma=0.2, scene="full")
    assert told == ["warm-up"] * 5


def test_estimates_are_averaged_where_the_prior_asks_for_it(case):
    """Of a prior that jumps from call to call; the last estimate lies between those of the last two calls."""

    class Jumps(Theirs):
        def begin(self, shape, dtype):
            calls = iter(range(1000))
            return FunctionSession(lambda x, sigma: np.full_like(x, next(calls) % 2))

    one, mean = (
        pnp_sci.solve(*case, Jumps(Traits(average=average)), iterations=6, scene="full", tol=0).x
        for average in (False, True)
    )
    assert np.ptp(one) == 0
    assert np.ptp(mean) < 1e-6
    assert 0.2 < mean.mean() / one.mean() < 0.8
