"""Total variation against scikit-image, and what its memory and its weight along time do."""

import itertools

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.restoration import denoise_tv_chambolle

import pnp_sci
from pnp_sci import denoise
from pnp_sci.errors import InputError
from priors.tv import TV, at_rest, time_weights

LATE = 60  # calls, by which a session has looked at what moves


def steps_and_noise(shape, dtype=np.float64):
    """Rectangles with noise of standard deviation 0.1."""
    rng = np.random.default_rng(0)
    x = np.zeros(shape)
    for view in x:
        for k, frame in enumerate(view):
            frame[shape[2] // 4 : shape[2] // 2, shape[3] // 4 + k : shape[3] * 3 // 4] = 1
    return (x + 0.1 * rng.standard_normal(shape)).astype(dtype)


@pytest.mark.parametrize("weight", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("shape", [(2, 2, 70, 45), (1, 1, 33, 5)], ids=str)
def test_frames_agree_with_scikit_image(shape, weight):
    """Both run to convergence; the frames span several bands of rows, the unit of parallel work."""
    x = steps_and_noise(shape)
    ours = denoise(x, weight, TV(inner=3000, time=0))
    for view, denoised in zip(x, ours):
        for frame, out in zip(view, denoised):
            theirs = denoise_tv_chambolle(frame, weight, eps=0, max_num_iter=3000)
            np.testing.assert_allclose(out, theirs, atol=1e-3)


def test_volumes_agree_with_scikit_image():
    x = steps_and_noise((2, 5, 40, 21))
    ours = denoise(x, 0.1, TV(inner=3000, time=1))
    for view, out in zip(x, ours):
        np.testing.assert_allclose(out, denoise_tv_chambolle(view, 0.1, eps=0, max_num_iter=3000), atol=1e-3)


def differences(x, time):
    """Forward differences along time, rows and columns, 0 at the end: (3, V, B, H, W)."""
    return np.stack([s * np.diff(x, axis=a, append=np.take(x, [-1], a)) for a, s in ((1, time), (2, 1), (3, 1))])


@pytest.mark.parametrize("isotropic", [True, False])
@pytest.mark.parametrize("time", [0.0, 0.3, 1.5])
def test_minimises_its_objective(isotropic, time):
    """No small change lowers ``||x - v||^2 / (2 w) + TV(x)``, written out in numpy."""
    v = steps_and_noise((1, 3, 20, 18))
    x = denoise(v, 0.1, TV(inner=4000, time=time, isotropic=isotropic))

    def objective(x):
        d = differences(x, time)
        return ((x - v) ** 2).sum() / 0.2 + (np.sqrt((d**2).sum(0)) if isotropic else np.abs(d).sum(0)).sum()

    rng = np.random.default_rng(1)
    best = objective(x)
    for size in (1e-1, 1e-2, 1e-3):
        for direction in (v - x, x.mean() - x, rng.standard_normal(x.shape), rng.standard_normal((1, 3, 1, 1)) + 0 * x):
            assert objective(x + size * direction) > best - 1e-6 * best
            assert objective(x - size * direction) > best - 1e-6 * best


def divergence(p, time):
    """What the negative of :func:`differences` is adjoint to."""
    axes = ((1, time), (2, 1), (3, 1))
    return sum(s * np.diff(q, axis=a, prepend=0 * np.take(q, [0], a)) for q, (a, s) in zip(p, axes))


def step_length():
    """Of one dual step, in units of Chambolle's, from a video so flat that the dual variable stays small."""
    v = 0.01 * steps_and_noise((1, 1, 20, 20))
    spread = divergence(differences(v, 0), 0) / 8
    return float(np.vdot(denoise(v, 0.5, TV(inner=1, time=0)) - v, spread) / np.vdot(spread, spread))


def plain(v, weight, time, steps, length):
    """The dual projection written out in numpy, isotropic, from p = 0."""
    p = np.zeros((3, *v.shape))
    for _ in range(steps):
        p += length * differences(v + weight * divergence(p, time), time) / ((8 + 4 * time**2) * weight)
        p /= np.maximum(1, np.sqrt((p**2).sum(0)))
    return v + weight * divergence(p, time)


def test_steps_are_as_long_as_they_converge():
    assert 1 <= step_length() < 4 / 3


@pytest.mark.parametrize("weight", [0.02, 0.5, 0.8])
@pytest.mark.parametrize("shape", [(2, 3, 65, 21), (1, 2, 64, 5), (3, 4, 129, 1), (1, 1, 1, 9)], ids=str)
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-3), (np.float64, 1e-7)])
def test_steps_are_those_of_the_formula(shape, weight, dtype, tolerance):
    """Over the joins of bands of rows, of frames and of views, with a dual variable in 16 and in 32 bits."""
    x = steps_and_noise(shape, dtype)
    time = 0.7 if shape[1] > 1 else 0.0
    ours = denoise(x, weight, TV(inner=20, time=time))
    expected = plain(x.astype(float), weight, time, 20, step_length())
    np.testing.assert_allclose(ours, expected, atol=tolerance * weight)


def test_strong_weights_along_time_need_a_finer_dual_variable():
    x = steps_and_noise((1, 4, 24, 24))
    single, double = (denoise(v, 0.1, TV(inner=2000, time=30)) for v in (x.astype(np.float32), x))
    np.testing.assert_allclose(single, double, atol=5e-4)


def test_the_noise_level_may_change_between_calls():
    """From 16 to 32 bits of the dual variable and back, nothing is lost."""
    x = steps_and_noise((1, 3, 40, 20))
    single, double = (TV(time=0.3).begin(x.shape, np.dtype(kind)) for kind in ("f4", "f8"))
    for sigma in (0.1, 0.4, 0.7, 0.4, 0.9, 0.1):
        np.testing.assert_allclose(single(x.astype(np.float32), sigma), double(x, sigma), atol=1e-4)


def test_parallel_and_in_place_are_the_same():
    """Videos above and below the size from which threads are used, and a result that overwrites its input."""
    x = steps_and_noise((2, 4, 100, 70), np.float32)
    together = TV(time=0.3).begin(x.shape, x.dtype)
    alone = [TV(time=0.3).begin((1, *x.shape[1:]), x.dtype) for _ in x]
    for _ in range(3):
        v = x.copy()
        both = together(v, 0.1, out=v)
        assert both is v
        for view, session, expected in zip(x, alone, both):
            np.testing.assert_array_equal(session(view[None], 0.1)[0], expected)


@pytest.mark.parametrize("time", [0, 0.3])
def test_many_short_calls_are_one_long_call(time):
    """The dual variable is kept: a hundred calls of two steps do what one of two hundred does."""
    x = steps_and_noise((2, 3, 40, 20))
    short = TV(inner=2, time=time).begin(x.shape, x.dtype)
    for _ in range(100):
        out = short(x, 0.1)
    np.testing.assert_allclose(out, denoise(x, 0.1, TV(inner=200, time=time)), atol=1e-10)
    assert np.abs(denoise(x, 0.1, TV(inner=2, time=time)) - out).max() > 1e-3


def test_strength_multiplies_sigma():
    x = steps_and_noise((1, 2, 20, 20))
    assert np.array_equal(denoise(x, 0.1, TV(strength=2, inner=9)), denoise(x, 0.2, TV(strength=1, inner=9)))


def test_follows_the_scale():
    x = steps_and_noise((1, 2, 20, 20))
    np.testing.assert_allclose(denoise(1e3 * x, 1e2, TV(inner=9)), 1e3 * denoise(x, 0.1, TV(inner=9)), rtol=1e-9)


def test_more_noise_smooths_more():
    x = steps_and_noise((1, 2, 40, 40))
    variation = [np.abs(differences(denoise(x, s, TV(inner=300)), 1)).sum() for s in (0, 0.02, 0.1, 0.5, 2)]
    assert all(a > b for a, b in itertools.pairwise(variation))


def test_frames_are_their_own_without_time():
    x = steps_and_noise((1, 4, 20, 20))
    other = x.copy()
    other[0, 3] = 0
    priors = TV(time=0), TV(time=0.3)
    same = [np.array_equal(*(denoise(v, 0.1, tv)[0, :3] for v in (x, other))) for tv in priors]
    assert same == [True, False]


def test_weights_along_time_follow_the_motion():
    """Large where a textured scene stands still, small where it moves, each view and place for itself."""
    texture = gaussian_filter(np.random.default_rng(0).random((60, 120)), 3, mode="wrap")
    still = np.repeat(texture[None], 6, 0)
    moving = np.stack([np.roll(texture, 5 * k, axis=1) for k in range(6)])
    assert time_weights(still).min() > 0.6
    assert time_weights(moving).max() < 0.3
    half = np.concatenate([still[..., :60], moving[..., 60:]], axis=2)
    assert time_weights(half)[:, 10].min() > 2 * time_weights(half)[:, -10].max()
    moves = np.stack([still, moving]).astype(np.float32)
    session = TV().begin(moves.shape, moves.dtype)
    assert len(np.unique(session.weights)) == 1
    for _ in range(LATE):
        session(moves, 0.01)
    assert session.weights[0].min() > session.weights[1].max()


@pytest.mark.parametrize("sigma", [0.15, 0.3])
def test_with_noise_weights_along_time_stay_as_they_are(sigma):
    """Changes along time are then no motion: the same weight everywhere."""
    x = np.random.default_rng(0).random((2, 4, 20, 30), np.float32)
    session = TV().begin(x.shape, x.dtype)
    before = session.weights.copy()
    for _ in range(LATE):
        session(x, sigma)
    assert len(np.unique(before)) == 1
    np.testing.assert_array_equal(session.weights, before)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"strength": 0}, "strength is 0.*> 0"),
        ({"strength": float("nan")}, "strength is nan.*> 0"),
        ({"inner": 0}, "inner is 0.*>= 1"),
        ({"inner": 1.5}, "inner is 1.5.*whole"),
        ({"inner": "many"}, "inner is 'many'.*whole"),
        ({"time": -0.1}, "time is -0.1.*auto"),
        ({"time": "fast"}, "time is 'fast'.*auto"),
        ({"time": float("inf")}, "time is inf.*>= 0"),
    ],
)
def test_options(options, message):
    with pytest.raises(InputError, match=message):
        TV(**options)


def half_still(frames=10):
    """Two views (2, B, 40, 64) of a picture; in the first one the right half flickers, in the second one all does."""
    rng = np.random.default_rng(0)
    picture = gaussian_filter(rng.standard_normal((40, 64)), 3)
    v = 0.5 + np.repeat(picture[None, None], frames, 1).repeat(2, 0)
    flicker = 4 * gaussian_filter(rng.standard_normal(v.shape), (0, 0, 3, 3))
    flicker[0, ..., :32] = 0
    v += flicker
    return v.astype(np.float32)


def test_what_stands_still_is_seen():
    """1 where frames are alike, 0 where they are not; ``exp(-1)`` where they differ by `rest`, or less in the dark."""
    v = half_still()
    still = at_rest(v[0], 0.02)
    assert still[:, :24].min() > 0.99
    assert np.median(still[:, 36:]) < 0.01
    rows = np.array([-1, 1] * 4)[:, None, None] * np.full((8, 16, 16), 0.02)
    for brightness, exponent in ((0.5, 1), (0.9, 1), (0.25, 4), (0.05, 100), (0.0, np.inf), (-0.1, np.inf)):
        np.testing.assert_allclose(at_rest(brightness + rows, 0.02), np.exp(-exponent), rtol=1e-5)
    assert at_rest(0 * rows, 0.02).min() == 1, "black in every frame"


def test_still_pixels_take_their_mean():
    """As soon as they are seen, where nothing moves, and in no other view; not with ``still=False``."""
    v = half_still() + 0.003 * np.random.default_rng(1).standard_normal((2, 10, 40, 64)).astype(np.float32)
    with_it, without = (TV(still=still).begin(v.shape, v.dtype) for still in (True, False))
    exact = TV().begin(v.shape, np.dtype(np.float64))
    assert with_it.facts()["still"] == []
    for _ in range(LATE):
        out, other, double = with_it(v, 0.05), without(v, 0.05), exact(v.astype(np.float64), 0.05)
        if with_it.facts()["still"]:
            break
    first, second = with_it.facts()["still"]
    assert first == pytest.approx(0.5, abs=0.15)
    assert second < 0.1
    assert without.facts()["still"] == []
    np.testing.assert_allclose(double, out, atol=2e-3)
    assert out[0, :, :, :24].std(0).max() < 1e-4 < other[0, :, :, :24].std(0).min()
    np.testing.assert_allclose(out[0, :, :, :24].mean(0), other[0, :, :, :24].mean(0), atol=1e-4)
    np.testing.assert_allclose(np.median(np.abs(out - other)[1]), 0, atol=1e-5)


def test_a_camera_that_stands_still_helps():
    """A square goes by before two still pictures."""
    truth = np.repeat(pnp_sci.datasets.embedded_scene(96).truth[:, :1], 10, 1)
    for b in range(10):
        truth[:, b, 30:50, 5 * b : 5 * b + 20] = 0.9
    masks = pnp_sci.moving_masks(truth.shape, seed=1)
    y = pnp_sci.simulate(truth, masks)
    results = [pnp_sci.solve(y, masks, "tv", scene="full", still=still) for still in (True, False)]
    gained, plain = (np.mean(pnp_sci.psnr(result.x, truth)) for result in results)
    assert gained > plain + 0.03
    assert 0.2 < results[0].scene["at_rest"][0] < 0.86, "of 0.86 that the square leaves alone"
    assert results[1].scene["at_rest"] == [None, None]
