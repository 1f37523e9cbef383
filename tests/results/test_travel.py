"""Results in other software: xarray, Zarr, MATLAB, ImageJ, OME; parts of results; brightness."""

import json
import os

import imageio.v3
import numpy as np
import pytest
import scipy.io
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from made_result import RECORDS, make

import pnp_sci
from pnp_sci import io
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.brightness import whites
from pnp_sci.formats.replacing import check_writable
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result

xarray = pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")
SHAPES = st.tuples(*(st.integers(1, 3) for _ in range(3)), st.integers(1, 6), st.integers(1, 6))


@given(shape=SHAPES, several=st.booleans(), dtype=st.sampled_from([np.float32, np.float64]), sure=st.booleans())
def test_what_is_saved_is_loaded_bit_for_bit(tmp_path_factory, shape, several, dtype, sure):
    result = make(shape[1 - several :], dtype, uncertainty=None)
    if sure:
        errors = np.where(result.x > 0.5, result.x, np.nan).astype(dtype)
        result = make(shape[1 - several :], dtype, uncertainty=errors)
    for suffix in ("mat", "zarr"):
        path = tmp_path_factory.getbasetemp() / f"any.{suffix}"
        result.save(path)
        back = Result.load(path)
        assert back.x.tobytes() == result.x.tobytes()
        assert (back.x.shape, back.x.dtype) == (result.x.shape, dtype)
        assert (back.uncertainty is None) is not sure
        assert not sure or back.uncertainty.tobytes() == errors.tobytes()
        assert (back.history, back.settings) == (result.history, result.settings)


def test_matlab_finds_planes_last_and_json(tmp_path):
    make((4, 2, 3, 8, 6)).save(tmp_path / "r.mat")
    found = scipy.io.loadmat(tmp_path / "r.mat")
    assert found["x"].shape == (8, 6, 3, 2, 4)
    assert np.array_equal(found["x"][:, :, 2, 1, 3], make((4, 2, 3, 8, 6)).x[3, 1, 2])
    assert json.loads(str(found["settings"][0]))["prior"] == "tv"
    assert found["status"][0] == Status.CONVERGED.value


def test_a_zarr_store_is_an_ome_image_of_a_chunk_a_view(tmp_path):
    result = make((4, 2, 3, 8, 6))
    result.save(tmp_path / "r.zarr")
    group = zarr.open_group(tmp_path / "r.zarr", mode="r")
    image = group.attrs["ome"]["multiscales"][0]
    assert group.attrs["ome"]["version"] == "0.5"
    assert [axis["type"] for axis in image["axes"]] == ["time", "channel", "space", "space"]
    video = group[image["datasets"][0]["path"]]
    assert video.metadata.dimension_names == tuple(axis["name"] for axis in image["axes"])
    assert video.chunks == (3, 1, 8, 6)
    assert np.array_equal(video[7, 1], result.x[2, 1, 1])


def test_xarray_opens_the_store(tmp_path):
    make().save(tmp_path / "r.zarr")
    with xarray.open_dataset(tmp_path / "r.zarr", engine="zarr", consolidated=False) as data:
        assert data.video.dims == ("t", "c", "y", "x")
        assert np.array_equal(data.video.values.swapaxes(0, 1), make().x)


def test_an_interrupted_write_keeps_the_earlier_store(tmp_path, monkeypatch):
    path = tmp_path / "r.zarr"
    make().save(path)

    real, calls = os.rename, []

    def interrupted(*names):
        calls.append(names)
        if len(calls) == 2:  # the earlier one is aside, the new one not yet in its place
            raise KeyboardInterrupt
        real(*names)

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    for name, act, error in (
        ("os.rename", interrupted, KeyboardInterrupt),
        ("zarr.Group.create_array", full, OSError),
    ):
        monkeypatch.setattr(name, act)
        with pytest.raises(error):
            make(status=Status.STOPPED).save(path)
        monkeypatch.undo()
        assert Result.load(path).status is Status.CONVERGED
        assert os.listdir(tmp_path) == ["r.zarr"]


@pytest.mark.parametrize(
    "attributes",
    [
        {"mine": 1}, {"mine": {"pnp_sci": {"status": "mine"}}}, {"pnp_sci": {"format": 1, "settings": {}}},
        {"pnp_sci": "status"}, {"pnp_sci": ["status"]}, {"pnp_sci": None}, {"pnp_sci": {}},
    ],
)  # fmt: skip
def test_a_store_of_others_is_neither_replaced_nor_read(tmp_path, attributes):
    zarr.open_group(tmp_path / "r.zarr", mode="w").attrs.update(attributes)
    with pytest.raises(FileExistsError, match="remove it first"):
        make().save(tmp_path / "r.zarr")
    assert dict(zarr.open_group(tmp_path / "r.zarr", mode="r").attrs) == attributes
    with pytest.raises(FormatError, match="cannot be read as a result"):
        Result.load(tmp_path / "r.zarr")
    with pytest.raises(FileNotFoundError):
        Result.load(tmp_path / "none.zarr")


def test_a_file_in_the_place_of_a_store_is_noticed_before_any_work(tmp_path):
    file = tmp_path / "r.zarr"
    file.write_text("mine")
    for write in (check_writable, make().save):
        with pytest.raises(FileExistsError, match=r"r\.zarr is a file"):
            write(file)
    assert file.read_text() == "mine"
    assert os.listdir(tmp_path) == ["r.zarr"]


def test_xarray_has_axes_times_and_the_record():
    result = make(uncertainty=make().x / 10, scenes=[{"remarks": ["hot pixels"]}])
    data = result.to_xarray(fps=4)
    assert data.video.dims == data.uncertainty.dims == ("measurement", "view", "frame", "y", "x")
    assert np.array_equal(data.video.sel(measurement=0, view=1, frame=2), result.x[1, 2])
    assert np.array_equal(data.uncertainty.sel(measurement=0, view=1, frame=2), result.uncertainty[1, 2])
    assert data.time.values.tolist() == [0, 0.25, 0.5]
    assert json.loads(data.attrs["remarks"]) == ["hot pixels"]
    assert json.loads(data.attrs["settings"]) == result.settings
    assert "time" not in make().to_xarray().coords


@pytest.mark.parametrize("name", ["r.tif", "r.tiff", "r.ome.tif"])
@pytest.mark.parametrize("shape", [(2, 3, 8, 6), (1, 3, 8, 6), (4, 2, 3, 8, 6)])
def test_a_tiff_has_the_values(tmp_path, name, shape):
    result = make(shape)
    result = Result(100 * result.x - 30, result.status, result.history, {})
    result.export(tmp_path / name, fps=5)
    ordered = result.x.reshape(-1, *shape[-4:]).swapaxes(1, 2).reshape(-1, shape[-4], 8, 6)
    with tifffile.TiffFile(tmp_path / name) as file:
        series = file.series[0]
        assert series.get_axes(squeeze=False).replace("Z", "").rstrip("S") == "TCYX"
        assert file.is_ome is ("ome" in name)
        assert np.array_equal(series.asarray().reshape(ordered.shape), ordered)
        if file.is_imagej:
            assert (file.imagej_metadata["fps"], file.imagej_metadata["frames"]) == (5, len(ordered))
        else:
            assert 'TimeIncrement="0.2"' in file.ome_metadata
    assert np.array_equal(io.read_video(tmp_path / name), ordered.swapaxes(0, 1))


def test_one_of_several_is_what_it_is_alone():
    scene = pnp_sci.datasets.embedded_scene(32)
    y = np.stack([scene.y, pnp_sci.simulate(scene.truth[:, ::-1].copy(), scene.masks)])
    both = pnp_sci.solve(y, scene.masks, iterations=3, uncertainty=True)
    assert len(both) == len(list(both)) == 2
    for n in (0, 1, -1):
        alone, part = pnp_sci.solve(y[n], scene.masks, iterations=3, uncertainty=True), both[n]
        assert np.array_equal(part.x, alone.x)
        assert np.array_equal(part.uncertainty, alone.uncertainty, equal_nan=True)
        assert (part.status, part.scenes) == (alone.status, alone.scenes)
        assert np.array_equal(part.history["residual"], alone.history["residual"])
        assert set(part.history["measurement"]) == {0}
        differ = {key for key in alone.settings if alone.settings[key] != part.settings[key]}
        assert differ <= {"y", "seconds"}
    assert both[::-1].settings["measurements"] == [1, 0]
    assert np.array_equal(both[::-1][0].x, both[1].x)


def test_numbers_beyond_are_index_errors():
    result = make((2, 2, 3, 8, 6), history=History(RECORDS))
    for number in (2, -3):
        with pytest.raises(InputError, match=f"index is {number}: a whole number from -2 to 1") as caught:
            result[number]
        assert isinstance(caught.value, IndexError)
    with pytest.raises(InputError, match="at least one of 2 measurements"):
        result[2:]
    one = make()
    assert len(one) == 1
    assert np.array_equal(one[0].x, one.x)
    assert one[:].x.shape == (1, *one.x.shape)


def test_white_of_each_view(tmp_path):
    x = np.stack([np.full((3, 16, 16), 1.0), np.full((3, 16, 16), 0.25)])
    result = Result(x, Status.CONVERGED, History(), {})
    for white, grey in ((None, 64), ("view", 255), (0.5, 128), ([1, 0.5], 128)):
        result.export(tmp_path / "r.png", white=white)
        assert imageio.v3.imread(tmp_path / "r.png")[16:].max() == grey
    assert [a.images[0].get_clim()[1] for a in result.plot(frames=[0], white="view").axes] == [1.0, 0.25]
    assert result.show(white="view")._repr_html_() != result._repr_html_()
    for wrong in (0, -1, float("nan"), [1, 2, 3], "views", []):
        with pytest.raises(InputError, match=r'white is .*: a number > 0, 2 of them \(one a view\), or "view"'):
            whites(wrong, x[None])


def test_a_part_of_a_sequence_has_its_window():
    scene = pnp_sci.datasets.embedded_scene(32)
    every = pnp_sci.solve(np.stack([scene.y] * 4), scene.masks, iterations=5, sequence=3)
    for n, window in enumerate((0, 0, 2, 2)):
        own = every[n]
        assert len(own.settings["plan"]) == len(own.settings["statuses"]) == 1
        expected = [record.residual for record in every.history if record.measurement == window]
        np.testing.assert_array_equal(own.history["residual"], expected)
    assert {record.measurement for record in every[1:].history} == {0, 1}


@pytest.mark.parametrize("name", ["r.tif", "r.ome.tif"])
@pytest.mark.parametrize("unit", [1e300, 1e-300])
def test_values_that_a_tiff_cannot_hold_are_refused(tmp_path, name, unit):
    result = Result(unit * np.ones((2, 3, 4, 5)), Status.CONVERGED, History(), {})
    with pytest.raises(InputError, match=rf"{name}: the video reaches 1e.*float32"):
        result.export(tmp_path / name)
    assert not os.listdir(tmp_path)
    result.export(tmp_path / "r.png")
