"""What a notebook shows of results and figures."""

import base64
import re
from io import BytesIO

import imageio.v3
import numpy as np
import pytest
from PIL import Image, ImageSequence

from pnp_sci import io, plot
from pnp_sci.datasets import embedded_scene
from pnp_sci.errors import InputError
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result

LIMIT = 1.5e6  # bytes


def result(x, **settings):
    return Result(x, Status.CONVERGED, History([Record(7, 0.5, 0.01, 0.0)]), settings)


def embedded(html, kind):
    """The files of this kind in the HTML."""
    return [base64.b64decode(data) for data in re.findall(rf'src="data:{kind};base64,([^"]+)"', html)]


@pytest.fixture
def no_ffmpeg(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "av", None)


def test_the_picture_shows_frames_of_every_view():
    truth = embedded_scene(160).truth
    (file,) = embedded(result(truth, peak=1.0)._repr_html_(), "image/png")
    picture = np.asarray(Image.open(BytesIO(file))) / 255
    assert picture.shape[0] == 2 * 160
    for view in range(2):
        row = picture[view * 160 : (view + 1) * 160]
        shown = row.reshape(160, -1, 160).swapaxes(0, 1)
        nearest = [np.abs(truth[view] - frame).max((1, 2)).min() for frame in shown]
        assert max(nearest) < 0.01, "every part of it is a frame of this view"


def test_the_player_shows_all_frames(tmp_path):
    pytest.importorskip("av")
    truth = embedded_scene(64).truth
    html = result(truth, peak=1.0)._repr_html_()
    (film,) = embedded(html, "video/mp4")
    (tmp_path / "film.mp4").write_bytes(film)
    frames = io.read(tmp_path / "film.mp4") / 255
    assert len(frames) == 10
    side_by_side = np.concatenate(list(truth), axis=-1)
    scale = frames.shape[1] // side_by_side.shape[1]
    assert np.sqrt(np.mean((frames[:, ::scale, ::scale] - side_by_side) ** 2)) < 0.05
    assert "<video controls" in html


def test_without_ffmpeg_the_player_is_an_animated_picture(no_ffmpeg):
    html = result(embedded_scene(64).truth)._repr_html_()
    assert "<video" not in html
    (film,) = embedded(html, "image/gif")
    assert len(list(ImageSequence.Iterator(Image.open(BytesIO(film))))) == 10


@pytest.mark.parametrize(
    "shape", [(2, 10, 256, 256), (1, 1, 1, 1), (1, 2, 5, 7), (1, 2, 700, 10), (3, 2, 4, 33, 31), (4, 24, 300, 300)]
)
def test_it_stays_small_for_any_shape(shape):
    noise = np.random.default_rng(0).random(shape, np.float32)
    html = result(noise)._repr_html_()
    assert len(html) < LIMIT
    assert html.count("<table>") == 1
    assert embedded(html, "image/png")


def test_it_stays_small_without_ffmpeg(no_ffmpeg):
    noise = np.random.default_rng(0).random((2, 10, 256, 256), np.float32)
    assert len(result(noise)._repr_html_()) < LIMIT


def test_what_comes_from_outside_is_escaped():
    html = result(np.ones((1, 1, 8, 8)), prior="<script>")._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html


def test_values_that_are_no_numbers_are_black():
    x = np.ones((1, 1, 160, 160))
    x[..., :80] = np.nan
    (file,) = embedded(result(x, peak=1.0)._repr_html_(), "image/png")
    picture = imageio.v3.imread(file)
    assert (picture[:, :80] == 0).all()
    assert (picture[:, 80:] == 255).all()


def test_figures_are_pictures_without_a_magic():
    figures = pytest.importorskip("matplotlib.figure")
    video = embedded_scene(32).truth
    for figure in (plot.plot_video(video), plot.plot_history(result(video)), result(video).plot()):
        assert isinstance(figure, figures.Figure)
        picture = Image.open(BytesIO(figure._repr_png_()))
        assert picture.size == pytest.approx(figure.get_size_inches() * figure.dpi, abs=1)


def test_a_recovery_shows_measurement_result_and_truth():
    pytest.importorskip("matplotlib")
    scene = embedded_scene(32)
    figure = plot.plot_recovery(scene.y, scene.truth / 2, scene.truth, frames=[3], captions=["30 dB", "31 dB"])
    pictures = [axis.images[0].get_array() for axis in figure.axes]
    assert np.array_equal(pictures[0], scene.y)
    assert [np.array_equal(pictures[k], scene.truth[(k - 1) // 2, 3] / (2 if k % 2 else 1)) for k in (1, 2, 3, 4)] == [
        True
    ] * 4
    assert [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel()] == ["view 1, 30 dB", "view 2, 31 dB"]
    with pytest.raises(InputError, match=r"y \(31, 32\)"):
        plot.plot_recovery(scene.y[1:], scene.truth, scene.truth)
    with pytest.raises(InputError, match="from 0 to 9"):
        plot.plot_recovery(scene.y, scene.truth, scene.truth, frames=[10])
