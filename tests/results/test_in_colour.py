"""Results in colour: files, films, pictures, figures and scores."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from PIL import Image
from skimage.metrics import structural_similarity

import pnp_sci
from pnp_sci import Result, io, psnr, ssim
from pnp_sci.errors import FormatError, InputError
from pnp_sci.results.history import History, Record, Status

RED, GREEN = np.array([0.9, 0.1, 0.1], np.float32), np.array([0.1, 0.8, 0.2], np.float32)


def result(*several):
    """Two views, red and green, with a ramp along the columns."""
    x = np.stack([np.broadcast_to(colour, (3, 32, 24, 3)) for colour in (RED, GREEN)])
    x = x * np.linspace(0.5, 1, 24, dtype=np.float32)[:, None]
    x = np.broadcast_to(x, (*several, *x.shape)).copy()
    return Result(x, Status.CONVERGED, History([Record(7, 0.5, 0.01, 0.0)]), {"mosaic": "RGGB"}, [{}])


@pytest.mark.parametrize("several", [(), (2,)])
@pytest.mark.parametrize("suffix", ["npz", "h5", "mat", "zarr"])
def test_files_keep_it(tmp_path, suffix, several):
    if suffix == "zarr":
        pytest.importorskip("zarr")
    before = result(*several)
    before = replace(before, uncertainty=np.where(before.x > 0.5, before.x / 10, np.nan))
    before.save(tmp_path / f"r.{suffix}")
    after = Result.load(tmp_path / f"r.{suffix}")
    assert np.array_equal(after.x, before.x)
    np.testing.assert_array_equal(after.uncertainty, before.uncertainty)
    assert after.settings == before.settings
    if suffix != "zarr":
        assert np.array_equal(io.read_video(tmp_path / f"r.{suffix}", colour=True), before.x)


def test_matlab_has_rows_and_columns_first(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    result().save(tmp_path / "r.mat")
    assert scipy_io.loadmat(tmp_path / "r.mat")["x"].shape == (32, 24, 3, 3, 2)


def test_words_say_so():
    assert "2 views x 3 frames of 32 x 24 in colour" in repr(result())
    assert "2 videos of 2 views" in repr(result(2))
    assert len(result()) == 1
    assert len(result(2)) == 2
    assert result(2)[0].x.shape == (2, 3, 32, 24, 3)


@pytest.mark.parametrize(("suffix", "tolerance"), [("avi", 1), ("mp4", 40), ("gif", 40)])
def test_films(tmp_path, suffix, tolerance):
    made = result(2)
    made.export(tmp_path / f"r.{suffix}", white=1)
    film = io.read_video(tmp_path / f"r.{suffix}", colour=True)[0]
    expected = 255 * np.concatenate([np.concatenate(list(video), 2) for video in made.x])
    assert film.shape == (6, 32, 48, 3)
    assert np.abs(film - expected).max() < tolerance


def test_pictures_and_stacks(tmp_path):
    made = result()
    made.export(tmp_path / "r.png", white=[1, 2])
    picture = np.asarray(Image.open(tmp_path / "r.png"))
    assert picture.shape == (64, 72, 3)
    np.testing.assert_allclose(picture[:32, :24], 255 * made.x[0, 0], atol=1)
    np.testing.assert_allclose(picture[32:, 48:], 255 / 2 * made.x[1, 2], atol=1)
    made.export(tmp_path / "r.tif")
    channels = tifffile.imread(tmp_path / "r.tif")
    assert channels.shape == (3, 6, 32, 24)
    assert np.array_equal(channels[:, 4], made.x[1, ..., 1]), "green of the second view"


@pytest.mark.parametrize("name", ["r.tif", "r.ome.tif"])
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("columns", [1, 24])
@pytest.mark.parametrize("count", [1, 2])
def test_a_tiff_comes_back(tmp_path, name, views, frames, columns, count):
    """In colour and in grey; its channels say which, so that colours are not taken for views."""
    x = result(count).x[:, :views, :frames, :, :columns]
    for video in (x, x[..., 0]):
        colour = video.ndim == 6
        replace(result(), x=video, settings={"mosaic": "RGGB"} if colour else {}).export(tmp_path / name)
        one_film = np.concatenate(list(video), 1)
        np.testing.assert_array_equal(io.read_video(tmp_path / name, colour=colour), one_film)
        with pytest.raises(FormatError, match="colour"):
            io.read_video(tmp_path / name, colour=not colour)


def test_views_are_not_taken_for_colours(tmp_path):
    video = np.random.default_rng(0).random((3, 4, 8, 8), np.float32)
    for name in ("r.tif", "r.ome.tif"):
        replace(result(), x=video, settings={}).export(tmp_path / name)
        np.testing.assert_array_equal(io.read_video(tmp_path / name), video)


@pytest.mark.parametrize("channels", [["DAPI", "GFP"], ["R", "G", "B"]])
def test_channels_of_others_stay_planes(tmp_path, channels):
    """A microscope names its channels too."""
    tifffile = pytest.importorskip("tifffile")
    planes = np.random.default_rng(0).random((len(channels), 8, 8)).astype(np.float32)
    about = {"axes": "CYX", "Channel": {"Name": channels}}
    tifffile.imwrite(tmp_path / "c.ome.tif", planes, metadata=about, photometric="minisblack")
    np.testing.assert_array_equal(io.read_measurement(tmp_path / "c.ome.tif"), planes)
    np.testing.assert_array_equal(io.read_masks(tmp_path / "c.ome.tif"), planes[None])


def test_figures_and_notebooks():
    made = result(2)
    assert len(made.plot(reference=made.x).axes) == 2 * 2 * 2 * 3
    shown = made.plot(frames=[1], white=1).axes[1].images[0].get_array()
    np.testing.assert_allclose(shown, made.x[0, 1, 1], atol=1e-6)
    assert "in colour" in made._repr_html_()
    with pytest.raises(InputError, match="last axis of 3 colours"):
        pnp_sci.plot.plot_video(np.ones((3, 8, 8)), colour=True)


def test_xarray_names_the_colours():
    pytest.importorskip("xarray")
    assert result().to_xarray(fps=10).video.dims == ("measurement", "view", "frame", "y", "x", "colour")


def test_scores_are_of_all_colours():
    truth = np.full((2, 3, 16, 16, 3), 0.5)
    x = truth.copy()
    x[1, ..., 0] += 0.1
    np.testing.assert_allclose(psnr(x, truth)[1], -10 * np.log10(0.01 / 3))
    assert np.isinf(psnr(x, truth)[0])
    x = np.clip(truth + 0.1 * np.random.default_rng(0).standard_normal(truth.shape), 0, 1)
    options = {"data_range": 1, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    each = [structural_similarity(a[..., c], b[..., c], **options) for a, b in zip(x[0], truth[0]) for c in range(3)]
    assert ssim(x, truth)[0] == pytest.approx(np.mean(each))


def test_a_grey_file_is_refused(tmp_path):
    io.write(tmp_path / "x.npz", {"x": np.ones((2, 3, 8, 8))})
    with pytest.raises(FormatError, match="in colour"):
        io.read_video(tmp_path / "x.npz", colour=True)
