"""OFaNet's trainer: its command line, its stages and its gradients."""

import imageio.v3 as iio
import numpy as np
import pytest
from click.testing import CliRunner
from interrupting import interrupted_before

from pnp_sci.errors import DataUnavailableError, FormatError, InputError

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
clips = pytest.importorskip("pnp_sci.training.clips")
loop = pytest.importorskip("pnp_sci.training.loop")
cli = pytest.importorskip("ofanet_init.train.__main__")
config = pytest.importorskip("ofanet_init.config")
network = pytest.importorskip("ofanet_init.network")
tasks = pytest.importorskip("ofanet_init.train.tasks")
weights = pytest.importorskip("ofanet_init.files")


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
def test_resumed_run_equals_an_uninterrupted_one(folder, tmp_path, stage):
    assert run(stage, tmp_path / "whole", "--data", folder, steps=4).exit_code == 0
    with interrupted_before(2):
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
        ("dns", "--resume", FormatError, "checkpoint.pt"),
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
