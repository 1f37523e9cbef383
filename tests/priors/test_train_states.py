"""What a network sees within the solver, as material for its training."""

import numpy as np
import pytest
from click.testing import CliRunner

from pnp_sci.errors import InputError

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
clips = pytest.importorskip("pnp_sci.training.clips")
files = pytest.importorskip("priors.networks.files")
loop = pytest.importorskip("pnp_sci.training.loop")
shipped = pytest.importorskip("priors.networks.image").WEIGHTS / "video.safetensors"
states = pytest.importorskip("priors.train.states")
task = pytest.importorskip("priors.train.task")
cli = pytest.importorskip("priors.train.__main__")

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def network():
    """The network of the prior "video"."""
    return files.load(shipped, "video")[0]


@pytest.fixture
def watch(folder):
    training, _ = clips.split(clips.load_clips([folder]))
    return lambda rank=0: states.Watch(training, "video", solves=2, crop=32, seed=1, rank=rank)


def test_states_are_what_the_network_sees_and_its_truth(network, watch):
    found, again, other = watch()(network), watch()(network), watch(rank=1)(network)
    assert found.frames.shape == found.level.shape == found.truth.shape
    assert found.frames.shape[1:] == (32, 32)
    assert len(found.frames) > states.FRAMES
    error, elsewhere = (np.square(found.frames - truth).mean() for truth in (found.truth, found.truth[::-1]))
    assert error < 0.8 * elsewhere, "each frame lies beside its own truth"
    assert np.array_equal(again.truth, found.truth)
    assert np.array_equal(again.frames, found.frames)
    assert not np.array_equal(other.truth[:1], found.truth[:1])
    frames, level, truth = found.draw(np.random.default_rng(0), 7)
    assert frames.shape == level.shape == truth.shape == (7, 32, 32)
    assert frames.dtype == np.float32


def test_states_are_those_of_the_network_that_is_given(network, watch):
    usual = watch()(network)
    torch.nn.init.zeros_(network.tail.weight)
    idle = watch()(network)
    assert np.array_equal(idle.truth, usual.truth)
    assert not np.array_equal(idle.frames, usual.frames)


def test_truth_is_in_the_units_that_the_network_sees(network, watch, monkeypatch):
    half = states.pnp_sci.simulate
    usual = watch()(network)
    monkeypatch.setattr(states.pnp_sci, "simulate", lambda truth, *args, **kwargs: half(truth * 0.5, *args, **kwargs))
    darker = watch()(network)
    assert np.median(darker.truth / np.maximum(usual.truth, 0.1)) == pytest.approx(2, rel=0.1), (
        "its unit is half as large"
    )


def test_solves_need_weights_and_are_on_the_card(folder, tmp_path):
    start = tmp_path / "start.safetensors"
    common = ["ffdnet", "--data", str(folder), "--steps", "2", "--crop", "32", "--batch", "2", "--out", str(tmp_path)]
    common += ["--validations", "2"]
    finished = tmp_path / "checkpoint.pt"
    for more, message in (
        (["--solves", "1"], "solves: weights to --start from"),
        (["--solves", "1", "--start", str(start), "--crop", "31"], "crop is 31: 32 pixels at least"),
    ):
        refused = CliRunner().invoke(cli.main, [*common, *more])
        assert isinstance(refused.exception, InputError)
        assert message in str(refused.exception)
    for more in (["--weights", str(start)], ["--start", str(start), "--solves", "1"]):
        result = CliRunner().invoke(cli.main, [*common, *more], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        finished.unlink()
    card = (tmp_path / "ffdnet.md").read_text()
    assert "--start start.safetensors --solves 1" in card
    frames = int(card.split(" such frames")[0].split()[-1])
    assert states.FRAMES < frames <= 2 * states.CALLS * states.FRAMES, "two collections; the third is for later steps"
    assert "such frames" not in start.with_suffix(".md").read_text()


@pytest.mark.parametrize(("off", "sign"), [(0, -1), (1, 1)])
def test_half_of_the_loss_is_from_the_solver(folder, watch, tmp_path, off, sign):
    """Flat frames are easy where they are the truth, and never right where the truth is ten sigma away."""
    material = clips.split(clips.load_clips([folder]))
    place, start = loop.Place.here(), shipped
    common = ("video", *material, task.Sample(8, 1, 32), 0, tmp_path / "weights.safetensors", "by a test", start)
    alone, both = task.Denoising(*common), task.Denoising(*common, watch())
    flat = np.full((9, 32, 32), 0.5, np.float16)
    both.collections = [states.States(flat, 0.1 * np.ones_like(flat), flat + np.float16(off))]
    with torch.no_grad():
        of_noise, mean = (float(t.loss(t.network, place, 0)) for t in (alone, both))
    assert sign * (2 * mean - of_noise) > 2
