"""The plugin for napari: its reader needs no napari, its manifest is valid."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest

import pnp_sci
from pnp_sci import History, Result, Status, io
from pnp_sci.napari_plugin import reader, widget

X = np.random.default_rng(0).random((2, 2, 3, 8, 6), np.float32)
MANIFEST = Path(reader.__file__).with_name("napari.yaml")


@pytest.mark.parametrize("suffix", ["npz", "h5", "mat", "zarr"])
def test_a_result_becomes_layers(tmp_path, suffix):
    pytest.importorskip({"h5": "h5py", "zarr": "zarr"}.get(suffix, "numpy"))
    path = str(tmp_path / f"r.{suffix}")
    Result(X, Status.CONVERGED, History(), {"peak": 2.0}, uncertainty=X / 10).save(path)
    layers = reader.reader(path)(path)
    assert [kept["name"] for _, kept, _ in layers] == [
        f"r {what}view {view}" for what in ("", "uncertainty ") for view in (1, 2)
    ]
    assert [kept["visible"] for _, kept, _ in layers] == [True, True, False, False]
    assert layers[1][1]["contrast_limits"] == (0, 2)
    assert np.array_equal(layers[1][0], X[:, 1].reshape(6, 8, 6))
    assert {kind for *_, kind in layers} == {"image"}


@pytest.mark.parametrize("known", [1.0, np.nan, 0.0])
def test_what_is_not_known_of_errors_stays_unknown(known):
    errors = np.full_like(X, np.nan)
    errors[0, 0] = known
    *_, (first, kept, _), (second, _, _) = reader.layers_of(
        Result(X, Status.CONVERGED, History(), {}, uncertainty=errors), "r"
    )
    np.testing.assert_array_equal(np.stack([first, second]), errors.swapaxes(0, 1).reshape(2, 6, 8, 6))
    assert kept["contrast_limits"] == (0, 1)


def test_other_files_are_left_to_other_readers(tmp_path):
    for name in ("y.npz", "y.h5", "y.mat", "x.npz"):
        if not name.endswith("h5") or importlib.util.find_spec("h5py"):
            io.write(tmp_path / name, {name[0]: np.ones((3, 3))})
    for name in ("y.npz", "y.h5", "y.mat", "x.npz", "none.zarr"):
        assert reader.reader(str(tmp_path / name)) is None
    assert reader.reader(["a.npz", "b.npz"]) is None


def test_what_is_left_to_others_is_not_read(tmp_path, monkeypatch):
    """Neither a store of other software, nor videos of a fleet, nor large arrays of an archive."""
    zarr = pytest.importorskip("zarr")
    np.savez(tmp_path / "y.npz", x=np.ones((3, 3)), y=np.ones((3, 3)))
    for name, attributes in (("a", {}), ("b", {"pnp_sci": {"format": 1, "settings": {}}})):
        group = zarr.create_group(tmp_path / f"{name}.zarr", attributes=attributes)
        group.create_array("0", data=np.ones((3, 3)))

    def read(*arguments, **options):
        pytest.fail("an array was read")

    monkeypatch.setattr(zarr.Array, "__getitem__", read)
    monkeypatch.setattr(np.lib.format, "read_array", read)
    for name in ("y.npz", "a.zarr", "b.zarr"):
        assert reader.reader(str(tmp_path / name)) is None


def test_the_widget_recovers_from_files(tmp_path):
    scene = pnp_sci.datasets.embedded_scene(32)
    io.write(tmp_path / "m.npz", {"y": scene.y, "masks": scene.masks})
    layers = widget.recover(tmp_path / "m.npz", None, "tv", "fast")
    assert [data.shape for data, *_ in layers] == [(10, 32, 32)] * 2


def test_the_manifest_is_valid():
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(MANIFEST)
    manifest.validate_imports()
    assert [command.id for command in manifest.contributions.commands] == ["pnp-sci.read", "pnp-sci.solve"]


def test_the_form_solves_in_a_thread_and_adds_the_views(tmp_path, monkeypatch):
    napari = pytest.importorskip("napari")
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    qt = pytest.importorskip("qtpy.QtWidgets")
    app = qt.QApplication.instance() or qt.QApplication([])
    viewer = pytest.importorskip("napari.components").ViewerModel()
    monkeypatch.setattr(napari, "current_viewer", lambda: viewer)
    scene = pnp_sci.datasets.embedded_scene(32)
    io.write(tmp_path / "m.npz", {"y": scene.y, "masks": scene.masks})
    form = widget.solve_widget()
    form.measurement.value = tmp_path / "m.npz"
    form.effort.value = "fast"
    form.call_button.changed.emit(True)
    until = time.monotonic() + 60
    while not (len(viewer.layers) == 2 and form.call_button.enabled) and time.monotonic() < until:
        app.processEvents()
    assert [layer.data.shape for layer in viewer.layers] == [(10, 32, 32)] * 2
    assert form.call_button.enabled
