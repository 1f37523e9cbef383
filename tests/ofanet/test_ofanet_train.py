"""OFaNet's trainer: the scenes, masks and motion it makes, its command line, and what the shipped weights hold to."""

from itertools import product

import cv2
import imageio.v3 as iio
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.errors import DataUnavailableError, FormatError, InputError
from pnp_sci.masks import moving_masks, random_masks

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
clips = pytest.importorskip("pnp_sci.training.clips")
loop = pytest.importorskip("pnp_sci.training.loop")
cli = pytest.importorskip("ofanet_init.train.__main__")
config = pytest.importorskip("ofanet_init.config")
flow = pytest.importorskip("ofanet_init.flow")
motion = pytest.importorskip("ofanet_init.train.motion")
network = pytest.importorskip("ofanet_init.network")
scenes = pytest.importorskip("ofanet_init.train.scenes")
tasks = pytest.importorskip("ofanet_init.train.tasks")
weights = pytest.importorskip("ofanet_init.files")

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Validation on pictures of 32 pixels, and one thread."""
    monkeypatch.setattr(tasks, "SIZE", 32)
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


# scenes


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
    """Frames of a photograph lie on a line, at most PAN pixels a frame apart; beyond its edges it is reflected."""
    photograph = random_clip(1, 20, 24)
    padded = np.pad(photograph.frames, ((0, 0), (10, 10), (10, 10)), "reflect")
    moved = []
    for crop in cropped(photograph, samples=40, frames=4, size=8):
        path = next(where for _, where in places(padded, crop))[:, 1:]
        assert np.abs(path - np.linspace(path[0], path[-1], 4)).max() <= 1
        moved.append(np.abs(path - path[0]).max())
    assert 0 < max(moved) <= 3 * scenes.PAN + 1
    assert np.mean(np.array(moved) > 1) > 0.8


def test_a_fifth_of_the_samples_are_photographs():
    dark, bright = clips.Clip("clip", np.zeros((4, 8, 8), np.uint8)), clips.Clip("still", np.full((1, 8, 8), 255, "u1"))
    share = cropped(dark, bright, samples=2000, frames=2, size=2).mean() / 255
    assert share == pytest.approx(scenes.STILL, abs=0.03)


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
    """One pattern that moves the same from frame to frame, mostly as the camera's; or, in few batches, independent."""
    source = scenes.Scenes([random_clip(6, 44, 44)], CPU)
    kinds, densities, leaks = [], [], []
    for step in range(80):
        masks = scenes.batch(source, 0, 0, step, (4, 2, 4, 40, 40)).masks.numpy()
        assert masks.shape == (4, 2, 4, 40, 40)
        assert masks.dtype == np.float32
        batch = []
        for sample in masks:
            levels = np.unique(sample)
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
        assert len({kind is None for kind in batch}) == 1, "a batch is of one kind"
        kinds += batch
    moving = [kind for kind in kinds if kind is not None]
    assert 1 - len(moving) / len(kinds) == pytest.approx(scenes.INDEPENDENT, abs=0.08)
    assert moving.count("camera") / len(moving) == pytest.approx(scenes.CAMERA, abs=0.08)
    assert len(set(moving)) > 15, "the others move in every direction"
    assert np.mean(leaks) == pytest.approx(scenes.LEAK, abs=0.07)
    assert 0.26 < min(densities) < 0.35
    assert 0.65 < max(densities) < 0.74
    assert np.mean(densities) == pytest.approx(0.5, abs=0.02)


def test_batches_depend_on_seed_rank_and_step_only():
    source = scenes.Scenes([random_clip(6, 20, 20)], CPU)
    first, again, *others = (
        scenes.batch(source, *key, (2, 2, 3, 16, 16)) for key in [(0, 1, 2), (0, 1, 2), (1, 1, 2), (0, 0, 2), (0, 1, 3)]
    )
    for name in ("y", "masks", "truth"):
        assert torch.equal(getattr(first, name), getattr(again, name))
        assert not any(torch.equal(getattr(first, name), getattr(other, name)) for other in others)


def test_measurement_is_the_sum_of_masked_frames():
    """To rounding where there is no noise, in seven of ten; else the noise is at most LOUDEST of the maximum."""
    source = scenes.Scenes([random_clip(6, 20, 20)], CPU)
    made = scenes.batch(source, 0, 0, 0, (200, 2, 3, 16, 16))
    clean = torch.einsum("nvbhw,nvbhw->nhw", made.masks.double(), made.truth.double())
    noise = (made.y - clean).std((1, 2)) / clean.amax((1, 2))
    assert (noise > 1e-6).float().mean().item() == pytest.approx(scenes.NOISY, abs=0.1)
    assert 0.5 * scenes.LOUDEST < noise.max() < 1.15 * scenes.LOUDEST


# motion


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
    assert 1 < speed.mean() < motion.LARGEST
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


# the command line


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    random = np.random.default_rng(0)
    for name in ("ball_1", "ball_2", "car", "dog"):
        frames = np.kron(random.integers(0, 256, (12, 8, 8, 1)), np.ones((1, 6, 6, 3))).astype(np.uint8)
        iio.imwrite(folder / f"{name}.mp4", frames, plugin="FFMPEG", fps=10)
    (folder / "still").mkdir()
    iio.imwrite(folder / "still" / "photograph.jpg", random.integers(0, 256, (40, 36), np.uint8))
    return folder


def run(stage, out, *more, steps=2):
    """The command line, for 2 frames of 32 x 32 on the CPU."""
    fixed = f"--stage {stage} --out {out} --steps {steps} --frames 2 --crop 32 --batch 1 --device cpu --validations 2"
    return CliRunner().invoke(cli.main, [*fixed.split(), *map(str, more)])


def parts(path):
    """The weights in a file, those of the separator, of the flow net and of the refine net apart."""
    state = weights.load(path)[0].state_dict()
    return [{k: v for k, v in state.items() if k.startswith(name)} for name in ("separator", "flow", "refiners")]


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[key], other[key]) for key in one)


ENDS = [("cnn1.0.0", "weight"), ("cnn3.2.4", "weight"), ("cnn3.2.4", "bias")]  # layers that depend on the frames


def test_stages_one_after_the_other(folder, tmp_path):
    """Each writes its files, starts from the stage before, and changes what it trains and nothing else."""
    start, heads = [], {"dns": "psnr_first,psnr_refined", "flow": "end_point_error,of_no_motion"}
    for stage in ("dns", "flow", "refine", "joint"):
        out = tmp_path / stage
        result = run(stage, out, "--data", folder, "--data", folder / "still", *start)
        assert result.exit_code == 0, result.output
        model, digest = weights.load(out / "ofanet.safetensors")
        card = (out / "ofanet.md").read_text()
        assert digest in card
        assert f"--stage {stage} --data {folder.name} --data still --views 2 --frames 2 --steps 2" in card
        assert "2 clips (24 frames) and 1 photographs" in card
        assert "ball_1" in card
        assert str(tmp_path) not in card, "the card must not tell where things lay"
        state = torch.load(out / "checkpoint.pt", weights_only=True)
        assert state["progress"]["step"] == 2
        written, prefix = model.state_dict(), "flow." if stage == "flow" else ""
        average = {prefix + key: value for key, value in state["average"].items()}
        assert same({key: written[key] for key in average}, {key: v.half().float() for key, v in average.items()})
        curves = (out / "curves.csv").read_text().splitlines()
        assert curves[0] == "step,minutes,loss," + heads.get(stage, heads["dns"])
        rows = np.array([line.split(",") for line in curves[1:]], float)
        assert rows[:, 0].tolist() == [1, 2]
        assert (rows[:, 2:] > 0).all()
        start = ["--start", out / "ofanet.safetensors"]
    dns, moving, refined, joint = (
        parts(tmp_path / stage / "ofanet.safetensors") for stage in ("dns", "flow", "refine", "joint")
    )
    assert not dns[1]
    assert not dns[2]
    assert same(dns[0], moving[0]), "the stage flow leaves the separator alone"
    assert same(moving[0], refined[0]), "and so does the stage refine"
    assert not same(moving[1], refined[1])
    assert not same(moving[2], refined[2])
    for before, after in zip(refined, joint):
        assert before.keys() == after.keys()
        assert not same(before, after)
        assert max((before[key] - after[key]).abs().max() for key in before) < 0.05, "it starts where refine ended"


def test_frozen_the_stage_refine_leaves_the_flow_net_alone(folder, tmp_path):
    shipped = weights.FOLDER / "v2b10.safetensors"
    assert run("refine", tmp_path, "--data", folder, "--start", shipped, "--frozen").exit_code == 0
    (_, flow, refiners), (_, flow_after, refiners_after) = parts(shipped), parts(tmp_path / "ofanet.safetensors")
    assert same(flow, flow_after)
    assert not same(refiners, refiners_after)


def test_frozen_the_flow_net_still_learns_in_its_own_stage(folder, tmp_path):
    shipped = weights.FOLDER / "v2b10.safetensors"
    assert run("flow", tmp_path, "--data", folder, "--start", shipped, "--frozen").exit_code == 0
    assert not same(parts(shipped)[1], parts(tmp_path / "ofanet.safetensors")[1])


def test_passes_are_kept_with_the_weights(folder, tmp_path):
    given = "--data", folder, "--start", weights.FOLDER / "v2b10.safetensors"
    assert run("refine", tmp_path, *given, "--passes", 2).exit_code == 0
    assert "--passes 2" in (tmp_path / "ofanet.md").read_text()
    assert weights.load(tmp_path / "ofanet.safetensors")[0].config.passes == 2
    forgotten = run("refine", tmp_path, *given, "--resume")
    assert isinstance(forgotten.exception, FormatError)
    assert "passes=2" in str(forgotten.exception)


@pytest.mark.parametrize("stage", ["flow", "joint"])
def test_resumed_run_equals_an_uninterrupted_one(folder, tmp_path, monkeypatch, stage):
    assert run(stage, tmp_path / "whole", "--data", folder, steps=4).exit_code == 0

    def interrupted(trainer, done, step=loop.Trainer.step):
        if trainer.progress.step == 2:
            raise KeyboardInterrupt
        return step(trainer, done)

    with monkeypatch.context() as patch:
        patch.setattr(loop.Trainer, "step", interrupted)
        assert run(stage, tmp_path / "parts", "--data", folder, steps=4).exit_code != 0
    result = run(stage, tmp_path / "parts", "--data", folder, "--resume", steps=4)
    assert result.exit_code == 0, result.output
    states = [torch.load(tmp_path / out / "checkpoint.pt", weights_only=True) for out in ("whole", "parts")]
    assert [state["progress"]["step"] for state in states] == [4, 4]
    assert same(states[0]["network"], states[1]["network"])
    files = [weights.load(tmp_path / out / "ofanet.safetensors")[1] for out in ("whole", "parts")]
    assert files[0] == files[1]


def test_start_takes_over_what_fits(folder, tmp_path):
    """Weights for ten frames start those for two: of the first and the last layer of a branch what two frames need."""
    shipped = weights.FOLDER / "v2b10.safetensors"
    assert run("dns", tmp_path, "--data", folder, "--start", shipped, "--rate", 1e-6, steps=1).exit_code == 0
    (before, *_), (after, *_) = parts(shipped), parts(tmp_path / "ofanet.safetensors")
    other = {key for key in before if before[key].shape != after[key].shape}
    assert other == {f"separator.branches.{v}.{layer}.{kind}" for v in (0, 1) for layer, kind in ENDS}
    for key, value in after.items():
        assert (before[key][tuple(map(slice, value.shape))] - value).abs().max() < 1e-3


@pytest.mark.parametrize(
    ("stage", "more", "error", "message"),
    [
        ("dns", "--data {out}/nowhere", SystemExit, "nowhere' does not exist"),
        ("dns", "--data {out}", FormatError, "no video and no photograph"),
        ("dns", "--resume", FormatError, "checkpoint.pt was expected"),
        ("flow", "--start {out}/nothing.safetensors", DataUnavailableError, "nothing.safetensors does not exist"),
        ("flow", "--start {folder}/car.mp4", FormatError, "car.mp4 is not a safetensors file"),
        ("dns", "--views 0", InputError, "views is 0"),
        ("joint", "--passes 0", InputError, "passes is 0"),
        ("dns", "--steps 0", SystemExit, "--steps"),
        ("dns", "--batch 0", SystemExit, "--batch"),
        ("flow", "--flow none", InputError, "stage is flow"),
        ("refine", "--refine both", SystemExit, "--refine"),
        ("refine", "--refine none --resume", InputError, "a refine net"),
        ("refine", "", InputError, "to --start from"),
        ("flow", "--crop 40", InputError, "crop is 40"),
        ("dns", "--minutes 0", SystemExit, "--minutes"),
    ],
)
def test_arguments_that_cannot_be(folder, tmp_path, stage, more, error, message):
    data = () if "--data" in more else ("--data", folder)
    result = run(stage, tmp_path, *data, *more.format(out=tmp_path, folder=folder).split())
    assert result.exit_code != 0
    assert isinstance(result.exception, error), repr(result.exception)
    assert message in result.output + str(result.exception)
    assert not list(tmp_path.glob("*.safetensors"))


def test_flow_stage_without_moving_clips(folder, tmp_path):
    """Photographs are enough to make pairs of: it trains, or says what is missing."""
    result = run("flow", tmp_path, "--data", folder / "still")
    assert result.exit_code == 0 or isinstance(result.exception, (FormatError, InputError)), repr(result.exception)


@pytest.mark.parametrize("joint", [True, False])
def test_joint_stage_trains_the_flow_net_unless_it_is_frozen(tmp_path, joint):
    """Gradients of the stage's own loss reach all of the flow net."""
    torch.manual_seed(0)
    model = network.OFaNet(config.OFaNetConfig(frames=3, joint=joint))
    for layer in (*model.flow.predict, model.refiners[0].cell.r[-1]):  # at 0, as they begin, they pass nothing on
        torch.nn.init.normal_(layer.weight, std=0.1)
    sample = tasks.Sample(1, 32, 3)
    place = loop.Place.here("cpu")
    task = tasks.Reconstruction("joint", model, [random_clip(6, 40, 40)], [], sample, 0, place, tmp_path / "w", "")
    task.loss(model, place, 0).backward()
    reached = [p.grad is not None and bool(p.grad.abs().max() > 0) for p in model.flow.parameters()]
    assert all(reached) if joint else not any(reached)


def test_each_number_of_passes_is_drawn_and_all_learns(tmp_path):
    torch.manual_seed(0)
    model = network.OFaNet(config.OFaNetConfig(frames=3, passes=2))
    for layer in (*model.flow.predict, model.refiners[0].cell.r[-1]):
        torch.nn.init.normal_(layer.weight, std=0.1)
    place, clip = loop.Place.here("cpu"), random_clip(6, 40, 40)
    task = tasks.Reconstruction("refine", model, [clip], [], tasks.Sample(1, 32, 2), 0, place, tmp_path / "w", "")
    seen = []

    def watched(*given, passes, **more):
        seen.append(passes)
        return model(*given, passes=passes, **more)

    for step in range(8):
        model.zero_grad()
        task.loss(watched, place, step).backward()
        assert all(p.grad is not None for part in (model.flow, model.refiners) for p in part.parameters())
        assert all(p.grad is None for p in model.separator.parameters())
    assert set(seen) == {1, 2}


# the shipped weights


def decoded(truth, masks, model="ofanet-fast"):
    return pnp_sci.decode(pnp_sci.simulate(truth, masks), masks, model=model).x


@pytest.fixture(scope="module")
def embedded():
    return pnp_sci.datasets.embedded_scene(96).truth


def opening(file):
    """The first ten frames of a video."""
    video = cv2.VideoCapture(str(file))
    return np.stack([cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY) for _ in range(10)])


@pytest.fixture(scope="module")
def held_out(data):
    """Central squares of the clips that no weights were trained on, two and two: (5, 2, 10, 256, 256)."""
    files = sorted((data / "train_video").glob("*.mp4"))
    if not files:
        pytest.skip("there is no folder train_video beside the data sets")
    names = clips.split([clips.Clip(file.stem, np.zeros((2, 1, 1), np.uint8)) for file in files])[1]
    videos = [opening(data / "train_video" / f"{clip.name}.mp4") for clip in names[:10]]
    squares = [v[:, (v.shape[1] - 256) // 2 :, (v.shape[2] - 256) // 2 :][:, :256, :256] for v in videos]
    return np.stack(squares).reshape(-1, 2, 10, 256, 256) / np.float32(255)


UNSEEN = {
    "independent": lambda shape: random_masks(shape, seed=11),
    "other way": lambda shape: moving_masks(shape, step=(-1, 1), seed=11),
    "other view": lambda shape: moving_masks(shape, view_shift=(7, -40), seed=11),
    "other direction": lambda shape: moving_masks(shape, step=(1, 1), seed=11),
}


def quality(truths, make, model="ofanet-fast"):
    return np.mean([pnp_sci.psnr(decoded(truth, make(truth.shape), model), truth).mean() for truth in truths])


@pytest.fixture(scope="module")
def usual(held_out):
    """PSNR in dB through masks that move as the benchmark's."""
    return quality(held_out, lambda shape: moving_masks(shape, seed=11))


def test_refine_net_gains(held_out):
    """In the middle of every other pair: it takes seconds for each."""
    separated, refined = (
        quality(held_out[::2, ..., 64:192, 64:192], lambda shape: moving_masks(shape, seed=11), model)
        for model in ("ofanet-fast", "ofanet")
    )
    print(f"ofanet {refined:.2f} dB, ofanet-fast {separated:.2f}")
    assert refined > separated + 0.3


@pytest.mark.parametrize(("views", "frames"), [(1, 8), (2, 6), (2, 14)])
def test_refine_nets_for_other_numbers_of_frames_gain(held_out, views, frames):
    """Beyond ten frames the clip runs back."""
    clip = np.concatenate([held_out, held_out[:, :, ::-1]], 2)[:3, :views, :frames, 64:192, 64:192]
    separated, refined = (
        quality(clip, lambda shape: moving_masks(shape, seed=11), model) for model in ("ofanet-fast", "ofanet")
    )
    print(f"ofanet {refined:.2f} dB, ofanet-fast {separated:.2f}")
    assert refined > separated + 0.3


@pytest.mark.parametrize("kind", UNSEEN)
def test_refine_net_gains_through_masks_unseen_in_training(embedded, kind):
    separated, refined = (quality([embedded], UNSEEN[kind], model) for model in ("ofanet-fast", "ofanet"))
    print(f"masks {kind}: ofanet {refined:.2f} dB, ofanet-fast {separated:.2f}")
    assert refined > separated + 0.1


@pytest.mark.parametrize("kind", ["independent", "other way", "other direction"])
def test_masks_unseen_in_training_lose_little(held_out, usual, kind):
    lost = usual - quality(held_out, UNSEEN[kind])
    print(f"masks {kind}: {lost:.2f} dB less than the usual {usual:.2f}")
    assert lost < 0.3


@pytest.mark.parametrize("kind", UNSEEN)
def test_masks_unseen_in_training_on_the_embedded_scene(embedded, kind):
    """Less than 0.9 dB: up to 0.73 here, and 0.82 in the mean of four seeds of masks that move the other way.

    Weights that are 0.3 dB worse through all of these masks lose 0.74.
    """
    lost = quality([embedded], lambda shape: moving_masks(shape, seed=11)) - quality([embedded], UNSEEN[kind])
    print(f"masks {kind}: {lost:.2f} dB less")
    assert lost < 0.9


def swapped_roles(truth, model):
    """With the masks of the views exchanged the same measurement gives the same videos, exchanged."""
    masks = moving_masks(truth.shape, seed=11)
    y = pnp_sci.simulate(truth, masks)
    plain, other = (pnp_sci.decode(y, m, model=model).x for m in (masks, masks[::-1]))
    usual, exchanged, wrong = (pnp_sci.psnr(x, truth) for x in (plain, other[::-1], other))
    print(f"PSNR {usual}, exchanged {exchanged}, of the other view {wrong}")
    assert np.abs(exchanged - usual).max() < (1 if model == "ofanet" else 1e-3)  # no view is the separator's first
    assert (wrong < usual - 2).all()


@pytest.mark.parametrize("model", ["ofanet", "ofanet-fast"])
def test_views_swap_roles(held_out, model):
    swapped_roles(held_out[0][..., 64:192, 64:192], model)


@pytest.mark.parametrize("model", ["ofanet", "ofanet-fast"])
def test_views_of_the_embedded_scene_swap_roles(embedded, model):
    swapped_roles(embedded, model)


@pytest.mark.parametrize(("prior", "init"), [("flow", "ofanet-fast"), ("video", "auto")])
def test_a_decoder_that_has_its_share_improves_noisy_results(held_out, prior, init):
    """Of clips that nothing was trained on, but some constants were chosen on them: 0.1 dB and more."""
    truth = held_out[0][..., 64:192, 64:192]
    masks = moving_masks(truth.shape, seed=1)
    y = pnp_sci.simulate(truth, masks, 0.03)
    start = pnp_sci.decode(y, masks, model="ofanet-fast").x
    known = {"prior": prior, "scene": "full", "reference": truth}
    named, given = (pnp_sci.solve(y, masks, init=init, **known).history[-1].psnr for init in (init, start))
    print(f"{prior}: {named:.2f} dB, without the decoder's share {given:.2f}")
    assert named > given + 0.1
