"""Strong priors: how many of their calls noise leaves of use."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci import datasets
from pnp_sci.plugins.protocols import Prior, Traits
from pnp_sci.solvers.schedule import Schedule
from priors.tv import TV


@dataclass(frozen=True)
class Other(Prior):
    """Total variation frame by frame, that says more of itself."""

    known: Traits = field(default_factory=Traits)

    def traits(self, shape):
        return self.known

    def begin(self, shape, dtype):
        return TV(time=0).begin(shape, dtype)


@given(noisy=st.floats(0.05, 1), noisier=st.floats(1, 3), fast=st.integers(1, 30), most=st.integers(1, 300))
def test_noise_leaves_fewer_calls_of_use(noisy, noisier, fast, most):
    """But not fewer than the fast effort makes."""
    less, more = (Schedule(0.1, sigma).enough(fast, most) for sigma in (noisy, noisy * noisier))
    assert min(most, fast) <= more <= less <= most
    assert Schedule(0.1, 1e3).enough(fast, most) == min(most, fast)


@pytest.mark.parametrize("sigma", [0, 0.05, 0.1])
def test_without_noise_all_calls_are_of_use(sigma):
    """Whatever the sigma: a given one is no noise."""
    assert Schedule(0, sigma).enough(20, 300) == 300


def planned(noise, strong, iterations=None):
    """The result for a scene with noise of so many times max(y), and how many iterations were made."""
    scene = datasets.embedded_scene(64)
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=noise)
    prior = Other(Traits(strong=strong))
    result = pnp_sci.solve(y, scene.masks, prior, tol=0, scene="full", noise=noise * y.max(), iterations=iterations)
    return result, len(result.history) - 1


@pytest.mark.parametrize(
    ("strong", "iterations", "fewer"), [(True, None, True), (False, None, False), (True, 40, False)]
)
def test_with_noise_a_strong_prior_has_fewer_iterations_unless_they_are_given(strong, iterations, fewer):
    noisy, clean = (planned(noise, strong, iterations)[1] for noise in (0.1, 0))
    assert (noisy < clean) == fewer
    assert noisy == iterations or iterations is None


def test_the_planned_number_given_again_gives_the_same():
    result, _ = planned(0.1, strong=True)
    again, _ = planned(0.1, strong=True, iterations=result.settings["iterations"])
    np.testing.assert_allclose(again.x, result.x, atol=1e-5)
