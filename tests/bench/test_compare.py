"""Methods compared on one measurement: the score without truth, the rows, the command, the report's text."""

import json
import re
import shlex
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci import api, io
from pnp_sci.bench import Case, Method, Source, compare, grid, held_back_score
from pnp_sci.bench.pareto import Point, chart, front
from pnp_sci.bench.report import _encode
from pnp_sci.bench.runner import measure
from pnp_sci.cli.main import main
from pnp_sci.datasets import embedded_scene
from pnp_sci.errors import InputError
from pnp_sci.plugins import registry
from pnp_sci.results.result import Result
from pnp_sci.sensing.operator import SensingOperator

SIZE = 32
STEPS = 8


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a measurement, its masks and the true video."""
    monkeypatch.chdir(tmp_path)
    scene = embedded_scene(SIZE)
    io.write("meas.npz", {"y": scene.y, "masks": scene.masks, "x": scene.truth})
    return tmp_path


@pytest.fixture(scope="module")
def both():
    """tv and a method that fails, with truth."""
    scene = embedded_scene(SIZE)
    return compare(scene.y, scene.masks, grid(["tv", "vt"], iterations=STEPS), reference=scene.truth)


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


# ---- score -----------------------------------------------------------------------------------------------------------


def test_the_true_video_has_a_perfect_score_and_nothing_has_the_signal_as_its_error():
    scene = embedded_scene(SIZE)
    exact = held_back_score(lambda y, masks: scene.truth, scene.y, scene.masks, white=1.0)
    dark = held_back_score(lambda y, masks: 0 * scene.truth, scene.y, scene.masks)
    gram = scene.masks.astype(float).sum((0, 1))
    assert exact > 100
    assert dark == pytest.approx(-10 * np.log10(np.mean(scene.y**2) / gram.mean()), abs=1.0)


def test_the_score_of_independent_errors_is_their_psnr():
    scene, error = embedded_scene(64), np.random.default_rng(0).normal(0, 0.1, (2, 10, 64, 64))
    score = held_back_score(lambda y, masks: scene.truth + error, scene.y, scene.masks, fraction=0.5)
    assert score == pytest.approx(20, abs=0.3)


def test_noise_is_not_the_fault_of_the_method():
    scene = embedded_scene(64)
    noisy = scene.y + np.random.default_rng(0).normal(0, 0.5, scene.y.shape)
    blamed, fair = (
        held_back_score(lambda y, masks: scene.truth, noisy, scene.masks, noise=noise, fraction=0.3)
        for noise in (0.0, 0.5)
    )
    assert fair > blamed + 8


@given(st.floats(1e-3, 1e3), st.integers(0, 5))
def test_the_unit_of_y_does_not_matter(factor, seed):
    scene = embedded_scene(SIZE)

    def score(a):
        return held_back_score(lambda y, m: 0.9 * a * scene.truth, a * scene.y, scene.masks, white=a, seed=seed)

    assert score(factor) == pytest.approx(score(1.0), abs=1e-3)


def test_hidden_pixels_are_hidden_and_dead_ones_not_chosen():
    scene, seen = embedded_scene(SIZE), {}
    masks = scene.masks.copy()
    masks[..., : SIZE // 2, :] = 0

    def spy(y, masks):
        seen.update(y=y, masks=masks)
        return np.zeros(masks.shape)

    held_back_score(spy, scene.y, masks, fraction=0.25)
    hidden = ~seen["masks"].any((0, 1))[SIZE // 2 :]
    assert hidden.sum() == pytest.approx(0.25 * SIZE * SIZE / 2, abs=8)
    assert not seen["y"][SIZE // 2 :][hidden].any()
    assert np.array_equal(seen["y"][: SIZE // 2], scene.y[: SIZE // 2])
    assert seen["masks"].dtype == masks.dtype


def test_where_nothing_can_be_held_back_the_score_is_nan():
    assert np.isnan(held_back_score(lambda y, m: m, np.ones((4, 4)), np.zeros((1, 2, 4, 4))))
    with pytest.raises(InputError, match="fraction is 1"):
        held_back_score(lambda y, m: m, np.ones((4, 4)), np.ones((1, 2, 4, 4)), fraction=1)
    with pytest.raises(InputError, match=r"masks has shape \(2, 4, 4\)"):
        held_back_score(lambda y, m: m, np.ones((4, 4)), np.ones((2, 4, 4)))


def test_the_score_ranks_methods_as_psnr_does(data):
    """On a part of a benchmark pair; all of three pairs: benchmarks/score_against_truth.py."""
    from scipy.stats import spearmanr

    scene = pnp_sci.datasets.dualview("hike_hockey")
    y, masks, truth = (np.ascontiguousarray(a[..., :96, :96]) for a in (scene.y, scene.masks, scene.truth))
    methods = [Method("none"), *(Method("tv", iterations=n) for n in (5, 10, 20, 100)), Method("flow", effort="fast")]
    trials = compare(y, masks, methods, reference=truth).trials
    assert spearmanr([t.score for t in trials], [t.quality for t in trials]).statistic >= 0.8


# ---- rows ------------------------------------------------------------------------------------------------------------


def test_what_is_scored_runs_as_what_is_returned(monkeypatch):
    """With the same first estimate, and so with the same warm-up, number of calls, and a share of the decoder."""
    pytest.importorskip("torch")
    scene, solve, runs = embedded_scene(SIZE), api.solve, []
    y = pnp_sci.simulate(scene.truth, scene.masks, 0.1)

    def spy(*given, **options):
        runs.append(solve(*given, **options))
        return runs[-1]

    monkeypatch.setattr(api, "solve", spy)
    compare(y, scene.masks, [Method("flow", init=init, effort="fast") for init in ("adjoint", "ofanet-fast")])
    plans = [(run.settings["init"], run.settings["iterations"], run.settings["plan"][0]["serves"]) for run in runs]
    assert plans[0] == plans[1]
    assert plans[2] == plans[3]
    assert [len(plan[-1]) for plan in plans] == [2, 2, 1, 1], "after a decoder there is no warm-up"
    assert [max(run.settings["share"][0]) > 0 for run in runs] == [False, False, True, True]


def test_a_decoder_gets_what_concerns_it(monkeypatch):
    """Its video is that of `decode` with the same noise and bad pixels; what is scored has the scene of all methods."""
    scene, problems, models = embedded_scene(SIZE), [], []

    def flat(problem, model):
        problems.append(problem)
        models.append(model)
        return np.full(problem.op.shape, 0.5)

    monkeypatch.setitem(registry._registered["decoders"], "flat", lambda: flat)
    bad = np.zeros((SIZE, SIZE), bool)
    bad[3, 4] = True
    methods = grid(["tv"], iterations=2, decoders=["flat"])
    alone, tv = compare(scene.y, scene.masks, methods, noise=0.02, bad=bad, device="cpu", seed=1).trials
    assert (alone.error, tv.error) == (None, None)
    assert alone.python == "result = pnp_sci.decode(y, masks, model='flat', noise=0.02)"
    assert models[0].reason == tv.result.scene["reason"]
    expected = pnp_sci.decode(scene.y, scene.masks, "flat", noise=0.02, bad=bad)
    assert np.array_equal(alone.result.x, expected.x)
    assert [problem.bad is None for problem in problems] == [True, False, False], "the held-back masks are 0 there"
    assert problems[1].noise == problems[2].noise


def test_a_decoder_that_takes_a_device_gets_it(monkeypatch):
    scene, devices = embedded_scene(SIZE), []

    def placed(device=None):
        devices.append(device)
        return lambda problem, model: np.full(problem.op.shape, 0.5)

    monkeypatch.setitem(registry._registered["decoders"], "placed", placed)
    (trial,) = compare(scene.y, scene.masks, grid([], decoders=["placed"]), device="cpu").trials
    assert trial.error is None
    assert devices == ["cpu", "cpu"]
    assert "device='cpu'" in trial.python
    (missing,) = compare(scene.y, scene.masks, grid([], decoders=["plcaed"]), device="cpu").trials
    assert "model is 'plcaed'" in missing.error


def test_a_method_that_fails_is_a_row_and_the_others_go_on(both, monkeypatch):
    tv, vt = both.trials
    assert tv.error is None
    assert tv.result.history[-1].iteration == STEPS
    assert len(tv.psnr) == len(tv.ssim) == 2
    assert vt.result is None
    assert "'vt'" in vt.error

    def broken():
        raise KeyError("weights")

    monkeypatch.setitem(registry._registered["priors"], "broken", broken)
    scene = embedded_scene(SIZE)
    assert "weights" in compare(scene.y, scene.masks, [Method("broken")]).trials[0].error
    assert "effort is 'bset'" in compare(scene.y, scene.masks, [Method("auto", effort="bset")]).trials[0].error


def test_without_truth_the_score_decides(both):
    scene = embedded_scene(SIZE)
    (blind,) = compare(scene.y, scene.masks, [Method("tv", iterations=STEPS)]).trials
    assert blind.quality == blind.score == pytest.approx(both.trials[0].score, abs=1e-3)
    assert blind.psnr == ()


def test_a_truth_in_grey_levels_counts_as_one_in_floats(both):
    scene = embedded_scene(SIZE)
    grey = (255 * scene.truth).round().astype(np.uint8)
    y = pnp_sci.simulate(grey, scene.masks)
    (trial,) = compare(y, scene.masks, [Method("tv", iterations=STEPS)], reference=grey).trials
    assert trial.psnr == pytest.approx(both.trials[0].psnr, abs=0.05)
    assert trial.score == pytest.approx(both.trials[0].score, abs=0.1)


def test_the_input_is_at_fault_before_any_method_runs():
    with pytest.raises(InputError, match="but y is 5 x 5"):
        compare(np.ones((5, 5)), np.ones((1, 2, 4, 4)), [Method("tv")])
    with pytest.raises(InputError, match="one measurement"):
        compare(np.ones((2, 4, 4)), np.ones((1, 2, 4, 4)), [Method("tv")])
    with pytest.raises(InputError, match="methods is empty"):
        compare(np.ones((4, 4)), np.ones((1, 2, 4, 4)), [])


@pytest.mark.parametrize("argument", ["priors", "inits", "algorithms", "efforts", "decoders"])
def test_one_name_is_no_sequence_of_names(argument):
    with pytest.raises(InputError, match=f"{argument} is 'tv': a sequence of names"):
        grid(**{"priors": ["tv"], argument: "tv"})


def test_an_operator_stands_for_its_masks():
    scene = embedded_scene(SIZE)
    method = grid(["tv"], iterations=2)
    by_array, by_operator = (compare(scene.y, m, method) for m in (scene.masks, SensingOperator(scene.masks)))
    assert np.array_equal(by_array.trials[0].result.x, by_operator.trials[0].result.x)
    assert by_array.trials[0].score == by_operator.trials[0].score


def test_names_say_what_is_unusual():
    names = [method.name for method in grid(["tv", "tv"], ["auto"], ["gap", "admm"], ["balanced", "best"], 7)]
    assert names == [
        "tv, 7 iterations",
        "tv, best, 7 iterations",
        "tv, admm, 7 iterations",
        "tv, admm, best, 7 iterations",
    ]


@pytest.mark.parametrize("name", ["meas.npz", 'it\'s $HOME; "quoted".npz'])
def test_both_ways_to_reproduce_a_row_give_the_same_video(here, name):
    Path("meas.npz").rename(name)
    source = Source(Path(name), Path(name), views=2)
    y, masks = io.read_measurement(name), io.read_masks(name)
    (trial,) = compare(y, masks, [Method("tv", algorithm="admm", iterations=3)], source=source, noise=0.02).trials
    names = {}
    exec(trial.python, names)
    assert np.array_equal(names["result"].x, trial.result.x)
    program, *arguments = shlex.split(trial.command)
    assert program == "pnp-sci"
    assert run(*arguments).exit_code == 0
    assert np.array_equal(Result.load("result.npz").x, trial.result.x)


# ---- the chart -------------------------------------------------------------------------------------------------------


@given(st.lists(st.tuples(st.floats(1e-3, 1e4), st.floats(-10, 60)), min_size=1, max_size=12))
def test_the_front_is_what_nothing_beats_and_all_points_are_inside(pairs):
    points = [Point(f"method {i}", *pair) for i, pair in enumerate(pairs)]
    best = front(points)
    assert best[max(range(len(points)), key=lambda i: (points[i].quality, -points[i].seconds))]
    for point, is_best in zip(points, best):
        beaten = any(p.seconds < point.seconds and p.quality > point.quality for p in points)
        assert not (is_best and beaten)
    drawn = chart(points)
    assert all(0 <= p["x"] <= drawn["width"] and 0 <= p["y"] <= drawn["height"] for p in drawn["points"])
    assert 2 <= len(drawn["levels"]) <= 9
    assert 2 <= len(drawn["seconds"]) <= 10


# ---- the report ------------------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Tags with their attributes, and all text that a reader sees."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)


def test_the_report_needs_nothing_but_itself(both, tmp_path):
    both.save_html(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|//\w+\.\w+/|@import|url\(", text)
    page = Page(text)
    assert not [tag for tag, attributes in page.tags if tag in ("link", "iframe", "object", "embed", "base")]
    sources = [attributes[key] for _, attributes in page.tags for key in ("src", "href") if key in attributes]
    assert sources
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    policy = next(a["content"] for tag, a in page.tags if tag == "meta" and a.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_every_control_has_a_name(both, tmp_path):
    both.save_html(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    tags = Page(text).tags
    assert ("html", {"lang": "en"}) in tags
    for tag, attributes in tags:
        if tag == "canvas":
            assert attributes["aria-label"]
        if tag == "img":
            assert attributes["alt"]
    assert all(re.search(r"aria-label=|>[^<]+<", button) for button in re.findall(r"<button.*?</button>", text, re.S))
    for control in re.findall(r'<(?:select|input)[^>]*id="(\w+)"', text):
        assert re.search(rf'<label[^>]*>[^<]*<(?:select|input)[^>]*id="{control}"', text), control


def test_the_frames_in_the_report_are_those_of_the_videos(both, tmp_path):
    import base64

    import imageio.v3

    both.save_html(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    truth, tv = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    assert (truth["name"], tv["name"]) == ("Truth", "tv, 8 iterations")
    for panel, video in ((truth, both.truth), (tv, both.trials[0].result.x)):
        assert np.shape(panel["frames"]) == video.shape[:2]
        shown = imageio.v3.imread(base64.b64decode(panel["frames"][1][7].partition(",")[2]))
        assert shown / 255 == pytest.approx(np.clip(video[1, 7], 0, 1), abs=0.003)


def test_large_videos_are_compressed_until_they_fit():
    noise = np.random.default_rng(0).random((1, 30, 1024, 1024), np.float32)
    pictures, encoding = _encode([noise])
    assert sum(len(frame) for frame in pictures[0][0]) < 15e6
    assert "WebP" in encoding


def test_hostile_names_are_escaped(here):
    hostile = "<script>alert(1)<\\script>&\"'.npz"
    Path("meas.npz").rename(hostile)
    done = run(
        *("compare", hostile, "--priors", "none,<img src=x onerror=alert(2)>", "--iterations", 1),
        *("--html", "r.html", "--title", "</title><script>alert(3)</script>"),
    )
    assert done.exit_code == 1
    text = Path("r.html").read_text(encoding="utf-8")
    page = Page(text)
    scripts = [attributes for tag, attributes in page.tags if tag == "script"]
    assert len(scripts) == 2
    assert not [a for tag, a in page.tags if tag == "img" and "onerror" in a]
    assert hostile in "".join(page.text).replace("'\"'\"'", "'")
    assert "<script>alert" not in text


# ---- the command -----------------------------------------------------------------------------------------------------


def test_compare_prints_and_writes_all_rows(here):
    options = ("--truth", "meas.npz", "--priors", "tv,none", "--efforts", "fast,balanced", "--iterations", STEPS)
    done = run("compare", "meas.npz", *options, "--html", "report.html", "--json", "rows.json")
    assert done.exit_code == 0, done.output
    assert re.search(
        r"^tv, 8 iterations +PSNR [\d.]+ dB.*score [\d.]+ dB, residual [\d.]+, [\d.]+ s", done.stdout, re.M
    )
    assert "Written: report.html, rows.json" in done.stdout
    kept = json.loads(Path("rows.json").read_text())
    assert [row["name"] for row in kept["rows"]] == [
        m.name for m in grid(["tv", "none"], efforts=["fast", "balanced"], iterations=STEPS)
    ]
    assert kept["rows"][0]["settings"]["masks"]
    assert kept["machine"]["pnp-sci"]
    assert kept["measurement"]["Size"] == "2 views x 10 frames of 32 x 32 in one picture"
    page = "".join(Page(Path("report.html").read_text(encoding="utf-8")).text)
    assert "pnp-sci solve meas.npz --masks meas.npz --prior tv" in page


def test_compare_runs_decoders(here):
    pytest.importorskip("torch")
    options = "--priors", "", "--decoders", "ofanet-fast", "--truth", "meas.npz", "--device", "cpu"
    done = run("compare", "meas.npz", *options, "--html", "report.html", "--json", "rows.json")
    assert done.exit_code == 0, done.output
    assert re.search(r"^ofanet-fast alone +PSNR [\d.]+ dB.*0 iterations: a network decoded", done.stdout, re.M)
    (row,) = json.loads(Path("rows.json").read_text())["rows"]
    made = {}
    exec(row["python"], made)
    assert row["psnr"] == pytest.approx(pnp_sci.metrics.psnr(made["result"].x, made["io"].read("meas.npz", "x")))
    assert row["command"] is None
    assert "ofanet-fast alone" in Path("report.html").read_text(encoding="utf-8")


def test_of_several_measurements_the_first_is_compared_unless_told(here):
    scene = embedded_scene(SIZE)
    x = np.stack([scene.truth, scene.truth[:, ::-1]])
    y = np.stack([pnp_sci.simulate(video, scene.masks) for video in x])
    io.write("two.h5", {"y": y, "masks": scene.masks, "x": x.swapaxes(0, 1).reshape(2, 20, SIZE, SIZE)})
    for index, options in ((0, ()), (1, ("--index", 1))):
        options = (*options, "--truth", "two.h5", "--priors", "none", "--iterations", 2, "--json", "r.json")
        done = run("compare", "two.h5", *options)
        assert done.exit_code == 0, done.output
        assert f"--index {index}" in json.loads(Path("r.json").read_text())["rows"][0]["command"]
    assert "--index: 2 came" in run("compare", "two.h5", "--index", 2).stderr


def test_masks_of_each_measurement(here):
    """Compare takes those of the measurement that is compared, bench all, and info says what they are."""
    scene = embedded_scene(SIZE)
    x, masks = np.stack([scene.truth, scene.truth[:, ::-1]]), np.stack([scene.masks, scene.masks[:, :, ::-1]])
    y = np.stack([pnp_sci.simulate(*pair) for pair in zip(x, masks)])
    io.write("own.npz", {"y": y, "masks": masks, "x": x})
    options = ("--index", 1, "--truth", "own.npz", "--priors", "tv", "--iterations", 20, "--json", "r.json")
    done = run("compare", "own.npz", *options)
    assert done.exit_code == 0, done.output
    (row,) = json.loads(Path("r.json").read_text())["rows"]
    assert min(row["psnr"]) > 12
    made = {}
    exec(row["python"], made)
    np.testing.assert_array_equal(made["masks"], masks[1])
    case = Case("own.npz")
    assert measure(case, grid(["tv"], iterations=20)[0]).psnr == pytest.approx(row["psnr"], abs=2)
    np.testing.assert_allclose(Case("own.npz", noise=0).load().y, y, rtol=1e-4, atol=1e-4)
    done = run("info", "own.npz")
    assert "masks of 2 measurements, each 2 x 10 of 32 x 32" in done.output
    assert done.output.count("the views can be told apart") == 2


def test_a_failing_method_is_reported_and_the_exit_code_is_1(here):
    done = run("compare", "meas.npz", "--priors", "vt,none", "--iterations", 1, "--html", "r.html")
    assert done.exit_code == 1
    assert "vt, 1 iteration          failed" in done.stdout
    assert re.search(r"^none, 1 iteration +score", done.stdout, re.M)
    assert "Error: vt, 1 iteration: prior is 'vt'" in done.stderr
    assert "Failed: prior is" in Path("r.html").read_text(encoding="utf-8")
