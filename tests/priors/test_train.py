"""The trainer from end to end on a few tiny clips: files, exact resume, the split, the noise, a paused clock."""

import os
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from interrupting import interrupted_before

from pnp_sci.errors import FormatError

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
clips = pytest.importorskip("pnp_sci.training.clips")
files = pytest.importorskip("priors.networks.files")
loop = pytest.importorskip("pnp_sci.training.loop")
shipped = pytest.importorskip("priors.networks.image").WEIGHTS
data = pytest.importorskip("priors.train.data")
task = pytest.importorskip("priors.train.task")
cli = pytest.importorskip("priors.train.__main__")

pytestmark = pytest.mark.usefixtures("one_thread")


def train(folder, out, name="video", steps=6, frames=8, seed=0, resume=False, optimizer="adam"):
    """One run of the loop as the command line makes it."""
    material = clips.split(clips.load_clips([folder]))
    sample = task.Sample(frames, 1, 32)
    denoising = task.Denoising(name, *material, sample, seed, out / "weights.safetensors", "by a test")
    budget = loop.Budget(out, steps=steps, seed=seed, optimizer=optimizer, validations=2)
    return loop.train(denoising, budget, loop.Place.here(), resume)


def test_command_line_writes_weights_curves_and_card(folder, tmp_path):
    weights = tmp_path / "ffdnet.safetensors"
    arguments = f"ffdnet --data {folder} --out {tmp_path / 'run'} --weights {weights} --steps 2 --crop 16 --batch 2"
    arguments += " --optimizer muon"
    result = CliRunner().invoke(cli.main, arguments.split(), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    _, digest = files.load(weights, "ffdnet")
    card = weights.with_suffix(".md").read_text()
    assert digest in card
    assert "2 clips (24 frames) and 1 photographs" in card
    assert f"--data {folder.name} --steps 2 --seed 0" in card
    assert "--optimizer muon" in card
    assert str(folder.parent) not in card, "the card must not tell where things lay"
    curves = (tmp_path / "run" / "curves.csv").read_text().splitlines()
    assert curves[0] == "step,minutes,loss,psnr_5,psnr_15,psnr_25,psnr_40"
    assert len(curves) == 3


def test_training_goes_on_from_other_weights(folder, tmp_path):
    first = tmp_path / "first.safetensors"
    common = ["ffdnet", "--data", str(folder), "--steps", "1", "--crop", "16", "--batch", "1"]
    for run, more in {"one": ["--weights", str(first)], "run": ["--start", str(first), "--seed", "1"]}.items():
        result = CliRunner().invoke(cli.main, [*common, "--out", str(tmp_path / run), *more], catch_exceptions=False)
        assert result.exit_code == 0, result.output
    begun, gone_on = (files.load(path, "ffdnet")[0] for path in (first, tmp_path / "run" / "ffdnet.safetensors"))
    for one, other in zip(begun.parameters(), gone_on.parameters()):
        torch.testing.assert_close(other, one, atol=1e-5, rtol=1e-3)
    card = (tmp_path / "run" / "ffdnet.md").read_text()
    assert "--start first.safetensors" in card
    assert "Training began with earlier weights." in card


def test_without_a_scene_to_hold_out_the_curves_say_so(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(clips, "split", lambda loaded: (loaded, []))
    progress = train(folder, tmp_path, steps=2)
    assert np.isnan(progress.rows[-1][3:]).all()
    assert "nan" in (tmp_path / "curves.csv").read_text()


@pytest.mark.parametrize("optimizer", loop.OPTIMIZERS)
def test_resumed_run_equals_an_uninterrupted_one(folder, tmp_path, optimizer):
    train(folder, tmp_path / "whole", optimizer=optimizer)
    with interrupted_before(4), pytest.raises(KeyboardInterrupt):
        train(folder, tmp_path / "parts", optimizer=optimizer)
    progress = train(folder, tmp_path / "parts", resume=True, optimizer=optimizer)
    assert progress.step == 6
    states = [torch.load(tmp_path / run / "checkpoint.pt", weights_only=True)["network"] for run in ("whole", "parts")]
    assert all(torch.equal(states[0][key], states[1][key]) for key in states[0])
    first, second = (files.load(tmp_path / run / "weights.safetensors", "video")[1] for run in ("whole", "parts"))
    assert first == second


def test_resuming_a_finished_run_writes_its_files_anew(folder, tmp_path):
    train(folder, tmp_path, steps=2)
    card = tmp_path / "weights.md"
    text = card.read_text()
    card.unlink()
    assert train(folder, tmp_path, steps=2, resume=True).step == 2
    assert card.read_text() == text


def test_resume_refuses_another_run(folder, tmp_path):
    train(folder, tmp_path, steps=2)
    with pytest.raises(FormatError, match=r"video .* with seed 0 by adam, but video .* with seed 1 by adam"):
        train(folder, tmp_path, steps=2, seed=1, resume=True)
    with pytest.raises(FormatError, match=r"video .* with seed 0 by adam, but video .* with seed 0 by muon"):
        train(folder, tmp_path, steps=2, optimizer="muon", resume=True)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    del state["task"]
    torch.save(state, tmp_path / "checkpoint.pt")
    assert train(folder, tmp_path, steps=2, resume=True).step == 2, "earlier versions had nothing else to keep"
    state["network"]["of an earlier version"] = state["network"].popitem()[1]
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(FormatError, match="do not fit"):
        train(folder, tmp_path, steps=2, resume=True)


def test_average_of_the_weights(folder, tmp_path):
    """After n steps it moves by 9 / (9 + n) of the way to the weights, first all of it."""
    material = clips.split(clips.load_clips([folder]))
    denoising = task.Denoising("ffdnet", *material, task.Sample(1, 1, 16), 0, tmp_path / "weights.safetensors", "")
    trainer = loop.Trainer(denoising, loop.Budget(tmp_path, steps=3), loop.Place.here("cpu"))
    expected = 0
    for steps in range(3):
        trainer.step(0.5)
        weight = next(trainer.network.parameters()).detach().clone()
        expected = expected + 9 / (9 + steps) * (weight - expected)
        torch.testing.assert_close(next(trainer.average.parameters()), expected)
    assert not torch.equal(weight, expected)


@pytest.mark.parametrize("optimizer", loop.OPTIMIZERS)
def test_learns(folder, tmp_path, optimizer):
    """On noise it has hardly seen yet, the net is already better than nothing."""
    progress = train(folder, tmp_path, name="ffdnet", steps=60, frames=1, optimizer=optimizer)
    noisy = -20 * np.log10(40 / 255)
    assert progress.rows[-1][2] < progress.rows[0][2], "the loss falls"
    assert progress.rows[-1][-1] > noisy


def test_two_processes_agree(folder, tmp_path):
    """What torchrun does: each process has its rank; the result is that of one set of weights."""
    command = [sys.executable, "-m", "priors.train", "video", "--data", str(folder), "--out", str(tmp_path)]
    command += ["--steps", "2", "--crop", "32", "--batch", "1", "--validations", "1"]
    command += ["--start", str(shipped / "video.safetensors"), "--solves", "1"]
    shared = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": "29617", "OMP_NUM_THREADS": "1"}
    ranks = [subprocess.Popen(command, env=os.environ | shared | {"RANK": rank}) for rank in "01"]
    assert [process.wait(120) for process in ranks] == [0, 0]
    assert "2 process(es)" in (tmp_path / "video.md").read_text()


def test_split_keeps_scenes_apart(folder):
    loaded = clips.load_clips([folder])
    assert [clip.name for clip in loaded] == ["ball_1", "ball_2", "car", "dog", "photograph"]
    assert loaded[0].frames.shape == (12, 32, 32)
    training, validation = clips.split(loaded)
    assert [clip.name for clip in validation] == ["ball_1"]
    assert [clip.name for clip in training] == ["car", "dog", "photograph"]
    assert [clip.name for clip in clips.split(loaded[:4])[1]] == ["ball_1"], "photographs do not change the split"


def test_folder_without_material(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing to see")
    with pytest.raises(FormatError, match="no video and no photograph"):
        clips.load_clips([tmp_path])
    with pytest.raises(FormatError, match="more than one frame"):
        data.Sampler([clips.Clip("still", np.zeros((1, 8, 8), np.uint8))], frames=3, crop=8, batch=1, seed=0)


def test_samples_depend_on_seed_rank_and_step_only():
    short = [clips.Clip("short", np.random.default_rng(0).integers(0, 256, (5, 20, 12), np.uint8))]
    sampler = data.Sampler(short, frames=8, crop=16, batch=3, seed=1)
    clean, noisy, sigma = sampler(0, 7)
    assert clean.shape == noisy.shape == (3, 8, 16, 16)
    assert sigma.max() <= 75 / 255
    for again, other in zip(sampler(0, 7), sampler(1, 7)):
        assert again.dtype == np.float32
        assert not np.array_equal(again, other)
    assert all(np.array_equal(a, b) for a, b in zip(sampler(0, 7), (clean, noisy, sigma)))


def test_noise_has_unit_variance():
    random = np.random.default_rng(0)
    samples = [data.unit_noise(random, (4, 32, 32)) for _ in range(100)]
    assert np.mean([np.square(sample).mean() for sample in samples]) == pytest.approx(1, abs=0.01)
    shared = [np.corrcoef(sample[0].ravel(), sample[1].ravel())[0, 1] for sample in samples]
    assert 0.4 < np.mean(np.array(shared) > 0.1) < 0.7, "most clips share some of it between their frames"


def test_a_pause_does_not_count(monkeypatch):
    times = iter([0, 1, 2, 3, 1003, 1004])
    monkeypatch.setattr(loop.time, "perf_counter", lambda: next(times))
    clock = loop.Clock()
    assert [clock.lap() for _ in range(6)] == [0, 1, 1, 1, 5, 1], "nor does the first lap, which compiles"
