"""Masks from raw pictures with the faults that cameras have, against the masks that the pictures were made with."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import pnp_sci
from pnp_sci import Calibration, calibrate, io
from pnp_sci.cli.main import main
from pnp_sci.errors import FormatError, InputError

V, B, N, SIDE = 2, 6, 5, 64
RNG = np.random.default_rng(0)
ROW, COLUMN = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
MASKS = pnp_sci.random_masks((V, B, SIDE, SIDE), seed=1)
SHADING = 1 - 0.8 * (ROW**2 + COLUMN**2)  # of the lens: 0.6 in the corners
OFFSET = 100 + RNG.normal(0, 3, (SIDE, SIDE))  # of each pixel
HOT, DEAD = RNG.random((2, SIDE, SIDE)) < 0.002


def camera(light, lamp=1.0):
    """Counts of a 16-bit camera for light (..., H, W) in parts of the lamp: photon and read noise, hot, dead pixels."""
    counts = 20000 * lamp * light * SHADING
    counts = counts + RNG.normal(0, 1, counts.shape) * np.sqrt(counts) * 0.7 + RNG.normal(0, 5, counts.shape)
    return np.clip(np.where(DEAD, 0, counts) + OFFSET + 8000 * HOT, 0, 65535).round().astype(np.uint16)


def pictures(lamp=None, stray=0.05):
    lamp = np.ones((V, B, 1, 1, 1)) if lamp is None else lamp
    light = stray + (1 - stray) * MASKS[:, :, None].astype(float)
    raw = camera(np.broadcast_to(light, (V, B, N, SIDE, SIDE)), lamp)
    raw[0, 0, 0, 5:9, 5:9] = 60000  # a cosmic ray
    return camera(np.zeros((N, SIDE, SIDE))), camera(np.ones((N, SIDE, SIDE))), raw


def test_masks_are_found_behind_all_faults():
    lamp = 1 + 0.1 * RNG.standard_normal((V, B, 1, 1, 1)).clip(-1, 1)
    made = calibrate(*pictures(lamp))
    assert not (HOT & ~made.bad).any()
    assert not (DEAD & ~made.bad).any()
    assert (made.bad & ~HOT & ~DEAD).sum() < 10
    true = (0.05 + 0.95 * MASKS) * SHADING / np.median(SHADING)
    found, true = made.masks[:, :, ~made.bad], true[:, :, ~made.bad]
    gain = (found * true).sum() / (true**2).sum()  # the lamp's mean brightness is anybody's guess
    assert 0.9 < gain < 1.1
    assert np.abs(found / gain - true).mean() < 0.01
    np.testing.assert_allclose(made.dark[~HOT], OFFSET[~HOT], atol=20)
    assert 0.05 < made.quality.drift < 0.3
    assert made.quality.contrast == pytest.approx((0.9, 0.9), abs=0.05)


def test_the_video_is_that_of_true_masks():
    """Masks and measurement as the camera gives them, against those that nobody knows."""
    truth = pnp_sci.datasets.embedded_scene(SIDE).truth[:, :B]
    taken = pictures(stray=0.0)
    made = calibrate(*taken)
    light = np.einsum("vbhw,vbhw->hw", MASKS, truth)
    raw = np.clip(300 * light * SHADING + RNG.normal(0, 5, light.shape) + OFFSET + 8000 * HOT, 0, 65535).astype("u2")
    y = made.correct(raw)
    assert y.mask.sum() == made.bad.sum()
    found = pnp_sci.solve(np.where(made.bad, 0, y.data), made.masks * ~made.bad)
    x = found.x / 300 / np.median(SHADING)
    ideal = pnp_sci.solve(pnp_sci.simulate(truth, MASKS), MASKS).x
    naive = pnp_sci.solve(raw.astype(float), taken[2].mean(2) / 20000).x / 300
    made_, ideal_, naive_ = (float(pnp_sci.psnr(video, truth).mean()) for video in (x, ideal, naive))
    assert made_ > ideal_ - 1
    assert naive_ < made_ - 1.5, (made_, ideal_, naive_)


@pytest.mark.parametrize("fault", ["twice", "missing", "blurred", "lamp", "few"])
def test_what_is_poor_is_said(fault):
    from scipy.ndimage import gaussian_filter

    dark, white, raw = pictures()
    if fault == "twice":
        raw[1, 3] = raw[1, 2]
        said = "view 2: the pictures of frames 3 and 4 are alike"
    elif fault == "missing":
        raw[0, 4] = dark
        said = "view 1: the picture of frame 5 is dark"
    elif fault == "blurred":
        raw = gaussian_filter(raw.astype(float), (0, 0, 0, 2, 2))
        said = "focus the masks"
    elif fault == "lamp":
        raw[:, 0] = dark + (raw[:, 0] - dark.astype(float)) * 0.8
        said = "the lamp drifts"
    else:
        raw = raw + RNG.normal(0, 3000, raw.shape)
        said = "take more pictures"
    assert any(said in sentence for sentence in calibrate(dark, white, raw).quality.advice)


def test_good_pictures_give_no_advice():
    assert calibrate(*pictures()).quality.advice == []


def test_without_white_and_dark():
    raw = camera(MASKS.astype(float)).astype(float) - OFFSET
    made = calibrate(None, None, raw)
    true = MASKS * SHADING / np.median(SHADING)
    assert np.abs(made.masks - true)[:, :, ~made.bad].mean() < 0.05


def test_saturated_pixels_are_bad():
    dark, white, raw = pictures()
    raw[:, :, :, 10, 10:20] = 65535
    assert calibrate(dark, white, raw, full_scale=65535).bad[10, 10:20].all()


def clipping(lamp, repeats=3, curved=1.0, noise=1.0, black=500, full_scale=4095):
    """Dark, white and pattern pictures of a camera of 12 bits whose white is `lamp` above its black level."""
    rng = np.random.default_rng(2)

    def taken(light):
        counts = lamp * light * (1 - curved * (ROW**2 + COLUMN**2))
        noisy = counts + noise * rng.normal(0, 3 + 0.3 * np.sqrt(counts)) + black
        return noisy.round().clip(0, full_scale).astype(np.uint16)

    light = np.repeat(0.03 + 0.97 * MASKS[:, :, None], repeats, 2)
    return taken(np.zeros((repeats, SIDE, SIDE))), taken(np.ones((repeats, SIDE, SIDE))), taken(light)


@pytest.mark.parametrize("lamp", [3800, 5000, 8000])
@pytest.mark.parametrize("repeats", [1, 2, 3, 10])
@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_clipped_pictures_are_noticed_without_full_scale(lamp, repeats, noise):
    """Also where no pixel of white is below the largest value, and with one picture of each."""
    dark, white, raw = clipping(lamp, repeats, noise=noise)
    advice = calibrate(dark, white, raw).quality.advice
    for name in ("white", "patterns"):
        assert any(f"values of {name} are exactly the largest, 4095" in sentence for sentence in advice)
    assert all("full_scale=4095" in sentence and "shorter exposure" in sentence for sentence in advice)
    if lamp == 3800:
        assert calibrate(dark, white, raw, full_scale=4095).quality.clipped == ()
    assert calibrate(dark, white, raw, full_scale=4096).quality.clipped != ()


@pytest.mark.parametrize("repeats", [1, 2, 3, 50])
@pytest.mark.parametrize("curved", [0, 0.8])
@pytest.mark.parametrize("noise", [0, 0.02, 0.1, 0.3, 1.0])
@pytest.mark.parametrize(("lamp", "black"), [(3000, 500), (3000.4, 0.4), (180.9, 4.5), (100.5, 0)])
def test_pictures_that_are_not_clipped_raise_no_alarm(repeats, curved, noise, lamp, black):
    """Many values are the largest one where the noise is less than a grey level, or none."""
    quality = calibrate(*clipping(lamp, repeats, curved, noise, black)).quality
    assert quality.clipped == ()


@pytest.mark.parametrize("crop", [None, (4, 6, 32, 40)])
def test_pictures_of_another_size_are_refused(crop, tmp_path):
    """Their upper left part would be other pixels of the sensor."""
    dark, white, raw = pictures()
    larger = np.pad(dark, ((0, 0), (0, 16), (0, 16)))
    for given, name in (((larger, white, raw), "dark"), ((dark, larger, raw), "white")):
        with pytest.raises(InputError, match=rf"{name} is of 80 x 80 pixels, but patterns of 64 x 64"):
            calibrate(*given, crop=crop)
    made = calibrate(dark, white, raw, crop=crop)
    made.save(tmp_path / "c.mat")
    for calibration in (made, Calibration.load(tmp_path / "c.mat")):
        with pytest.raises(InputError, match="raw is of 80 x 80 pixels, but patterns of 64 x 64"):
            calibration.correct(larger)


def test_bad_pixels_of_the_whole_sensor_go_with_a_cropped_calibration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dark, white, raw = pictures()
    calibrate(dark, white, raw, crop=(4, 6, 32, 40)).save("c.npz")
    io.write("raw.npy", raw[0, 0, 0])
    io.write("bad.png", (255 * HOT).astype(np.uint8))
    words = ["solve", "raw.npy", "--iterations", "1", "--bad", "bad.png"]
    done = CliRunner().invoke(main, [*words, "--calibration", "c.npz"])
    assert done.exit_code == 0, done.output
    assert "--masks" not in done.output
    io.write("part.npy", raw[0, 0, 0, 4:36, 6:46])
    io.write("part.png", (255 * HOT[4:36, 6:46]).astype(np.uint8))
    done = CliRunner().invoke(main, ["solve", "part.npy", *words[2:-1], "part.png", "--masks", "c.npz"])
    assert done.exit_code == 0, done.output
    assert "the dark frame and the bad pixels of c.npz are not used: --calibration" in done.output
    io.write("masks.npy", calibrate(dark, white, raw, crop=(4, 6, 32, 40)).masks)
    compare = ["compare", "raw.npy", "--priors", "tv", *words[2:], "--calibration", "c.npz", "--masks", "masks.npy"]
    done = CliRunner().invoke(main, compare)
    assert done.exit_code == 0, done.output
    assert "the masks are those of masks.npy, dark frame and bad pixels those of c.npz" in done.output


@pytest.fixture(scope="module")
def saturated():
    """A calibration of a camera of 12 bits whose pixels have their own dark values, a capture, and the true video."""
    rng = np.random.default_rng(3)
    truth = pnp_sci.datasets.embedded_scene(SIDE).truth[:, :B]
    dark = 100 + rng.normal(0, 8, (SIDE, SIDE))

    def taken(light):
        return (light + dark + rng.normal(0, 2, light.shape)).clip(0, 4095).round().astype(np.uint16)

    made = calibrate(taken(np.zeros((5, SIDE, SIDE))), None, taken(3000.0 * MASKS), full_scale=4095)
    light = np.einsum("vbhw,vbhw->hw", MASKS, truth)
    scale = 4100 / np.quantile(light, 0.8)
    return made, taken(scale * light), scale * truth


def test_saturated_measurements_end_at_one_value(saturated):
    """Bug: full scale less the dark value was another value in each pixel, so that hardly one was saturated."""
    made, raw, light = saturated
    y = made.correct(raw)
    assert made.saturation == pytest.approx(4095 - 100 - 25, abs=15)
    assert made.saturation + made.black_level == made.full_scale
    camera = pnp_sci.Sensor(full_scale=made.saturation, black_level=made.black_level)
    assert y.max() == made.saturation
    assert (camera.saturated(y) | ~(raw == 4095)).all()
    assert camera.saturated(y).sum() < 1.1 * np.sum(raw == 4095)
    results = (pnp_sci.solve(y, made.masks, "tv", noise=noise).x for noise in (camera, "auto"))
    told, not_told = (np.mean(pnp_sci.psnr(x, light, light.max())) for x in results)
    assert told > not_told + 1


@pytest.mark.parametrize("command", ["solve", "compare", "reconstruct"])
def test_commands_take_a_calibration_and_its_full_scale(saturated, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    made, raw, _ = saturated
    made.save("c.npz")
    assert Calibration.load("c.npz").saturation == made.saturation
    io.write("raw.npy", raw)
    names = {"solve": "--prior", "compare": "--priors", "reconstruct": "--prior"}
    words = [command, "raw.npy", "--calibration", "c.npz", names[command], "tv", "--iterations", "3"]
    expected = pnp_sci.solve(
        made.correct(raw), made.masks, "tv", iterations=3, noise=pnp_sci.Sensor(full_scale=made.saturation)
    )
    done = CliRunner().invoke(main, [*words, *(["--json", "t.json"] if command == "compare" else [])])
    assert done.exit_code == 0, done.output
    if command == "solve":
        x = pnp_sci.Result.load("result.npz").x
    elif command == "reconstruct":
        x = pnp_sci.Reconstruction("video.zarr").video(0)
    else:
        (row,) = json.loads(Path("t.json").read_text())["rows"]
        assert "--calibration c.npz" in row["command"]
        assert not {"--masks", "--full-scale"} & set(row["command"].split())  # those of the calibration hold
        found = {"pnp_sci": pnp_sci}
        exec(row["python"], found)
        x = found["result"].x
    np.testing.assert_array_equal(x, expected.x)


@pytest.mark.parametrize("command", ["solve", "compare", "reconstruct"])
def test_grey_levels_are_those_of_raw_pictures(saturated, tmp_path, monkeypatch, command):
    """Bug: they began at the dark frame, and their step was too small."""
    monkeypatch.chdir(tmp_path)
    made, raw, _ = saturated
    made.save("c.npz")
    io.write("raw.npy", raw)
    seen = []

    def stopped(*arguments, **options):
        seen.append(options["noise"])
        raise InputError("enough")

    monkeypatch.setattr(
        {"solve": "pnp_sci.api.solve", "compare": "pnp_sci.bench.compare", "reconstruct": "pnp_sci.reconstruct"}[
            command
        ],
        stopped,
    )
    CliRunner().invoke(main, [command, "raw.npy", "--calibration", "c.npz", "--bits", "12"])
    assert seen[0].step == pytest.approx(4095 / (2**12 - 1))
    assert seen[0].full_scale == made.saturation
    assert eval(repr(seen[0])) == seen[0]


def test_a_raw_picture_that_is_missing_is_no_measurement(saturated, tmp_path):
    made, raw, _ = saturated
    videos = pnp_sci.reconstruct(np.stack([raw, 0 * raw]), made, tmp_path / "v.zarr", prior="tv", iterations=1)
    assert [row["ok"] for row in videos.table()] == [True, False]
    assert "y is 0 everywhere" in videos.record(1)["error"]


@pytest.mark.parametrize("full_scale", [5.0, 100.0, np.nan, np.inf])
def test_full_scale_is_above_the_dark(saturated, full_scale):
    made, raw, _ = saturated
    with pytest.raises(InputError, match=f"full_scale is {full_scale}: more than the largest dark value"):
        replace(made, full_scale=full_scale).correct(raw)


def test_crop_holds_for_measurements_too():
    dark, white, raw = pictures()
    made = calibrate(dark, white, raw, crop=(4, 6, 32, 40))
    assert made.masks.shape == (V, B, 32, 40)
    np.testing.assert_allclose(made.correct(white).data, white[:, 4:36, 6:46] - made.dark, rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((np.ones((8, 8)), np.zeros((8, 8)), np.ones((2, 8, 8))), "white is not brighter than dark"),
        ((np.zeros((8, 8)), None, np.full((2, 8, 8), np.nan)), "patterns has 128 values that are NaN"),
        ((np.zeros((7, 8)), None, np.ones((2, 8, 8))), "dark is of 7 x 8 pixels"),
        ((np.zeros((8, 8)), np.ones((3, 1, 8, 8)), np.ones((2, 2, 8, 8))), "white has pictures of 3 views"),
        ((np.zeros((8, 8)), None, np.ones((8, 8))), "patterns has shape"),
        ((np.full((8, 8), 9), None, np.ones((2, 8, 8))), "order may be another"),
    ],
)
def test_errors_name_the_argument(arguments, said):
    with pytest.raises(InputError, match=said):
        calibrate(*arguments)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
def test_it_is_kept(tmp_path, suffix):
    made = calibrate(*pictures(), crop=(4, 6, 32, 40))
    made.save(tmp_path / f"c{suffix}")
    back = Calibration.load(tmp_path / f"c{suffix}")
    for name in ("masks", "dark", "bad"):
        np.testing.assert_array_equal(getattr(back, name), getattr(made, name))
    assert (back.crop, back.size) == (made.crop, made.size) == ((4, 6, 32, 40), (SIDE, SIDE))


def test_what_a_file_lacks_is_named(tmp_path):
    made = calibrate(*pictures())
    io.write(tmp_path / "c.npz", {"masks": made.masks, "dark": made.dark, "bad": made.bad, "crop": np.array(made.crop)})
    with pytest.raises(FormatError, match=r"c\.npz is no calibration: it lacks size"):
        Calibration.load(tmp_path / "c.npz")


def test_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dark, white, raw = pictures()
    io.write("dark.tif", dark)
    io.write("white.tif", white)
    for view, stack in enumerate(raw, 1):
        io.write(f"view{view}", stack.reshape(-1, SIDE, SIDE))  # folders of pictures
    words = ["calibrate", "view1", "view2", "--dark", "dark.tif", "--white", "white.tif", "--repeats", str(N)]
    done = CliRunner().invoke(main, [*words, "--report", "report.png"])
    assert done.exit_code == 0, done.output
    assert "contrast" in done.output
    assert io.read_masks("calibration.npz").shape == (V, B, SIDE, SIDE)
    assert (tmp_path / "report.png").stat().st_size > 1000
    io.write("raw.tif", raw[0, 0, 0])
    done = CliRunner().invoke(main, ["solve", "raw.tif", "--calibration", "calibration.npz", "--iterations", "2"])
    assert done.exit_code == 0, done.output
    assert pnp_sci.Result.load("result.npz").x.shape == (V, B, SIDE, SIDE)


UNITS = {
    "bytes": lambda levels: levels.astype(np.uint8),
    "whole floats": lambda levels: levels,
    "parts of 255": lambda levels: (levels / 255).astype(np.float32),
    "12 bits in the upper ones of 16": lambda levels: levels.astype(np.uint16) << 4,
}


@pytest.mark.parametrize(("unit", "bright"), [*((unit, 100.0) for unit in UNITS), ("bytes", 12.0)])
@pytest.mark.parametrize("repeats", [1, 4, 5])
@pytest.mark.parametrize("noise", [0.15, 0.3, 0.6])
def test_rounding_makes_no_pixel_bad(unit, bright, repeats, noise):
    """The median deviation of whole numbers is often 0, whatever they are stored as."""
    rng = np.random.default_rng(0)
    light = np.concatenate([np.zeros((repeats, SIDE, SIDE)), bright * MASKS.reshape(-1, SIDE, SIDE)])
    levels = np.round(16.2 + light + noise * rng.standard_normal(light.shape))
    levels[:repeats, 7, 9] = 60  # a hot pixel
    dark, raw = np.split(UNITS[unit](levels), [repeats])
    bad = calibrate(dark, None, raw.reshape(MASKS.shape)).bad & MASKS.any((0, 1))
    assert np.argwhere(bad).tolist() == [[7, 9]]


def test_hot_pixels_are_found_where_there_is_no_noise():
    dark = np.full((SIDE, SIDE), 100.0)
    dark[7, 9] = 1500
    assert np.argwhere(calibrate(dark, None, dark + 3000 * MASKS).bad & MASKS.any((0, 1))).tolist() == [[7, 9]]


def test_white_that_is_saturated():
    dark, white, raw = pictures()
    whites = np.stack([white, white])
    whites[0, :, 3, 4:9] = 65535
    assert calibrate(dark, whites, raw, full_scale=65535).bad[3, 4:9].all()
    with pytest.raises(InputError, match="bad in all pixels"):
        calibrate(dark, np.full_like(white, 65535), raw, full_scale=65535)


def test_another_file_is_no_calibration(tmp_path):
    io.write(tmp_path / "capture.npz", {"y": np.ones((8, 8)), "masks": np.ones((1, 2, 8, 8))})
    with pytest.raises(FormatError, match="is no calibration: it lacks dark, bad, crop, size"):
        pnp_sci.Calibration.load(tmp_path / "capture.npz")
    with pytest.raises(FormatError, match="cannot be read as a result, as it holds none"):
        pnp_sci.Result.load(tmp_path / "capture.npz")
