"""A module of torch as a prior."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import datasets, solve
from pnp_sci.errors import InputError
from pnp_sci.testing import check_prior

torch = pytest.importorskip("torch")


class Blur(torch.nn.Module):
    def forward(self, x, sigma):
        return torch.nn.functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)


class Counting(torch.nn.Module):
    """Remembers how often it was called."""

    def __init__(self):
        super().__init__()
        self.calls = 0

    def forward(self, x, sigma):
        self.calls += 1
        return x / self.calls


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(32)


def test_a_module_denoises_in_the_solver(scene):
    result = solve(scene.y, scene.masks, prior=Blur(), iterations=10, algorithm="plain-gap", reference=scene.truth)
    assert result.history["psnr"][-1] > result.history["psnr"][0]


def test_a_module_sees_each_frame_as_an_image():
    shapes = []

    class Look(torch.nn.Module):
        def forward(self, x, sigma):
            shapes.append((tuple(x.shape), x.dtype, self.training))
            return x

    pnp_sci.denoise(np.ones((2, 3, 5, 4)), 0.1, Look())
    assert shapes == [((6, 1, 5, 4), torch.float32, False)]


@pytest.mark.parametrize("module", [Blur, Counting])
def test_a_module_keeps_the_promises_of_a_prior(module):
    check_prior(module())


def test_a_module_that_remembers_begins_anew_with_every_video(scene):
    module = Counting()
    y = np.stack([scene.y, scene.y[::-1]])
    both = solve(y, scene.masks, module, iterations=3, scene="full")
    alone = solve(y[1], scene.masks, module, iterations=3, scene="full")
    np.testing.assert_array_equal(both.x[1], alone.x)
    assert module.calls == 0, "sessions work on copies"


def test_a_module_that_works_in_place_leaves_its_input_alone():
    class InPlace(torch.nn.Module):
        def forward(self, x, sigma):
            return x.zero_()

    x = np.ones((1, 2, 4, 4), np.float32)
    assert not pnp_sci.denoise(x, 0.1, InPlace()).any()
    assert x.all()


def test_a_module_that_returns_something_else_is_named(scene):
    class Transpose(torch.nn.Module):
        def forward(self, x, sigma):
            return x.transpose(0, 1)

    class Two(torch.nn.Module):
        def forward(self, x, sigma):
            return x, x

    with pytest.raises(InputError, match=r"prior Transpose returns \(1, 20, .* was expected"):
        solve(scene.y, scene.masks, prior=Transpose(), iterations=1)
    with pytest.raises(InputError, match="prior Two returns tuple"):
        solve(scene.y, scene.masks, prior=Two(), iterations=1)
