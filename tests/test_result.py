import json
import os
import pickle
import zipfile

import h5py
import imageio.v3
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pnp_sci import io
from pnp_sci.errors import FormatError, InputError, InputTypeError, SolverError
from pnp_sci.plot import plot_history, plot_video
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result

SUFFIXES = ["npz", "h5", "hdf5", "NPZ"]
RECORDS = [Record(1, 0.5, 0.25, 0.1, 20.5), Record(2, 1.0, 0.125, 0.05, 21.0, 0.75)]


def make(shape=(2, 3, 8, 6), dtype=np.float32, status=Status.CONVERGED, **kept):
    x = np.random.default_rng(0).random(shape).astype(dtype)
    kept = {"history": History(RECORDS), "settings": {"prior": "tv", "seed": 0, "noise": None}, **kept}
    return Result(x, status, **kept)


# ---- status and history ----------------------------------------------------------------------------------------------


def test_only_numerical_failures_are_not_ok():
    assert {status for status in Status if not status.ok} == {Status.DIVERGED, Status.NOT_FINITE}


@pytest.mark.parametrize("status", Status)
def test_raise_for_status_raises_exactly_for_failures(status):
    result = make(status=status)
    if status.ok:
        result.raise_for_status()
    else:
        with pytest.raises(SolverError, match=status.value):
            result.raise_for_status()


@given(st.lists(st.sampled_from(list(Status)), min_size=1))
def test_a_failure_among_many_is_the_worst(statuses):
    worst = Status.worst(statuses)
    assert worst in statuses
    assert worst.ok == all(status.ok for status in statuses)


numbers = st.floats(allow_nan=False)
records = st.builds(
    Record,
    st.integers(0, 10**6),
    numbers,
    numbers,
    numbers,
    st.none() | numbers,
    st.none() | numbers,
    st.integers(0, 99),
)


@given(st.lists(records, max_size=5))
def test_a_table_keeps_the_history(rows):
    history = History(rows)
    assert History.from_table(history.table()) == history
    assert history.table().shape == (len(rows), 7)


def test_history_is_a_sequence_of_records_and_a_table_of_columns():
    history = History(RECORDS)
    assert list(history) == RECORDS
    assert history[-1] is RECORDS[-1]
    assert history[1:] == History(RECORDS[1:])
    assert history["residual"].tolist() == [0.25, 0.125]
    assert np.isnan(history["ssim"]).tolist() == [True, False]
    with pytest.raises(InputError, match=r"'resid'.*residual, sigma"):
        history["resid"]
    with pytest.raises(TypeError):
        history[0] = RECORDS[1]


# ---- save and load ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(2, 3, 8, 6), (1, 1, 1, 1), (4, 2, 3, 8, 6)])
@pytest.mark.parametrize("status", [Status.CONVERGED, Status.NOT_FINITE])
def test_what_is_saved_is_loaded(tmp_path, suffix, dtype, shape, status):
    result = make(shape, dtype, status, scene={"active": [True, False], "name": "Straße"})
    path = tmp_path / f"result.{suffix}"
    result.save(path)
    back = Result.load(path)
    assert back.x.dtype == dtype
    assert np.array_equal(back.x, result.x)
    assert (back.status, back.history) == (result.status, result.history)
    assert (back.settings, back.scene) == (result.settings, result.scene)
    assert os.listdir(tmp_path) == [path.name]


@given(
    settings_=st.dictionaries(
        st.text(), st.none() | st.booleans() | st.integers() | numbers | st.text() | st.lists(st.integers())
    )
)
@settings(max_examples=20, deadline=None)
def test_any_settings_that_json_holds_are_kept(tmp_path_factory, settings_):
    for suffix in ("npz", "h5"):
        path = tmp_path_factory.getbasetemp() / f"any.{suffix}"
        make(settings=settings_).save(path)
        assert Result.load(path).settings == settings_


def test_long_settings_fit_into_hdf5(tmp_path):
    long = {"weights": list(range(100_000))}
    make(settings=long, history=History()).save(tmp_path / "long.h5")
    back = Result.load(tmp_path / "long.h5")
    assert back.settings == long
    assert len(back.history) == 0


def test_numpy_values_become_json(tmp_path):
    path = tmp_path / "r.npz"
    make(settings={"noise": np.float32(0.5), "shape": np.array([1, 2]), "out": tmp_path}).save(path)
    assert Result.load(path).settings == {"noise": 0.5, "shape": [1, 2], "out": str(tmp_path)}


def test_what_json_cannot_hold_is_refused_by_name(tmp_path):
    with pytest.raises(InputTypeError, match="of type object"):
        make(settings={"prior": object()}).save(tmp_path / "r.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_an_interrupted_save_leaves_the_old_file(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"result.{suffix}"
    make().save(path)
    before = path.read_bytes()

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        make(status=Status.STOPPED).save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


def test_files_hold_no_pickle_and_plain_json(tmp_path):
    make().save(tmp_path / "r.npz")
    make().save(tmp_path / "r.h5")
    with np.load(tmp_path / "r.npz", allow_pickle=False) as file:
        assert json.loads(str(file["settings"]))["prior"] == "tv"
        assert json.loads(str(file["history_columns"])) == list(History.names)
    with h5py.File(tmp_path / "r.h5") as file:
        assert json.loads(str(file.attrs["settings"]))["prior"] == "tv"
        assert file["x"].shape == (2, 3, 8, 6)


def test_a_pickle_is_not_opened(tmp_path):
    class Opened:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "opened"),))

    np.savez(tmp_path / "r.npz", x=np.array([Opened()], object), settings="{}", allow_pickle=True)
    (tmp_path / "s.npz").write_bytes(pickle.dumps(Opened()))
    for name in ("r.npz", "s.npz"):
        with pytest.raises(FormatError, match="cannot be read as a result"):
            Result.load(tmp_path / name)
    assert not (tmp_path / "opened").exists()


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_damaged_and_foreign_files_are_refused(tmp_path, suffix):
    path = tmp_path / f"r.{suffix}"
    make().save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError, match="cannot be read as a result"):
        Result.load(path)
    io.write(path, {"y": np.ones((4, 4))})
    with pytest.raises(FormatError, match="cannot be read as a result"):
        Result.load(path)
    with pytest.raises(FileNotFoundError, match="no such file"):
        Result.load(tmp_path / f"none.{suffix}")


def test_other_suffixes_are_refused_before_anything_is_written(tmp_path):
    for act in (make().save, Result.load):
        with pytest.raises(FormatError, match=r"\.npz, \.h5 or \.hdf5, but \.pkl came"):
            act(tmp_path / "result.pkl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_the_video_of_a_saved_result_is_found_by_io(tmp_path, suffix):
    make().save(tmp_path / f"r.{suffix}")
    assert np.array_equal(io.read_video(tmp_path / f"r.{suffix}", key="x"), make().x)


# ---- looking at it ---------------------------------------------------------------------------------------------------


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
    result.export(tmp_path / "r.tiff")
    stack = io.read(tmp_path / "r.tiff")
    assert stack.shape == (3, 16, 24)
    assert stack.dtype == np.float32
    assert stack[1, :, :12] == pytest.approx(1)
    assert stack[2, :, 12:] == pytest.approx(0.5)
    assert stack[0].max() == 0
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
    assert stack.shape == (12, 8, 12)
    assert stack[3 * 2 + 1, :, 6:] == pytest.approx(result.x[2, 1, 1])


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
    with pytest.raises(InputError, match=r"frames is \[3\]: whole numbers from 0 to 2"):
        make().plot(frames=[3])
    with pytest.raises(InputError, match="reference has shape"):
        plot_video(np.ones((2, 3, 4, 4)), reference=np.ones((2, 3, 4, 5)))
    with pytest.raises(InputError, match="x has shape"):
        plot_video(np.ones((4, 4)))


def test_nothing_is_pickled_inside_the_archive(tmp_path):
    make().save(tmp_path / "r.npz")
    with zipfile.ZipFile(tmp_path / "r.npz") as archive:
        for name in archive.namelist():
            with archive.open(name) as stream:
                np.lib.format.read_array(stream, allow_pickle=False)
