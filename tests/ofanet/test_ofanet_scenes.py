"""What OFaNet is trained on: scenes, masks and motion."""

from itertools import product

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter

torch = pytest.importorskip("torch")
clips = pytest.importorskip("pnp_sci.training.clips")
flow = pytest.importorskip("ofanet_init.flow")
motion = pytest.importorskip("ofanet_init.train.motion")
scenes = pytest.importorskip("ofanet_init.train.scenes")
training_masks = pytest.importorskip("ofanet_init.train.masks")

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def random_clip(*shape, name="clip"):
    return clips.Clip(name, np.random.default_rng(0).integers(0, 256, shape, np.uint8))


def cropped(*given, samples, frames, size):
    """Crops of `given` clips as bytes."""
    made = scenes.Scenes(given, CPU).crops(scenes.generator(CPU, 0, 0, 0), samples, frames, size)
    assert made.shape == (samples, frames, size, size)
    assert made.dtype == torch.float32
    return (255 * made).round().byte().numpy()


def ways(crop):
    """The 8 ways in which a crop may be turned and mirrored."""
    return [np.rot90(crop, quarter, (1, 2))[..., ::mirror] for quarter, mirror in product(range(4), (1, -1))]


def places(video, crop):
    """Number of the way in which all frames of a crop lie in the video, and where they do (frame, row, column)."""
    windows = sliding_window_view(video, crop.shape[1:], (1, 2))
    for number, way in enumerate(ways(crop)):
        found = [np.argwhere((windows == frame).all((-2, -1))) for frame in way]
        if all(map(len, found)):
            yield number, np.array([first for first, *_ in found])


def test_crops_are_pieces_of_the_clip():
    """Each lies in the clip in one of the 8 ways, its frames 1 or 2 apart, onward or back; all of these occur."""
    clip = random_clip(9, 14, 12)
    found = set()
    for crop in cropped(clip, samples=200, frames=3, size=6):
        [(way, where)] = places(clip.frames, crop)
        first, second = np.diff(where, axis=0).tolist()
        assert first == second
        assert first[1:] == [0, 0], "a crop of a clip stays where it is"
        found.add((way, first[0]))
    assert found == set(product(range(8), (-2, -1, 1, 2)))


def test_clip_shorter_or_smaller_than_the_crop_is_folded():
    """Its frames come there and back; a picture too small is mirrored at its edges, as numpy's "reflect" does it."""
    clip = random_clip(3, 5, 5)
    whole = np.pad(clip.frames, ((0, 16), (0, 3), (0, 3)), "reflect")
    for crop in cropped(clip, samples=20, frames=8, size=8):
        possible = [whole[: 8 * step : step] for step in (1, 2)]
        assert any(np.array_equal(way, p) for p in possible for way in ways(crop) + ways(crop[::-1]))


def test_photograph_pans():
    """Frames of a photograph lie on a line, at most 3 pixels a frame apart; beyond its edges it is reflected."""
    photograph = random_clip(1, 20, 24)
    padded = np.pad(photograph.frames, ((0, 0), (10, 10), (10, 10)), "reflect")
    moved = []
    for crop in cropped(photograph, samples=40, frames=4, size=8):
        path = next(where for _, where in places(padded, crop))[:, 1:]
        assert np.abs(path - np.linspace(path[0], path[-1], 4)).max() <= 1
        moved.append(np.abs(path - path[0]).max())
    assert 0 < max(moved) <= 3 * 3 + 1
    assert np.mean(np.array(moved) > 1) > 0.8


def test_a_fifth_of_the_samples_are_photographs():
    dark, bright = clips.Clip("clip", np.zeros((4, 8, 8), np.uint8)), clips.Clip("still", np.full((1, 8, 8), 255, "u1"))
    share = cropped(dark, bright, samples=2000, frames=2, size=2).mean() / 255
    assert share == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("length", [1, 2, 5])
def test_folded_is_reflection(length):
    index = torch.arange(-30, 31)
    expected = np.pad(np.arange(length), (30, 30), "reflect" if length > 1 else "edge")[: len(index)]
    assert np.array_equal(scenes.folded(index, torch.tensor(length)), expected)


def shifted(after, before, by):
    """Whether one picture is the other moved by so many rows and columns, where both show it."""
    (r, c), (rows, columns) = by, before.shape
    seen = after[max(r, 0) : rows + min(r, 0), max(c, 0) : columns + min(c, 0)]
    return np.array_equal(seen, before[max(-r, 0) : rows + min(-r, 0), max(-c, 0) : columns + min(-c, 0)])


def test_masks_are_the_kinds_that_are_stated():
    """Binary ones: a pattern that moves the same from frame to frame, half of them as the camera's; or independent."""
    source = scenes.Scenes([random_clip(6, 44, 44)], CPU)
    kinds, densities, leaks, grey = [], [], [], []
    for step in range(80):
        masks = scenes.batch(source, 0, 0, step, (4, 2, 4, 40, 40)).masks.numpy()
        assert masks.shape == (4, 2, 4, 40, 40)
        assert masks.dtype == np.float32
        batch = []
        for sample in masks:
            levels = np.unique(sample)
            grey.append(len(levels) > 2)
            if grey[-1]:
                continue
            assert len(levels) == 2
            assert 0 <= levels[0] <= 0.2
            assert levels[1] == 1
            leaks.append(levels[0] > 0)
            densities.append((sample == 1).mean())
            steps = [by for by in product(range(-2, 3), repeat=2) if shifted(sample[0, 1], sample[0, 0], by)]
            batch.append(steps[0] if steps else None)
            for view, b in product(range(2), range(4)) if steps else ():
                assert shifted(sample[view, b], sample[view, 0], (b * steps[0][0], b * steps[0][1]))
            if steps == [(1, -1)] and shifted(sample[1, 0], sample[0, 0], (15, -18)):
                batch[-1] = "camera"
        assert len({kind is None for kind in batch}) <= 1, "a batch is of one kind"
        kinds += batch
    moving = [kind for kind in kinds if kind is not None]
    assert (len(kinds) - len(moving)) / (len(kinds) + sum(grey)) == pytest.approx(0.1, abs=0.08)
    assert sum(grey) / (len(moving) + sum(grey)) == pytest.approx(0.4, abs=0.08)
    assert moving.count("camera") / len(moving) == pytest.approx(0.5, abs=0.08)
    assert len(set(moving)) > 15, "the others move in every direction"
    assert np.mean(leaks) == pytest.approx(0.2, abs=0.07)
    assert 0.26 < min(densities) < 0.35
    assert 0.65 < max(densities) < 0.74
    assert np.mean(densities) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("density", [0.3, 0.5, 0.7])
def test_grey_masks_are_blurred_patterns_of_a_density(density):
    pattern = torch.rand(20, 64, 64, generator=torch.Generator().manual_seed(0))
    column = torch.ones(20, 1, 1)
    sharp, soft = (training_masks.grey(pattern, density * column, blur * column, 0.5 * column) for blur in (0.3, 1.2))
    for masks in (sharp, soft):
        assert 0 == masks.min() < masks.median() < masks.max() == 1
        assert (masks > 0.5).float().mean() == pytest.approx(density, abs=0.06)

    def alike(masks):  # of neighbours
        change = masks - masks.mean()
        return ((change[:, 1:] * change[:, :-1]).mean() / change.square().mean()).item()

    assert alike(sharp) < 0.15
    assert alike(soft) > 0.6


def test_some_views_are_darker():
    source = scenes.Scenes([clips.Clip("clip", np.full((6, 20, 20), 255, np.uint8))], CPU)
    levels = scenes.batch(source, 0, 0, 0, (400, 2, 2, 8, 8)).truth.amax((2, 3, 4))
    same = (levels == 1).all(1).float().mean().item()
    assert same == pytest.approx(0.5, abs=0.08)
    assert 0.3 <= levels.min() < 0.35


def test_batches_depend_on_seed_rank_and_step_only():
    source = scenes.Scenes([random_clip(6, 20, 20)], CPU)
    first, again, *others = (
        scenes.batch(source, *key, (2, 2, 3, 16, 16)) for key in [(0, 1, 2), (0, 1, 2), (1, 1, 2), (0, 0, 2), (0, 1, 3)]
    )
    for name in ("y", "masks", "truth"):
        assert torch.equal(getattr(first, name), getattr(again, name))
        assert not any(torch.equal(getattr(first, name), getattr(other, name)) for other in others)


def test_measurement_is_the_sum_of_masked_frames():
    """To rounding where there is no noise, in seven of ten; else the noise is at most a fifth of the maximum."""
    source = scenes.Scenes([random_clip(6, 20, 20)], CPU)
    made = scenes.batch(source, 0, 0, 0, (200, 2, 3, 16, 16))
    clean = torch.einsum("nvbhw,nvbhw->nhw", made.masks.double(), made.truth.double())
    noise = (made.y - clean).std((1, 2)) / clean.amax((1, 2))
    assert (noise > 1e-6).float().mean().item() == pytest.approx(0.3, abs=0.1)
    assert 0.1 < noise.max() < 0.23


@pytest.fixture
def pairs(monkeypatch):
    """First and second pictures of smooth textures, before they are spoiled, and their flow."""
    monkeypatch.setattr(motion, "spoiled", lambda picture, *_: picture)
    texture = gaussian_filter(np.random.default_rng(0).random((16, 96, 96)), (0, 3, 3)).astype(np.float32)
    frames = torch.from_numpy((texture - texture.min()) / np.ptp(texture))
    return motion.pairs(frames, scenes.generator(CPU, 0, 0, 0))


def test_flow_of_a_pair_is_its_motion(pairs):
    """Fetched along the flow the second picture is the first, but for what is hidden there."""
    first, second, truth = pairs
    assert first.shape == second.shape == (8, 1, 96, 96)
    assert truth.shape == (8, 2, 96, 96)
    speed = truth.norm(dim=1, keepdim=True)
    assert 1 < speed.mean() < 12
    right, wrong = ((flow.warped(second, f) - first).abs()[speed > 3] < 0.02 for f in (truth, -truth))
    assert right.float().mean() > 0.8
    assert wrong.float().mean() < 0.3


def test_loss_of_the_flow_stage(pairs):
    """0 for the truth at every scale, and the less the nearer a flow comes to it."""
    truth = pairs[2]
    assert motion.end_point_error(truth, truth).item() == pytest.approx(0, abs=2e-3)
    offset = torch.tensor([3.0, -4.0])[:, None, None]
    assert motion.end_point_error(truth + offset, truth).item() == pytest.approx(5, abs=1e-3)
    scales = [torch.nn.functional.avg_pool2d(truth, 2**k) for k in range(5, 0, -1)]
    losses = [motion.pyramid_loss([part * scale for scale in scales], truth).item() for part in (1, 0.9, 0.5, 0, -1)]
    assert losses[0] == pytest.approx(0, abs=4e-3)
    assert losses == sorted(losses)
    assert losses[1] > 0.05
    off = [[scale + offset if k == wrong else scale for k, scale in enumerate(scales)] for wrong in (4, 3, 0)]
    assert [motion.pyramid_loss(flows, truth).item() for flows in off] == pytest.approx([5, 5 / 2, 5 / 16], abs=4e-3)
