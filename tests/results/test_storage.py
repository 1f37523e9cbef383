"""Results in files: nothing is lost, nothing is pickled, and files of version 0.1.0 are read."""

import json
import os
import pickle
import zipfile
from dataclasses import replace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_result import RECORDS, make

import pnp_sci
from pnp_sci import io
from pnp_sci.errors import FormatError, InputTypeError
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result

SUFFIXES = ["npz", "h5", "hdf5", "NPZ", "mat", "zarr"]
numbers = st.floats(allow_nan=False)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(2, 3, 8, 6), (1, 1, 1, 1), (4, 2, 3, 8, 6)])
@pytest.mark.parametrize("status", [Status.CONVERGED, Status.NOT_FINITE])
def test_what_is_saved_is_loaded(tmp_path, suffix, dtype, shape, status):
    result = make(shape, dtype, status, scenes=[{"active": [True, False], "name": "Straße"}])
    path = tmp_path / f"result.{suffix}"
    result.save(path)
    back = Result.load(path)
    assert back.x.dtype == dtype
    assert np.array_equal(back.x, result.x)
    assert (back.status, back.history) == (result.status, result.history)
    assert (back.settings, back.scenes) == (result.settings, result.scenes)
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


@pytest.mark.parametrize("suffix", ["npz", "h5", "mat", "zarr"])
def test_what_was_found_of_a_scene_comes_back_equal(tmp_path, suffix):
    scene = pnp_sci.datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, iterations=2, scene=pnp_sci.SceneModel((True, False), (True, False)))
    result.save(tmp_path / f"result.{suffix}")
    back = Result.load(tmp_path / f"result.{suffix}")
    assert (back.scenes, back.settings) == (result.scenes, result.settings)


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


@pytest.mark.parametrize("chunk", ["video/c/0/1/0/0", "history/c/0/0", "uncertainty/c/0/0/0/0"])
def test_a_store_without_all_its_chunks_is_refused(tmp_path, chunk):
    """Zarr reads zeros for a chunk that is not there: those that are zero are written, too."""
    path = tmp_path / "r.zarr"
    result = make()
    result = replace(result, x=np.zeros_like(result.x), uncertainty=np.zeros_like(result.x))
    result.save(path)
    assert not Result.load(path).x.any()
    (path / chunk).unlink()
    with pytest.raises(FormatError, match=rf"1 of the \d chunks of {chunk.partition('/')[0]} are missing"):
        Result.load(path)


def test_other_suffixes_are_refused_before_anything_is_written(tmp_path):
    for act in (make().save, Result.load):
        with pytest.raises(FormatError, match=r"\.npz, \.h5, \.hdf5, \.mat, \.zarr, but \.pkl came"):
            act(tmp_path / "result.pkl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_the_video_of_a_saved_result_is_found_by_io(tmp_path, suffix):
    make().save(tmp_path / f"r.{suffix}")
    assert np.array_equal(io.read_video(tmp_path / f"r.{suffix}", key="x"), make().x)


def test_nothing_is_pickled_inside_the_archive(tmp_path):
    make().save(tmp_path / "r.npz")
    with zipfile.ZipFile(tmp_path / "r.npz") as archive:
        for name in archive.namelist():
            with archive.open(name) as stream:
                np.lib.format.read_array(stream, allow_pickle=False)


# ---- files of version 0.1.0 ------------------------------------------------------------------------------------------

SENTENCES = {  # as version 0.1.0 wrote them
    "the iterates stopped changing": "CONVERGED",
    "a network decoded the measurement, without iterations": "DECODED",
    "the number of iterations was reached": "ITERATIONS",
    "the time budget was spent": "TIME_BUDGET",
    "the callback asked to stop": "STOPPED",
    "the residual grew: the best iterate before that is returned": "DIVERGED",
    "an iterate was not finite: the last finite one is returned": "NOT_FINITE",
}
STILL = {"views": (True, True), "still": True, "reason": "nothing moves", "frames_modelled": 2, "frames": 6}
MOVING = {"views": (True, True), "still": False, "reason": "as asked for", "frames_modelled": 6, "frames": 6}


def write_as_0_1_0(path, x, sentence, scene):
    """A file in the layout of version 0.1.0: one scene, or several as "measurements"; no plan among the settings."""
    texts = {
        "status": sentence,
        "history_columns": json.dumps(["iteration", "seconds", "residual", "sigma", "psnr", "ssim", "measurement"]),
        "settings": json.dumps({"prior": "tv", "algorithm": "gap", "iterations": 2, "seed": 0}),
        "scene": json.dumps(scene),
    }
    history = np.array([[1, 0.5, 0.25, 0.1, 20.5, np.nan, 0], [2, 1.0, 0.125, 0.05, 21.0, 0.75, 0]])
    if path.suffix == ".npz":
        np.savez(path, x=x, history=history, **texts)
        return
    with h5py.File(path, "w") as file:
        file["x"], file["history"] = x, history
        file.attrs.update(texts)


@pytest.mark.parametrize("suffix", ["npz", "h5"])
@pytest.mark.parametrize(("sentence", "name"), SENTENCES.items())
def test_a_result_of_0_1_0_is_read(tmp_path, suffix, sentence, name):
    path, x = tmp_path / f"old.{suffix}", make().x
    write_as_0_1_0(path, x, sentence, STILL)
    result = Result.load(path)
    assert np.array_equal(result.x, x)
    assert result.status is Status[name]
    assert result.history == History(RECORDS)
    assert result.settings["prior"] == "tv"
    assert (result.scenes, result.scene) == ([STILL], STILL)
    assert "2 iterations in 1 s" in str(result)


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_several_measurements_of_0_1_0_have_a_scene_each(tmp_path, suffix):
    path = tmp_path / f"old.{suffix}"
    write_as_0_1_0(path, make((2, 2, 3, 8, 6)).x, "the time budget was spent", {"measurements": [STILL, MOVING]})
    assert Result.load(path).scenes == [STILL, MOVING]


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_what_0_1_0_decoded_has_a_scene_of_which_nothing_is_known(tmp_path, suffix):
    path = tmp_path / f"old.{suffix}"
    write_as_0_1_0(path, make().x, "a network decoded the measurement, without iterations", {})
    assert Result.load(path).scene == {}


def test_an_old_result_is_kept_in_the_new_layout(tmp_path):
    write_as_0_1_0(tmp_path / "old.npz", make().x, "the iterates stopped changing", STILL)
    Result.load(tmp_path / "old.npz").save(tmp_path / "new.h5")
    assert Result.load(tmp_path / "new.h5").scenes == [STILL]


@pytest.mark.parametrize("scene", ["[]", "3", '"text"', "{"])
def test_a_scene_that_is_none_is_refused(tmp_path, scene):
    write_as_0_1_0(tmp_path / "old.npz", make().x, "the iterates stopped changing", {})
    with np.load(tmp_path / "old.npz") as file:
        parts = dict(file)
    np.savez(tmp_path / "old.npz", **(parts | {"scene": scene}))
    with pytest.raises(FormatError, match="cannot be read as a result"):
        Result.load(tmp_path / "old.npz")
