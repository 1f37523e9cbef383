"""What a result shows of itself, in words, pictures and films."""

import imageio.v3
import numpy as np
import pytest
from made_result import make

from pnp_sci import io
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.plot import plot_history, plot_video
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result


def test_it_is_an_array():
    result = make()
    assert np.asarray(result) is result.x
    assert np.asarray(result, np.float64).dtype == np.float64
    assert not np.shares_memory(np.array(result, copy=True), result.x)
    assert np.array_equal(np.sqrt(result), np.sqrt(result.x))


def test_repr_says_size_effort_status_and_scores():
    text = repr(make((5, 2, 3, 8, 6)))
    assert text == (
        "Result(5 videos of 2 views x 3 frames of 8 x 6, 2 iterations in 1 s: the iterates stopped changing; "
        "residual 0.12, PSNR 21.00 dB, SSIM 0.750)"
    )
    assert "Result(1 video of 2 views x" in repr(make((1, 2, 3, 8, 6)))
    several = History([Record(10, 1.0, 0.1, 0.1), Record(20, 2.0, 0.3, 0.1, measurement=1)])
    assert "30 iterations in 3 s" in repr(make(history=several))
    assert "residual 0.2)" in repr(make(history=several))
    assert "0 iterations" in repr(make(history=History()))


def test_html_is_escaped():
    html = make(settings={"prior": "<script>"})._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html


def test_white_is_the_peak_or_nearly_the_largest_value():
    ramp = np.linspace(0, 10, 10_001).reshape(1, 1, 73, 137)
    assert Result(ramp, Status.CONVERGED, History(), {}).white == pytest.approx(9.99)
    assert Result(ramp, Status.CONVERGED, History(), {"peak": 5.0}).white == 5.0
    assert Result(np.zeros((1, 1, 2, 2)), Status.CONVERGED, History(), {}).white == 1.0


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_export_puts_views_side_by_side_whatever_the_scale(tmp_path, scale):
    x = np.zeros((2, 3, 16, 12), np.float32)
    x[0, 1], x[1, 2] = scale, 0.5 * scale
    result = Result(x, Status.CONVERGED, History(), {})
    result.export(tmp_path / "r.png")
    sheet = imageio.v3.imread(tmp_path / "r.png")
    assert sheet.shape == (32, 36)
    assert (sheet[:16, 12:24] == 255).all()
    assert (sheet[16:, 24:] == 128).all()


@pytest.mark.parametrize("suffix", ["mp4", "avi", "gif"])
def test_export_makes_films(tmp_path, suffix):
    make((2, 3, 32, 24)).export(tmp_path / f"r.{suffix}", fps=5)
    assert io.read(tmp_path / f"r.{suffix}").shape == (3, 32, 48)


def test_several_measurements_follow_one_another(tmp_path):
    result = make((4, 2, 3, 8, 6), settings={"peak": 1.0})
    result.export(tmp_path / "r.tif")
    stack = io.read(tmp_path / "r.tif")
    assert stack.shape == (2, 12, 8, 6)
    assert np.array_equal(stack[1, 3 * 2 + 1], result.x[2, 1, 1])


def test_export_to_another_format_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"cannot export as \.docx; known are \.avi"):
        make().export(tmp_path / "r.docx")


def test_plots_show_every_view_and_the_reference(tmp_path):
    result = make()
    figure = result.plot(frames=[0, 2], reference=result.x)
    assert len(figure.axes) == 8
    assert figure.axes[0].get_ylabel() == "view 1"
    assert figure.axes[2].get_ylabel() == "reference view 1"
    figure.savefig(tmp_path / "r.png")
    assert len(make((4, 2, 9, 8, 6)).plot().axes) == 8 * 6
    assert len(plot_history(result).axes) == 3
    assert len(plot_history(make(history=History(Record(i, 1.0, 0.1, 0.0) for i in range(3)))).axes) == 2


def test_plots_refuse_what_they_cannot_show():
    with pytest.raises(InputError, match=r"frames is \[3\]: a list of whole numbers from 0 to 2"):
        make().plot(frames=[3])
    with pytest.raises(InputError, match="frames is 'all': a list of whole"):
        make().plot(frames="all")
    with pytest.raises(InputTypeError, match=r"result is an array.*Result"):
        plot_history(np.ones((4, 4)))
    with pytest.raises(InputError, match="reference has shape"):
        plot_video(np.ones((2, 3, 4, 4)), reference=np.ones((2, 3, 4, 5)))
    with pytest.raises(InputError, match="x has shape"):
        plot_video(np.ones((4, 4)))


# ---- how it was obtained ---------------------------------------------------------------------------------------------

PLAN = {
    "algorithm": "gap",
    "serves": [
        {"name": "TV", "prior": "TV(strength=1.0)", "from": 0},
        {"name": "Flow", "prior": "Flow(first=60)", "from": 60},
    ],
    "sigma": [0.08, 0.05],
    "rho": 0.25,
    "iterations": 90,
    "tol": 8e-5,
}


def test_print_says_which_prior_serves_when_and_with_what():
    text = str(make(settings={"plan": [PLAN]}))
    first, *plans = text.splitlines()
    assert first == repr(make())
    assert len(plans) == 1
    for words in ("gap", "TV to iteration 60", "Flow to iteration 90", "0.08 to 0.05", "rho 0.25"):
        assert words in plans[0]
    constant = PLAN | {"serves": PLAN["serves"][:1], "sigma": [0.05, 0.05], "algorithm": "admm"}
    text = str(make(settings={"plan": [constant]}))
    assert "admm" in text
    assert "sigma 0.05" in text
    assert "falling" not in text
    assert "Flow" not in text


def test_print_has_a_line_for_each_measurement():
    lines = str(make((2, 2, 3, 8, 6), settings={"plan": [PLAN, PLAN | {"iterations": 40}]})).splitlines()[1:]
    assert ["measurement 1" in lines[0], "measurement 2" in lines[1]] == [True, True]
    assert "to iteration 40" in lines[1]


def test_print_says_nothing_of_a_plan_where_there_is_none():
    assert str(make()) == repr(make())


def test_one_measurement_has_a_scene_and_several_have_scenes():
    one, other = {"still": True}, {"still": False}
    assert make(scenes=[one]).scene is one
    assert make().scene == {}
    with pytest.raises(InputError, match=r"2 measurements: scenes\[n\] was expected"):
        _ = make(scenes=[one, other]).scene
