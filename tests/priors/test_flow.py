"""The flow prior, and the prior with a network that sees motion as it does: they help where they can."""

import numpy as np
import pytest
from operators_and_priors import learned

import pnp_sci
from pnp_sci import datasets, denoise
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import InTurn, turns
from priors import flow
from priors.flow import Flow
from priors.motion import measure as motion
from priors.tv import TV
from priors.video import Video

KINDS = [Flow, learned(Video, name="Video")]
CALLS = 6  # of a session: the motion is measured at least twice


@pytest.fixture(scope="module")
def moving():
    """A textured picture that moves by (1, 2) pixels a frame: (1, 7, 96, 96)."""
    picture = datasets.embedded_scene(128).truth[0, 0]
    frames = [np.roll(picture, (b, 2 * b), (0, 1))[14:110, 14:110] for b in range(7)]
    return np.stack(frames)[None].astype(np.float32)


def begun(prior, x):
    return prior.begin(x.shape, x.dtype)


def test_nothing_is_still_where_none_may_be(moving, monkeypatch):
    asked = []
    monkeypatch.setattr(motion, "_at_rest", lambda pilot, *given: asked.append(given[-1]) or 0 * pilot[0])
    for still in (True, False):
        session = begun(Flow(still=still), moving)
        session.finish(session(moving, 0.05), 0.05)
    assert len(asked) == 4, "in a call, and in finishing"
    assert min(asked[:2]) > 0
    assert asked[2:] == [0, 0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_that_stands_still_helps(kind, monkeypatch):
    """A square goes by before a still picture: what is still gains by all frames, and the square does not lose.

    Of one measurement the square may gain or lose 0.1 dB, so the mean of three counts.
    """
    truth = np.repeat(datasets.embedded_scene(96).truth[:1, :1], 10, 1)
    for b in range(10):
        truth[0, b, 30:50, 5 * b : 5 * b + 20] = 0.9

    def quality():
        """PSNR of all rows and of those of the square."""
        for seed in (1, 2, 3):
            masks = pnp_sci.moving_masks(truth.shape, seed=seed)
            x = pnp_sci.solve(pnp_sci.simulate(truth, masks), masks, kind(), scene="full", init="adjoint").x
            yield [pnp_sci.psnr(x[:, :, rows], truth[:, :, rows])[0] for rows in (slice(None), slice(30, 50))]

    with_it = np.mean(list(quality()), 0)
    monkeypatch.setattr(motion, "_at_rest", lambda pilot, *_: np.zeros(pilot.shape[1:], np.float32))
    gain = with_it - np.mean(list(quality()), 0)
    assert gain[0] > 0.05
    assert gain[1] > -0.05


def test_bm3d_is_told_what_the_averages_leave(moving):
    """A frame's left half has neighbours, its right half is unlike any of them."""
    mixed, told = moving.copy(), []
    mixed[0, 3, :, 48:] = np.random.default_rng(0).random((96, 48))
    session = begun(Flow(), mixed)
    session.patches = lambda x, sigma: told.append(sigma) or x
    session(mixed, 0.05)
    left, right = told[0][0, 3, :, 8:40], told[0][0, 3, :, 56:]
    assert np.median(right) > 0.95 * told[0].max()
    assert np.median(left) < 0.7 * told[0].max()


@pytest.mark.parametrize(("view", "at_least"), [(0, 1.0), (1, 0.0)])
def test_better_than_tv_in_the_solver(view, at_least):
    scene = datasets.embedded_scene(128)
    plain = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "tv").x, scene.truth)
    aided = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "flow").x, scene.truth)
    assert aided[view] > plain[view] + at_least


def test_benchmark_pair(data):
    scene = datasets.dualview("hike_hockey")
    psnr = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "flow").x, scene.truth)
    assert psnr.mean() > 25.5


@pytest.mark.parametrize("kind", KINDS)
def test_tv_serves_first(moving, kind):
    """As many calls as `first` says, and none with ``first=0``."""
    order = turns(kind(first=2), moving.shape)
    together, tv = InTurn(order, moving.shape, moving.dtype), begun(TV(), moving)
    same = [np.array_equal(together(moving, 0.05), tv(moving, 0.05)) for _ in range(3)]
    assert same == [True, True, False]
    assert len(turns(kind(first=0), moving.shape)) == 1


def test_tv_serves_where_noise_hides_the_motion(moving):
    """Whatever number of calls has gone before."""
    together = InTurn(turns(Flow(first=1), moving.shape), moving.shape, moving.dtype)
    tv = begun(TV(), moving)
    for _ in range(4):
        np.testing.assert_array_equal(together(moving, 0.9), tv(moving, 0.9))
    assert not np.array_equal(together(moving, 0.05), tv(moving, 0.05))


def test_clips_too_small_to_show_motion_are_left_to_tv(moving):
    small = np.ascontiguousarray(moving[..., :31, :40])
    flow, tv = begun(Flow(), small), begun(TV(), small)
    for _ in range(3):
        np.testing.assert_array_equal(flow(small, 0.05), tv(small, 0.05))
    assert not Flow().traits(small.shape).average


@pytest.mark.parametrize("kind", KINDS)
def test_views_do_not_mix_once_motion_is_used(moving, kind):
    one, two = np.concatenate([moving, moving]), np.concatenate([moving, moving[:, ::-1]])
    first, second = begun(kind(), one), begun(kind(), two)
    for _ in range(CALLS):
        a, b = first(one, 0.05), second(two, 0.05)
        np.testing.assert_array_equal(a[0], b[0])
    a, b = first.finish(a, 0.05), second.finish(b, 0.05)
    np.testing.assert_array_equal(a[0], b[0])
    assert not np.array_equal(a[1], b[1])


@pytest.mark.parametrize("kind", KINDS)
def test_motion_found_before_serves_later_calls(moving, kind):
    """A session remembers: its later calls differ from the first one of another, and repeat in a third."""
    one, two = begun(kind(), moving), begun(kind(), moving)
    first = np.array(one(moving, 0.05))
    np.testing.assert_array_equal(two(moving, 0.05), first)
    for _ in range(CALLS):
        np.testing.assert_array_equal(two(moving, 0.05), later := one(moving, 0.05))
    assert not np.array_equal(later, first)


@pytest.mark.parametrize("kind", KINDS)
def test_double_precision_is_served_and_the_input_kept(moving, kind):
    """To what single precision makes of it."""
    x = moving.astype(np.float64)
    before, double, single = x.copy(), begun(kind(), x), begun(kind(), moving)
    for _ in range(CALLS):
        after, expected = double(x, 0.05), single(moving, 0.05)
    np.testing.assert_array_equal(x, before)
    assert np.abs(after - expected).mean() < 1e-3
    assert denoise(x, 0.05, kind()).dtype == np.float64


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sigma", [1e-9, 1e-4, 1e3])
def test_any_sigma_once_motion_is_used(moving, sigma, kind):
    session = begun(kind(), moving)
    first = np.array(session(moving, sigma))
    if sigma < 1e-3:
        np.testing.assert_allclose(first, moving, atol=20 * sigma)
    for _ in range(CALLS):
        assert np.isfinite(session(moving, sigma)).all()


@pytest.mark.parametrize(
    "option", [{"neighbours": 0}, {"neighbours": 1.5}, {"tolerance": 0}, {"drift": -1}, {"first": 1.5}, {"renew": 0}]
)
def test_errors_name_the_option(option):
    with pytest.raises(InputError, match=next(iter(option))):
        Flow(**option)


@pytest.mark.parametrize(("renew", "searches"), [(1, 6), (2, 3), (5, 2)])
def test_the_motion_is_measured_in_every_so_many_calls(moving, monkeypatch, renew, searches):
    calls, own = [], flow.seen
    monkeypatch.setattr(flow, "seen", lambda *given: calls.append(1) or own(*given))
    session = begun(Flow(first=0, renew=renew), moving)
    for _ in range(6):
        session(moving, 0.05)
    assert len(calls) == searches


def test_noise_becomes_weaker_along_the_motion(moving):
    noisy = moving + 0.1 * np.random.default_rng(0).standard_normal(moving.shape).astype(np.float32)
    by_flow, by_tv = denoise(noisy, 0.1, Flow()), denoise(noisy, 0.1, TV(time=0, inner=200))
    assert pnp_sci.psnr(by_flow, moving)[0] > pnp_sci.psnr(by_tv, moving)[0] + 0.5
