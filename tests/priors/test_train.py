"""The trainer from end to end on a few tiny clips: files, exact resume, the split, the noise, a paused clock."""

import os
import subprocess
import sys

import imageio.v3 as iio
import numpy as np
import pytest
from click.testing import CliRunner

import pnp_sci
from pnp_sci.errors import FormatError, InputError

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
_weights = pytest.importorskip("priors.networks.files")
clips = pytest.importorskip("pnp_sci.training.clips")
loop = pytest.importorskip("pnp_sci.training.loop")
muon = pytest.importorskip("pnp_sci.training.muon")
assisted = pytest.importorskip("priors.assisted")
data = pytest.importorskip("priors.train.data")
states = pytest.importorskip("priors.train.states")
task = pytest.importorskip("priors.train.task")
cli = pytest.importorskip("priors.train.__main__")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    random = np.random.default_rng(0)
    for name in ("ball_1", "ball_2", "car", "dog"):
        frames = np.kron(random.integers(0, 256, (12, 8, 8, 1)), np.ones((1, 4, 4, 3))).astype(np.uint8)
        iio.imwrite(folder / f"{name}.mp4", frames, plugin="FFMPEG", fps=10)
    iio.imwrite(folder / "photograph.jpg", random.integers(0, 256, (40, 30), np.uint8))
    return folder


@pytest.fixture(autouse=True)
def small():
    """One thread: more of them only wait for each other on pictures this small."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


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
    _, digest = _weights.load(weights, "ffdnet")
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
    for more in (["--weights", str(first)], ["--start", str(first), "--seed", "1"]):
        result = CliRunner().invoke(cli.main, [*common, "--out", str(tmp_path / "run"), *more], catch_exceptions=False)
        assert result.exit_code == 0, result.output
    begun, gone_on = (_weights.load(path, "ffdnet")[0] for path in (first, tmp_path / "run" / "ffdnet.safetensors"))
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
def test_resumed_run_equals_an_uninterrupted_one(folder, tmp_path, monkeypatch, optimizer):
    train(folder, tmp_path / "whole", optimizer=optimizer)

    def interrupted(trainer, done, step=loop.Trainer.step):
        if trainer.progress.step == 4:
            raise KeyboardInterrupt
        return step(trainer, done)

    with monkeypatch.context() as patch:
        patch.setattr(loop.Trainer, "step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(folder, tmp_path / "parts", optimizer=optimizer)
    progress = train(folder, tmp_path / "parts", resume=True, optimizer=optimizer)
    assert progress.step == 6
    states = [torch.load(tmp_path / run / "checkpoint.pt", weights_only=True)["network"] for run in ("whole", "parts")]
    assert all(torch.equal(states[0][key], states[1][key]) for key in states[0])
    first, second = (_weights.load(tmp_path / run / "weights.safetensors", "video")[1] for run in ("whole", "parts"))
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
    state["network"]["of an earlier version"] = state["network"].popitem()[1]
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(FormatError, match="do not fit"):
        train(folder, tmp_path, steps=2, resume=True)


@pytest.mark.parametrize("shape", [(3, 16, 16), (2, 8, 72), (1, 64, 20)])
def test_steps_of_muon_are_orthogonal(shape):
    """Singular values near 1, and the singular vectors of the matrix itself."""
    matrices = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    found = muon.orthogonal(matrices)
    values = torch.linalg.svdvals(found)
    assert 0.4 < values.median() < 1.3
    assert values.max() < 1.35
    left, _, right = torch.linalg.svd(matrices, full_matrices=False)
    mixed = left.mT @ found @ right.mT
    assert torch.linalg.matrix_norm(mixed - torch.diag_embed(mixed.diagonal(dim1=1, dim2=2))).max() < 0.15


def test_muon_moves_every_kernel_by_its_rate():
    """Whatever the size of the gradient and of the kernel, the step is as long as Adam's is."""
    kernels = [torch.nn.Parameter(torch.zeros(shape)) for shape in ((8, 8, 3, 3), (8, 8, 3, 3), (16, 4, 1, 1))]
    for size, kernel in zip((1e-6, 1, 1e3), kernels):
        kernel.grad = size * torch.randn(kernel.shape, generator=torch.Generator().manual_seed(0))
    muon.Muon(kernels, 0.01, 0).step()
    for kernel in kernels:
        assert (kernel * kernel.grad).sum() < 0, "downhill"
        assert kernel.square().mean().sqrt().item() == pytest.approx(0.2 * 0.01, rel=0.4)


def test_muon_moves_kernels_together_as_each_alone():
    """With momentum and decay over three steps, and wherever their channels lie in memory."""
    random = torch.Generator().manual_seed(0)
    starts, *gradients = torch.randn(4, 2, 8, 16, 3, 3, generator=random)
    together = [torch.nn.Parameter(k.contiguous(memory_format=torch.channels_last)) for k in starts]
    alone = [torch.nn.Parameter(k.clone()) for k in starts]
    optimizers = [muon.Muon(together, 0.01, 0.1), *(muon.Muon([k], 0.01, 0.1) for k in alone)]
    for pair in gradients:
        for k, gradient in enumerate(pair):
            together[k].grad, alone[k].grad = gradient.clone(memory_format=torch.channels_last), gradient
        for optimizer in optimizers:
            optimizer.step()
    for one, other in zip(together, alone):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=0)
    assert not torch.allclose(together[0], starts[0], atol=1e-2)


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
    command += ["--start", str(assisted.video().net.weights), "--solves", "1"]
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


@pytest.fixture
def watch(folder):
    training, _ = clips.split(clips.load_clips([folder]))
    return lambda rank=0: states.Watch(training, assisted.video(), solves=2, crop=32, seed=1, rank=rank)


def test_states_are_what_the_network_sees_and_its_truth(watch):
    network = assisted.video().net._runner.network
    watching = watch()
    found, again, other = watching(network), watch()(network), watch(rank=1)(network)
    assert found.frames.shape == found.level.shape == found.truth.shape
    assert found.frames.shape[1:] == (32, 32)
    assert len(found.frames) > states.FRAMES
    assert "noise" not in vars(watching.prior.net._runner), "the prior is as it was"
    error, elsewhere = (np.square(found.frames - truth).mean() for truth in (found.truth, found.truth[::-1]))
    assert error < 0.8 * elsewhere, "each frame lies beside its own truth"
    assert np.array_equal(again.truth, found.truth)
    assert np.array_equal(again.frames, found.frames)
    assert not np.array_equal(other.truth[:1], found.truth[:1])
    frames, level, truth = found.draw(np.random.default_rng(0), 7)
    assert frames.shape == level.shape == truth.shape == (7, 32, 32)
    assert frames.dtype == np.float32


def test_states_are_those_of_the_network_that_is_given(watch):
    network = assisted.video().net._runner.network
    usual = watch()(network)
    torch.nn.init.zeros_(network.tail.weight)
    idle = watch()(network)
    assert np.array_equal(idle.truth, usual.truth)
    assert not np.array_equal(idle.frames, usual.frames)


def test_truth_is_in_the_units_that_the_network_sees(watch, monkeypatch):
    network = assisted.video().net._runner.network
    half = pnp_sci.simulate
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
    card = (tmp_path / "ffdnet.md").read_text()
    assert "--start start.safetensors --solves 1" in card
    frames = int(card.split("meanwhile, from ")[1].split()[0])
    assert states.FRAMES < frames <= 2 * states.CALLS * states.FRAMES, "two collections; the third is for later steps"
    assert "within the solver" not in start.with_suffix(".md").read_text()


@pytest.mark.parametrize(("off", "sign"), [(0, -1), (1, 1)])
def test_half_of_the_loss_is_from_the_solver(folder, watch, tmp_path, off, sign):
    """Flat frames are easy where they are the truth, and never right where the truth is ten sigma away."""
    material = clips.split(clips.load_clips([folder]))
    place, start = loop.Place.here(), assisted.video().net.weights
    common = ("video", *material, task.Sample(8, 1, 32), 0, tmp_path / "weights.safetensors", "by a test", start)
    alone, both = task.Denoising(*common), task.Denoising(*common, watch())
    flat = np.full((9, 32, 32), 0.5, np.float16)
    both.collections = [states.States(flat, 0.1 * np.ones_like(flat), flat + np.float16(off))]
    with torch.no_grad():
        of_noise, mean = (float(t.loss(t.network, place, 0)) for t in (alone, both))
    assert sign * (2 * mean - of_noise) > 2


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
