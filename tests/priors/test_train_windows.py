"""Calls of a network within the solver, as material for its training."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from interrupting import interrupted_before

from pnp_sci.errors import FormatError, InputError
from pnp_sci.solvers import iterate
from priors.session import NetworkSession
from priors.video import Video

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
clips = pytest.importorskip("pnp_sci.training.clips")
files = pytest.importorskip("priors.networks.files")
loop = pytest.importorskip("pnp_sci.training.loop")
shipped = pytest.importorskip("priors.networks.image").WEIGHTS
solves = pytest.importorskip("priors.train.solves")
task = pytest.importorskip("priors.train.task")
unrolled = pytest.importorskip("priors.train.unrolled")
windows = pytest.importorskip("priors.train.windows")
cli = pytest.importorskip("priors.train.__main__")

pytestmark = pytest.mark.usefixtures("one_thread")
CPU = torch.device("cpu")


@pytest.fixture(params=["video", "ffdnet"])
def name(request):
    return request.param


def network(name):
    """The network of a prior, with the shipped weights."""
    return files.load(shipped / f"{name}.safetensors", name)[0]


@pytest.fixture
def watch(folder):
    training, _ = clips.split(clips.load_clips([folder]))
    return lambda name="video", rank=0, solves=2: windows.Watch(training, name, solves, crop=32, seed=1, rank=rank)


def test_windows_are_calls_in_a_row_beside_their_own_truth(watch, name):
    found = watch(name)(network(name), 0)
    assert 2 <= len(found) <= 2 * windows.WINDOWS
    for window in found:
        first = window.first
        assert len(window.steps) == windows.CALLS
        assert window.truth.shape == first.state.x.shape
        assert (first.motion is None) == (name == "ffdnet")
        error, elsewhere = (np.square(first.state.x - t).mean() for t in (window.truth, window.truth[:, ::-1, ::-1]))
        assert error < elsewhere
        measured = (first.op.masks * window.truth).sum((0, 1))
        assert np.abs(measured - first.y).mean() < 0.1 * first.y.mean(), "the truth is in the units of y"


def test_windows_depend_on_seed_rank_collection_and_network(watch):
    usual, again, elsewhere = (watch(rank=rank)(network("video"), 0) for rank in (0, 0, 1))
    later = watch()(network("video"), 1)
    assert np.array_equal(again[0].truth, usual[0].truth)
    assert np.array_equal(again[-1].first.state.x, usual[-1].first.state.x)
    for other in elsewhere, later:
        assert not np.array_equal(other[0].truth.ravel()[:99], usual[0].truth.ravel()[:99])
    idle = network("video")
    torch.nn.init.zeros_(idle.tail.weight)
    changed = watch()(idle, 0)
    assert np.array_equal(changed[0].truth, usual[0].truth)
    assert not np.array_equal(changed[-1].first.state.x, usual[-1].first.state.x)


def test_long_solves_have_one_sigma_and_start_from_adjoint(watch, monkeypatch):
    monkeypatch.setattr(solves, "LONG", 1)
    monkeypatch.setattr(solves, "ITERATIONS", 70)
    states = [window.first.state for window in watch()(network("video"), 0)]
    sigmas = [state.sigma for state in states]
    assert min(state.iteration for state in states) >= Video.first, "no decoder made the start"
    assert len(set(sigmas)) <= 2, "one for each of two measurements"
    assert solves.SIGMA[0] <= min(sigmas) < max(sigmas) <= solves.SIGMA[1]


def test_watching_ends_with_the_solve(watch, monkeypatch):
    serve, step = NetworkSession.__call__, iterate.ALGORITHMS["gap"]
    watch()(network("video"), 0)
    monkeypatch.setattr(windows, "solved", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        watch()(network("video"), 0)
    assert NetworkSession.__call__ is serve
    assert iterate.ALGORITHMS["gap"] is step


def test_estimates_are_those_of_the_solver(watch, name, monkeypatch):
    calls, lean = [], windows._window
    monkeypatch.setattr(windows, "_window", lambda part, truth: calls.append(part) or lean(part, truth))
    for window, (first, *later) in zip(watch(name)(network(name), 0), calls, strict=True):
        made = list(unrolled.estimates(window, network(name), CPU))
        assert len(made) == windows.CALLS
        for x, call in zip(made, later):
            step = np.sqrt(np.square(call.state.x - first.state.x).mean())
            assert np.sqrt(np.square(x.numpy(force=True) - call.state.x).mean()) < 0.2 * step + 1e-4


def test_gradient_goes_through_the_solver(watch, monkeypatch):
    """Against differences, without what counts as given, and in float32."""
    monkeypatch.setattr(unrolled, "passed", lambda v, change: v)
    monkeypatch.setattr(unrolled, "mixed_precision", lambda device: nullcontext())
    window, net = watch()(network("video"), 0)[0], network("video")
    weight = net.tail.weight

    def error():
        last = list(unrolled.estimates(window, net, CPU))[-1]
        return (last - torch.from_numpy(window.truth)).double().square().mean()

    error().backward()
    direction = weight.grad / weight.grad.norm()
    with torch.no_grad():
        weight += 1e-3 * direction
        above = float(error())
        weight -= 2e-3 * direction
        slope = (above - float(error())) / 2e-3
    assert slope == pytest.approx(float(weight.grad.norm()), rel=0.05)


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
    parts = int(card.split(" windows of")[0].split()[-1])
    assert 2 <= parts <= 2 * windows.WINDOWS, "two collections, none after the last validation"
    assert "windows of" not in start.with_suffix(".md").read_text()


def test_half_of_the_loss_is_that_of_the_estimates(folder, watch, tmp_path):
    material = clips.split(clips.load_clips([folder]))
    common = ("video", *material, task.Sample(8, 1, 32), 0, tmp_path / "weights.safetensors", "by a test")
    alone, both = (task.Denoising(*common, shipped / "video.safetensors", w) for w in (None, watch()))
    window, place = watch()(network("video"), 0)[0], loop.Place.here("cpu")

    def of_solves(truth):
        both.collections = {0: [replace(window, truth=truth)]}
        with torch.no_grad():
            of_noise, mean = (float(t.loss(t.network, place, 0)) for t in (alone, both))
        return 2 * mean - of_noise

    assert of_solves(np.full_like(window.truth, 10)) == pytest.approx(2 * np.log(10 - window.truth.mean()), abs=0.1)
    assert of_solves(window.truth) < 0


def test_a_resumed_run_makes_its_collections_again(folder, watch, tmp_path):
    """It has the same samples and ends with the same weights."""
    material = clips.split(clips.load_clips([folder]))

    def train(out, resume=False, solves=1):
        common = ("video", *material, task.Sample(8, 1, 32), 0, out / "weights.safetensors", "by a test")
        denoising = task.Denoising(*common, shipped / "video.safetensors", watch(solves=solves))
        budget = loop.Budget(out, steps=8, validations=4)
        loop.train(denoising, budget, loop.Place.here("cpu"), resume)
        return denoising

    whole = train(tmp_path / "whole")
    with interrupted_before(6), pytest.raises(KeyboardInterrupt):
        train(tmp_path / "parts")
    with pytest.raises(FormatError, match="with 1 --solves, but 2 were asked for"):
        train(tmp_path / "parts", resume=True, solves=2)
    resumed = train(tmp_path / "parts", resume=True)
    assert list(whole.collections) == list(resumed.collections) == [1, 2, 3], "none after the last validation"
    assert resumed.windows == whole.windows
    for one, other in zip(whole.network.parameters(), resumed.network.parameters()):
        assert torch.equal(one, other)
