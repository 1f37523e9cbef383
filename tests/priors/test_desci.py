"""Groups of patches at low rank: the kernels against numpy, what groups are made of, and what they are worth."""

import sys

import numba
import numpy as np
import pytest
from skimage import data

import pnp_sci
from pnp_sci import datasets, denoise, psnr
from pnp_sci.accel.jit import PARALLEL_FROM
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import Stages
from priors.desci import DeSCI, Groups, grid
from priors.kernels import matrices
from priors.tv import TV


def moving(frames=5, rows=48, columns=56, step=(1, 2)):
    """A part of a photograph that moves by `step` pixels (rows, columns) per frame, float32 (B, H, W)."""
    picture = data.camera()[100:300, 150:350].astype(np.float32) / 255
    starts = [(step[0] * b, step[1] * b) for b in range(frames)]
    return np.stack([picture[r : r + rows, c : c + columns] for r, c in starts])


def noisy(x, sigma):
    return (x + sigma * np.random.default_rng(0).standard_normal(x.shape)).astype(np.float32)


def grouped(view, **parameters):
    """The groups of a view, found in the view itself."""
    groups = Groups(DeSCI(**parameters), view.shape)
    groups.search(view, 0.05)
    return groups


def patches_at(view, places, side):
    """The patches of a view (B, H, W) that begin at places of the flat view, one a row, and their pixels."""
    inside = (np.arange(side)[:, None] * view.shape[2] + np.arange(side)).reshape(-1)
    pixels = places[:, None] + inside
    return view.reshape(-1).astype(np.float64)[pixels], pixels


def proximal(group, weight):
    """argmin_Z ||X - Z||^2 / 2 + weight * sum(log(singular values of Z)), by numpy."""
    u, s, v = np.linalg.svd(group, full_matrices=False)
    root = np.sqrt(np.maximum(s**2 - 4 * weight, 0))
    return (u * np.where(s**2 > 4 * weight, (s + root) / 2, 0)) @ v


def reweighted(group, signal, weight):
    """One reweighting: the weights of the singular values are those of another estimate."""
    if len(group) > group.shape[1]:
        return reweighted(group.T, signal.T, weight).T
    gram = signal @ signal.T
    return gram @ np.linalg.solve(gram + weight * np.eye(len(gram)), group)


def aggregated(view, groups, low_rank):
    """All groups of a view, each brought to low rank by a function of its places and its patches, averaged."""
    side = groups.prior.side
    window = np.outer(np.kaiser(side, 2), np.kaiser(side, 2)).reshape(-1)
    total, weights = np.zeros(view.size), np.zeros(view.size)
    for places in groups.found.reshape(-1, groups.prior.patches):
        group, pixels = patches_at(view, places, side)
        made = low_rank(places, group - group.mean(0)) + group.mean(0)
        np.add.at(total, pixels, window * made)
        np.add.at(weights, pixels, np.broadcast_to(window, pixels.shape))
    return (total / weights).reshape(view.shape)


SIZES = [(8, 12), (8, 70), (5, 9), (4, 20)]  # side, patches: with and without SIMD, more rows and more columns


@pytest.mark.parametrize(("side", "patches"), SIZES)
def test_the_closed_form_is_that_of_numpy(side, patches):
    view = noisy(moving(3, 20, 22), 0.1)
    groups = grouped(view, side=side, patches=patches, step=side, exact=True)
    weight, out = 2 * np.sqrt(2 * patches) * 0.1**2, np.empty_like(view)
    groups.filter(view, None, 0.1, out)
    expected = aggregated(view, groups, lambda places, group: proximal(group, weight))
    np.testing.assert_allclose(out, expected, atol=2e-5)
    assert np.abs(out - view).max() > 0.02


@pytest.mark.parametrize(("side", "patches"), SIZES)
def test_one_reweighting_is_that_of_numpy(side, patches):
    clean = moving(3, 20, 22)
    view, pilot = noisy(clean, 0.1), noisy(clean, 0.02)
    groups = grouped(view, side=side, patches=patches, step=side)

    def low_rank(places, group):
        signal = patches_at(pilot, places, side)[0]
        return reweighted(group, signal - signal.mean(0), 2 * np.sqrt(2 * patches) * 0.1**2)

    out = np.empty_like(view)
    groups.filter(view, pilot, 0.1, out)
    np.testing.assert_allclose(out, aggregated(view, groups, low_rank), atol=2e-5)
    assert np.abs(out - view).max() > 0.02


def test_reweighting_leads_to_the_closed_form():
    """The fixed point of the reweighting is the minimum, unless a singular value is near the one that vanishes."""
    group, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((20, 6)))
    group = (group * [4.0, 3.0, 2.0, 0.5, 0.3, 0.1]).T
    low = group
    for _ in range(200):
        low = reweighted(group, low, 0.2)
    np.testing.assert_allclose(low, proximal(group, 0.2), atol=1e-6)


@pytest.mark.parametrize("size", [1, 2, 7, 36])
def test_eigenvectors(size):
    matrix = np.random.default_rng(size).standard_normal((size, size + 3)).astype(np.float32)
    matrix[-1] = matrix[0]  # one eigenvalue is 0
    gram, vectors = matrix @ matrix.T, np.empty((size, size), np.float32)
    expected, values = np.linalg.eigvalsh(gram.astype(np.float64)), gram.copy()
    matrices.eigen(values, vectors)
    np.testing.assert_allclose(np.sort(np.diag(values)), expected, atol=1e-5 * expected[-1])
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(size), atol=1e-5)
    np.testing.assert_allclose(vectors.T @ np.diag(np.diag(values)) @ vectors, gram, atol=1e-5 * expected[-1])


@pytest.mark.parametrize("exact", [False, True])
def test_groups_of_low_rank_survive(exact):
    """A ramp that becomes brighter: all patches are multiples of few, far above the noise."""
    view = np.linspace(0, 1, 40, dtype=np.float32) * np.linspace(0.5, 1, 4, dtype=np.float32)[:, None, None]
    view = np.ascontiguousarray(np.broadcast_to(view, (4, 40, 40)))
    groups, out = grouped(view, patches=16, exact=exact), np.empty_like(view)
    groups.filter(view, view, 0.002, out)
    assert np.abs(out - view).max() < 1e-3
    groups.filter(noisy(view, 0.02), view, 0.06, out)
    assert np.std(out - view) < 0.4 * 0.02


def test_groups_hold_the_nearest_patches_along_the_motion():
    """Every patch whose scene stays in view is in the group once for each frame that is searched."""
    view = moving(step=(2, 3))
    groups = grouped(view, patches=5, near=1, neighbours=2, reach=0)
    b, rows, columns = 2, *view.shape[1:]
    for i, top in enumerate(groups.tops):
        for j, left in enumerate(groups.lefts):
            where = [(n, top - 2 * (n - b), left - 3 * (n - b)) for n in range(5)]
            if all(4 <= r <= rows - 12 and 4 <= c <= columns - 12 for _, r, c in where):
                assert set(groups.found[b, i, j]) == {(n * rows + r) * columns + c for n, r, c in where}
    assert (groups.found[..., 0] // (rows * columns) == np.arange(5)[:, None, None]).all()


def test_missing_patches_are_the_first():
    groups = grouped(moving(1, 8, 9), patches=6, side=8, step=1)
    assert set(groups.found[0, 0, 0]) == {0, 1}
    assert (groups.found[0, 0, 0] == 0).sum() == 5


@pytest.mark.parametrize(("length", "side", "step"), [(8, 8, 8), (9, 8, 8), (64, 8, 8), (50, 6, 4), (5, 2, 1)])
def test_patches_cover_a_line(length, side, step):
    first = grid(length, side, step)
    assert (first[0], first[-1]) == (0, length - side)
    assert ((np.diff(first) > 0) & (np.diff(first) <= step)).all()


def test_the_same_with_any_number_of_threads():
    """Bit for bit, and large enough that several threads are at work."""
    view = moving(4, 96, 100)
    groups, out = grouped(view, patches=16), np.empty_like(view)
    assert view.size > PARALLEL_FROM
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            groups.search(view, 0.05)
            found = groups.found.copy()
            results.append([found])
            for pilot in (None, view):
                groups.filter(noisy(view, 0.1), pilot, 0.1, out)
                results[-1].append(out.copy())
    finally:
        numba.set_num_threads(before)
    for one, several in zip(*results):
        np.testing.assert_array_equal(one, several)


def test_views_do_not_mix_once_groups_serve():
    x = noisy(np.stack([moving(), moving()[::-1]]), 0.1)
    other = x.copy()
    other[1] = x[1, ::-1]
    together, alone, changed = (DeSCI(renew=2).begin(v.shape, v.dtype) for v in (x, x[:1], other))
    for _ in range(4):
        made = together(x, 0.1)
        np.testing.assert_array_equal(alone(x[:1], 0.1), made[:1])
        np.testing.assert_array_equal(changed(other, 0.1)[0], made[0])


def test_better_along_the_motion_than_frame_by_frame():
    clean = moving(step=(2, 3))[None]
    seen = noisy(clean, 0.1)
    alone, still, along = (
        psnr(denoise(seen, 0.1, prior), clean).mean()
        for prior in (DeSCI(neighbours=0), DeSCI(motion=False, near=1), DeSCI())
    )
    assert along > max(alone, still) + 0.3


@pytest.mark.parametrize("sigma", [1e-9, 1e-5, 1e3, 1e30])
def test_any_sigma_once_groups_serve(sigma):
    x = moving()[None]
    session = DeSCI(renew=2).begin(x.shape, x.dtype)
    for _ in range(3):
        out = session(x, sigma)
        assert np.isfinite(out).all()
    if sigma < 1e-3:
        np.testing.assert_allclose(out, x, atol=20 * sigma)


@pytest.mark.parametrize("sigma", [1e-5, 1e-4, 1e-3])
def test_patterns_of_few_patches_survive_little_noise(sigma):
    """Stripes that move: thousands of patches are alike, and far above the noise."""
    stripes = ((np.arange(40) + np.arange(4)[:, None]) // 5 % 2).astype(np.float32)
    x = np.ascontiguousarray(np.broadcast_to(stripes[:, None], (1, 4, 40, 40)))
    session = DeSCI().begin(x.shape, x.dtype)
    for _ in range(8):
        np.testing.assert_allclose(session(x, sigma), x, atol=10 * sigma)


def test_no_radius_is_too_large():
    view = moving(3, 20, 22)
    whole, beyond = (grouped(view, reach=reach, near=reach).found for reach in (22, sys.maxsize))
    np.testing.assert_array_equal(whole, beyond)


def test_places_in_long_videos_have_a_type_that_holds_them():
    shape = 600, 2048, 2048
    found = Groups(DeSCI(patches=2, side=64, step=64), shape).found
    assert np.iinfo(found.dtype).max >= np.prod(shape)
    assert grouped(moving()).found.dtype == np.int32


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of memory as Linux has it")
def test_memory_does_not_grow_with_the_square_of_the_frames():
    """Groups with patches of all frames: one set of sums for all frames would have half a gigabyte."""
    import resource

    view = moving(64, 128, 128, step=(0, 1))
    groups, out = Groups(DeSCI(patches=2, neighbours=63), view.shape), np.empty_like(view)
    groups.found[:] = np.arange(view.size).reshape(view.shape)[:, groups.tops][:, :, groups.lefts][..., None]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    groups.filter(view, view, 0.1, out)
    np.testing.assert_allclose(out, view, atol=1e-5)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kilobytes


@pytest.mark.parametrize("shape", [(1, 2, 7, 40), (2, 3, 5, 5)])
def test_frames_smaller_than_a_patch_are_left_to_tv(shape):
    x = np.random.default_rng(0).random(shape, np.float32)
    low_rank, tv = (prior.begin(x.shape, x.dtype) for prior in (DeSCI(), TV()))
    for _ in range(3):
        np.testing.assert_array_equal(low_rank(x, 0.1), tv(x, 0.1))
    assert not DeSCI().traits(shape).average


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"patches": 1}, "patches is 1: a whole number >= 2"),
        ({"side": 0.5}, "side is 0.5: a whole number >= 2"),
        ({"step": 9}, "step is 9: at most the side of a patch was expected, which is 8"),
        ({"renew": 0}, "renew is 0: a whole number >= 1"),
        ({"near": -1}, "near is -1: a whole number >= 0"),
        ({"strength": 0}, "strength is 0: a finite number > 0"),
        ({"begin_strength": float("nan")}, "begin_strength is nan"),
        ({"beside": -1}, "beside is -1"),
        ({"first": -1}, "first is -1"),
    ],
)
def test_unfit_parameters_are_named(parameters, message):
    with pytest.raises(InputError, match=message):
        DeSCI(**parameters)


def test_the_published_parameters():
    """60 calls each at falling noise, given to a solver whose sigma is 0.05."""
    published = DeSCI.published()
    assert published.calls == 300
    levels = [(255 * 0.05 * stage.strength, stage.side, stage.patches) for stage, _ in published.stages]
    np.testing.assert_allclose(levels, [(100, 9, 140), (50, 8, 120), (25, 7, 90), (12, 6, 70), (6, 6, 70)])


def test_the_published_parameters_in_the_solver():
    """On a tiny scene, with a call of each stage."""
    scene = datasets.embedded_scene(16)
    stages = Stages([(prior, 1) for prior, _ in DeSCI.published().stages])
    result = pnp_sci.solve(scene.y, scene.masks, stages)
    assert len(result.history) == 6
    assert np.isfinite(result.x).all()
    assert result.history[-1].residual < 0.2


def test_better_than_total_variation_in_the_solver():
    scene = datasets.embedded_scene(64)
    by_tv, by_groups = (pnp_sci.solve(scene.y, scene.masks, prior) for prior in (TV(), DeSCI()))
    assert np.mean(psnr(by_groups.x, scene.truth)) > np.mean(psnr(by_tv.x, scene.truth)) + 1
