"""Motion as the priors measure it: the flow is that of the scene, and counts as far as it can be trusted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude, shift

from pnp_sci import datasets
from priors.kernels.average import FRACTION
from priors.kernels.match import choose, consistency, differ, smooth, steady, weigh
from priors.motion import credit as credits
from priors.motion import measure as motion
from priors.motion.credit import TUNED, credit
from priors.motion.measure import Motion, _chosen, measure
from priors.motion.pairs import adjacent
from priors.motion.videos import seen


@pytest.fixture(scope="module")
def moving():
    """A textured picture that moves by (1, 2) pixels a frame: (1, 7, 96, 96)."""
    picture = datasets.embedded_scene(128).truth[0, 0]
    frames = [np.roll(picture, (b, 2 * b), (0, 1))[14:110, 14:110] for b in range(7)]
    return np.stack(frames)[None].astype(np.float32)


def test_the_flow_is_that_of_the_scene(moving):
    seen = measure(moving[0], neighbours=2, tolerance=0.1, drift=1.5, rest=0.01)
    for (b, n), field in zip(seen.pairs, seen.flow / 64):
        np.testing.assert_allclose(np.median(field, axis=(0, 1)), (2 * (n - b), n - b), atol=0.1)


def catmull_rom(t):
    """Weights of four samples for the place t between the second and the third, by the formula of 1974."""
    matrix = np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2
    return t ** np.arange(4) @ matrix


def any_motion(shape):
    """A motion of two frames: any flow and weights, nothing still."""
    random = np.random.default_rng(0)
    half = [(size + 1) // 2 for size in shape]
    flow = random.integers(-3 * FRACTION, 3 * FRACTION, (2, *half, 2)).astype(np.int16)
    weights = random.integers(256, size=(2, *shape)).astype(np.uint8)
    return Motion(np.array([(0, 1), (1, 0)]), np.array([0, 1, 2]), flow, weights, np.zeros(shape, np.float32))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9, 12), (8, 7), (1, 1), (2, 3)])
def test_averages_fetch_blocks_from_where_the_flow_points(shape, dtype):
    """As bicubic interpolation by itself does, beyond the edges as the frame ends; sizes odd and even."""
    view = np.random.default_rng(1).random((2, *shape)).astype(dtype)
    seen = any_motion(shape)
    weights, flow = seen.weights, seen.flow
    mean = np.empty_like(view)
    seen.average(view, mean)
    for p, (b, n) in enumerate(seen.pairs):
        beyond = np.pad(view[n].astype(float), 8, "edge")
        for i, j in np.ndindex(*shape):
            top, left = i - i % 2, j - j % 2  # the block's first pixel is held to the frame, the others lie beside it
            point = np.clip((top, left) + flow[p, i // 2, j // 2, ::-1] / FRACTION, 0, np.array(shape) - 1)
            rows, columns = np.floor(point).astype(int) + 8 + (i % 2, j % 2)
            down, across = (catmull_rom(t) for t in point % 1)
            warped = down @ beyond[rows - 1 : rows + 3, columns - 1 : columns + 3] @ across
            w = weights[p, i, j] / 255
            assert mean[b, i, j] == pytest.approx((view[b, i, j] + w * warped) / (1 + w), abs=1e-5)


@pytest.mark.parametrize("shape", [(9, 12), (8, 7), (1, 1), (2, 3)])
def test_the_transposed_averages_are_their_transpose(shape):
    random = np.random.default_rng(2)
    still = random.random(shape).astype(np.float32) * random.choice([0.01, 1], (shape[0], 1))  # rows that hardly are
    seen = replace(any_motion(shape), still=still)
    x, g = random.standard_normal((2, 2, *shape))
    mean, back = np.empty_like(x), np.empty_like(g)
    seen.average(x, mean)
    seen.spread(g, back)
    assert np.vdot(mean, g) == pytest.approx(np.vdot(x, back), abs=1e-5 * np.linalg.norm(x) * np.linalg.norm(g))


def test_averaging_along_motion_keeps_the_scene_and_lowers_noise(moving):
    rng = np.random.default_rng(0)
    seen = measure(moving[0], neighbours=3, tolerance=0.2, drift=1.5, rest=0.01)
    same, less = np.empty_like(moving[0]), np.empty_like(moving[0])
    seen.average(moving[0], same)
    inner = (slice(None), slice(16, -16), slice(16, -16))
    assert np.sqrt(np.mean((same - moving[0])[inner] ** 2)) < 0.02
    noise = 0.05 * rng.standard_normal(moving[0].shape).astype(np.float32)
    seen.average(moving[0] + noise, less)
    assert np.std((less - same)[inner]) < 0.6 * np.std(noise)


def test_what_stands_still_is_told_from_what_moves_however_slowly():
    """A still picture, seen with noise, in which a square goes by; and one that moves by 0.3 pixels a frame."""
    rng = np.random.default_rng(0)
    picture = datasets.embedded_scene(128).truth[0, 0].astype(np.float32)
    still, slow = np.repeat(picture[None, 14:110, 14:110], 10, 0), []
    for b in range(10):
        still[b, 40:60, 10 + 6 * b : 30 + 6 * b] = 0.5 * picture[:20, :20]
        slow.append(shift(picture, (0, 0.3 * b), order=3)[14:110, 14:110])
    noise = 0.02 * rng.standard_normal(still.shape).astype(np.float32)
    seen = measure(still + noise, 3, 0.1, 1.5, rest=0.03)
    assert np.median(seen.still[5:32]) > 0.7
    assert np.median(seen.still[44:56, 16:80]) < 0.01
    textured = gaussian_gradient_magnitude(picture, 1)[14:110, 14:110] > 0.05
    assert np.median(measure(np.stack(slow) + noise, 3, 0.1, 1.5, rest=0.03).still[textured]) < 0.05


@pytest.mark.parametrize("brightness", [0.1, 0.6])
def test_before_a_dark_ground_less_is_motion(brightness):
    """A square that differs by a third of its ground and goes by is seen in both; the ground beside it stands still."""
    view = np.full((10, 64, 64), brightness, np.float32)
    for b in range(10):
        view[b, 20:40, 4 * b : 4 * b + 20] *= 2 / 3
    view += 0.002 * np.random.default_rng(0).standard_normal(view.shape).astype(np.float32)
    still = measure(view, 3, 0.1, 1.5, rest=0.03).still
    assert np.median(still[24:36, 12:52]) < 0.05
    assert np.median(still[48:]) > 0.7


def test_still_pixels_become_the_mean_of_all_frames():
    """And by as much as they are still."""
    view = np.random.default_rng(0).standard_normal((8, 40, 50)).astype(np.float32)
    none = np.zeros((0, 40, 50), np.uint8)
    still = np.linspace(0, 1, 50, dtype=np.float32) * np.ones((40, 1), np.float32)
    alone = np.zeros((0, 2), np.int64), np.zeros(9, np.int64), np.zeros((0, 40, 50, 2), np.int16), none
    out, seen = np.empty_like(view), Motion(*alone, still)
    seen.average(view, out)
    np.testing.assert_allclose(out, view + still * (view.mean(0) - view), atol=1e-5)


def test_strangers_do_not_help():
    """Frames without anything in common are left alone."""
    frames = np.random.default_rng(0).random((3, 64, 64)).astype(np.float32)
    seen = measure(frames, neighbours=2, tolerance=0.05, drift=1.5, rest=0.01)
    assert seen.weights.mean() < 2.55


def test_flow_is_chosen_where_frames_match_better_by_it():
    """Of no flow and the right one the right one is taken, and its difference kept; what is worse changes nothing."""
    rng = np.random.default_rng(0)
    picture = gaussian_filter(rng.standard_normal((40, 52)), 1).astype(np.float32)
    v, pairs = np.stack([picture[4:36, 4:48], picture[6:38, 5:49]]), np.array([[0, 1]])
    none = np.zeros((1, 32, 44, 2), np.int16)
    right = none + np.array([-FRACTION, -2 * FRACTION], np.int16)
    flow, distance, least = none.copy(), *np.empty((2, 1, 32, 44), np.float32)
    differ(v, flow, pairs, distance)
    differ(v, right, pairs, least)
    choose(v, right, np.float32(1), pairs, flow, distance)
    inner = np.s_[0, 6:-6, 6:-6]
    np.testing.assert_array_equal(flow[inner], right[inner])
    np.testing.assert_array_equal(distance[inner], least[inner])
    np.testing.assert_allclose(least[inner], 0, atol=1e-8)
    choose(v, none, np.float32(1), pairs, flow, distance)
    np.testing.assert_array_equal(flow[inner], right[inner])


def test_flow_that_matches_worse_is_taken_up_to_a_share():
    """Of a flow whose squared difference is 1.2 times what there is."""
    v, pairs = np.random.default_rng(0).random((2, 32, 44), np.float32), np.array([[0, 1]])
    candidate = np.zeros((1, 32, 44, 2), np.int16)
    flow, distance, worse = candidate + np.int16(FRACTION), *np.empty((2, 1, 32, 44), np.float32)
    differ(v, candidate, pairs, worse)
    distance[:] = worse / np.float32(1.2)
    before = flow.copy(), distance.copy()
    choose(v, candidate, np.float32(1.1), pairs, flow, distance)
    np.testing.assert_array_equal(flow, before[0])
    np.testing.assert_array_equal(distance, before[1])
    choose(v, candidate, np.float32(1.3), pairs, flow, distance)
    np.testing.assert_array_equal(flow, candidate)
    np.testing.assert_array_equal(distance, worse)


def test_steady_motion_is_taken_from_other_pairs():
    """The flow between two frames is wrong, half of that between another two, and all flow in a small hole."""
    picture = gaussian_filter(np.random.default_rng(0).standard_normal((60, 80)), 1).astype(np.float32)
    small = np.stack([picture[8 + b : 48 + b, 8 + 2 * b : 60 + 2 * b] for b in range(5)])
    near = [(b, n) for b in range(5) for n in range(5) if 0 < abs(b - n) <= 2]
    right = np.stack([np.full((40, 52, 2), [-2 * FRACTION * (n - b), -FRACTION * (n - b)], np.int16) for b, n in near])
    flow = right.copy()
    flow[near.index((2, 4))] = 0  # (2, 0) says what it is
    flow[near.index((0, 1)), :, 26:] = 0  # (0, 2) does
    distance = _chosen(small, np.array(near), np.float32(0.1), flow)
    inner = np.s_[:, 12:-12, 12:-12]
    np.testing.assert_array_equal(flow[inner], right[inner])
    np.testing.assert_allclose(distance[inner], 0, atol=1e-8)
    flow[:, 18:21, 24:27] = 0
    _chosen(small, np.array(near), np.float32(0.1), flow)
    assert np.abs(flow - right)[:, 19, 25].max() < FRACTION


def test_errors_are_not_followed(moving, monkeypatch):
    """The flow of frames with errors is more precise where it may match a little worse than what matches best."""
    noisy = moving[0] + 0.05 * np.random.default_rng(0).standard_normal(moving[0].shape).astype(np.float32)

    def error():
        seen = measure(noisy, neighbours=2, tolerance=0.2, drift=1.5, rest=0.0)
        right = np.stack([[2 * (n - b), n - b] for b, n in seen.pairs])[:, None, None]
        return np.mean(np.minimum(np.abs(seen.flow / FRACTION - right), 1))

    precise = error()
    monkeypatch.setattr(motion, "TUNED", replace(motion.TUNED, smooth=1))
    assert precise < 0.2  # pixels
    assert precise < 0.95 * error()


@pytest.mark.parametrize("shape", [(96, 96), (97, 99)])
def test_search_begins_with_earlier_motion(shape):
    """A picture moves too far to be found: from scratch it is not, from where it is known it is, and is believed."""
    rows, columns = shape
    picture = gaussian_filter(np.random.default_rng(0).standard_normal((rows, columns + 20)), 1).astype(np.float32)
    view = 0.5 + np.stack([picture[:, 20:], picture[:, :columns]])
    lost = measure(view, neighbours=1, tolerance=0.1, drift=1.5, rest=0.01)
    known = np.zeros_like(lost.flow)
    known[0, ..., 0], known[1, ..., 0] = 20 * FRACTION, -20 * FRACTION
    found = measure(view, 1, 0.1, 1.5, 0.01, Motion(lost.pairs, lost.first, known, lost.weights, lost.still))
    inner = np.s_[:, 24:-24, 24:-24]
    assert np.median(np.abs(found.flow - known)[:, 12:-12, 12:-12]) < FRACTION / 4
    assert found.weights[inner].mean() > 200
    assert lost.weights[inner].mean() < 20
    others = Motion(lost.pairs[:1], lost.first, known[:1], lost.weights[:1], lost.still)
    np.testing.assert_array_equal(measure(view, 1, 0.1, 1.5, 0.01, others).flow, lost.flow)


def test_scaled_flow_stays_within_its_type():
    flow = np.random.default_rng(0).integers(-32767, 32768, (2, 3, 4, 2)).astype(np.int16)
    out = np.empty_like(flow)
    steady(flow, np.array([1, 0]), np.array([-0.5, 3], np.float32), out)
    np.testing.assert_array_equal(out[0], np.rint(np.float32(-0.5) * flow[1]))
    np.testing.assert_array_equal(out[1], np.clip(3 * flow[0].astype(int), -32767, 32767))


def test_smoothed_flow_comes_from_where_frames_match():
    """A patch in which nothing matches takes the flow of its surroundings; flow that is the same everywhere stays."""
    flow, distance = np.full((1, 30, 30, 2), 100, np.int16), np.zeros((1, 30, 30), np.float32)
    flow[0, 14:16, 14:16], distance[0, 14:16, 14:16] = -3000, 100
    out = np.empty_like(flow)
    smooth(flow, distance, np.float32(0.1), out)
    np.testing.assert_array_equal(out, 100)


def test_pairs_whose_frames_differ_more_than_next_ones_count_less():
    """exp(-doubt (d - d0) / close^2) with d0 the mean of the pairs with the frames before and after; at most 1."""
    pairs = [(b, n) for b in range(4) for n in range(4) if 0 < abs(b - n) <= 2]
    beside = adjacent(np.array(pairs))
    assert [[pairs[p] for p in order] for order in beside] == [
        [(b, b - 1) if b > 0 else (0, 1) for b, _ in pairs],
        [(b, b + 1) if b < 3 else (3, 2) for b, _ in pairs],
    ]
    mean = np.random.default_rng(0).random(len(pairs))
    of = dict(zip(pairs, mean))
    nearest = [np.mean([of[b, n] for n in (b - 1, b + 1) if (b, n) in of]) for b, _ in pairs]
    expected = np.exp(-TUNED.doubt * np.maximum(mean - nearest, 0) / 0.25)
    assert (expected == 1).any()
    assert (expected < 0.9).any()
    np.testing.assert_allclose(credit(mean, beside, 0.5), expected)
    torch = pytest.importorskip("torch")
    np.testing.assert_allclose(credit(torch.from_numpy(np.stack([mean, mean])), beside, 0.5), [expected] * 2)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_a_frame_unlike_the_others_far_away_loses_credit(moving, library, monkeypatch):
    """A part of frame 5 is foreign: it counts less for frame 3, also where it matches."""
    if library == "torch":
        torch = pytest.importorskip("torch")
    x = moving.copy()
    x[0, 5, :48, :48] = np.random.default_rng(0).random((48, 48))
    means = []
    for doubt in (0.0, 0.5):
        monkeypatch.setattr(credits, "TUNED", replace(TUNED, doubt=doubt))
        motion = seen(x if library == "numpy" else torch.from_numpy(x), 2, 0.1, 1.5, 0.01)
        pairs = motion.views[0].pairs.tolist() if library == "numpy" else [list(pair) for pair in motion.pairs.pairs]
        weights = motion.views[0].weights / 255 if library == "numpy" else motion.weights[0].numpy()
        means.append(weights[pairs.index([3, 5])][60:80, 60:80].mean())
    assert means[0] > 0.9
    assert means[1] < 0.5 * means[0]


def test_weights_of_a_pair_follow_its_credit():
    """Half the credit, half the weight."""
    distance, trust = np.zeros((2, 3, 4), np.float32), np.full((2, 3, 4), 200, np.uint8)
    weights = np.empty_like(trust)
    weigh(distance, trust, np.array([1, 0.5], np.float32), np.float32(0.1), weights)
    assert (weights == np.array([200, 100])[:, None, None]).all()


@pytest.mark.parametrize("drift", [1e-30, 0.3, 1.5, 1e30])
def test_trust_falls_with_the_distance_between_there_and_back(drift):
    """255 exp(-d^2 / drift^2), to one of 255, and nothing beyond the frame; of any drift."""
    rows, columns = 20, 24
    flow = np.random.default_rng(0).integers(-200, 200, (2, rows, columns, 2), np.int16)
    flow[1, :, ::2] = -flow[0, :, ::2]  # some come back to where they were, where the flow there is none
    flow[:, :4] = 0
    pairs, reverse, trust = np.array([[0, 1], [1, 0]]), np.array([1, 0]), np.empty((2, rows, columns), np.uint8)
    consistency(flow, pairs, reverse, drift, trust)
    there, back = flow.astype(float) / FRACTION
    i, j = np.mgrid[:rows, :columns]
    y, x = i + np.floor(there[..., 1] + 0.5).astype(int), j + np.floor(there[..., 0] + 0.5).astype(int)
    inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    distance = np.sum((there + back[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)]) ** 2, -1)
    expected = np.where(inside, 255 * np.exp(-distance / drift / drift), 0)
    assert np.abs(trust[0] - expected).max() <= 1
    assert (trust[0, :3] == 255).all()
