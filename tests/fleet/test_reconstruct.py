"""Fleets of measurements: what is written, what is done again, what stops and what does not."""

import json
import re
import shutil
import warnings
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from small import FAST, capture, files

import pnp_sci
from pnp_sci.cli.main import main
from pnp_sci.errors import FormatError, InputError, InputTypeError, SolverError

pytest.importorskip("distributed")
zarr = pytest.importorskip("zarr")


def test_each_video_is_that_of_solve(client, tmp_path):
    y, masks = capture(views=2)
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    assert videos.ok
    assert videos.status == "5 measurements: 5 the number of iterations was reached"
    for n, picture in enumerate(y):
        alone = pnp_sci.solve(picture, masks, **FAST)
        np.testing.assert_array_equal(videos.video(n), alone.x)
        np.testing.assert_array_equal(videos.x[4 * n : 4 * n + 4], alone.x.swapaxes(0, 1))
        assert videos.record(n)["result"]["y"] == alone.settings["y"]
        assert videos.record(n)["scene"]["reason"] == alone.scene["reason"]
    assert [row["measurement"] for row in videos.table()] == list(range(5))
    assert all(row["seconds"] > 0 and row["iterations"] == 3 for row in videos.table())


def test_it_is_ome_zarr_with_a_chunk_a_measurement_and_view(client, tmp_path):
    y, masks = capture(views=2)
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    assert (videos.x.shape, videos.x.chunks, videos.x.dtype) == ((20, 2, 24, 24), (4, 1, 24, 24), np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        group = zarr.open_group(tmp_path / "v.zarr", mode="r")
        assert {name for name, _ in group.members()} == {"0", "masks", "records"}
    image = group.attrs["ome"]["multiscales"][0]
    assert [axis["name"] for axis in image["axes"]] == ["t", "c", "y", "x"] == list(videos.x.metadata.dimension_names)
    assert [channel["label"] for channel in group.attrs["ome"]["omero"]["channels"]] == ["view 1", "view 2"]
    np.testing.assert_array_equal(group["masks"], masks)


def test_xarray_opens_it_lazily(client, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("dask.array")
    y, masks = capture()
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    opened = xarray.open_zarr(tmp_path / "v.zarr", consolidated=False)["0"]
    assert opened.chunks[0] == (4,) * 5
    np.testing.assert_array_equal(opened.isel(t=slice(4, 8)).transpose("c", "t", "y", "x"), videos.video(1))


def test_what_is_done_is_not_done_again(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    before = files(out)
    (out / "records" / "0000002.json").unlink()  # as if it had been killed before this was said
    (out / "records" / ".half-written").write_text("{")
    (out / "0" / "c" / "2" / "0" / "0" / "0").write_bytes(b"half")
    kept = (out / "records" / "0000001.json").stat().st_mtime_ns
    assert pnp_sci.Reconstruction(out).status.endswith("; 1 not solved")
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST).ok
    assert files(out) == before
    assert (out / "records" / "0000001.json").stat().st_mtime_ns == kept
    assert not list((out / "records").glob(".*"))


def test_other_measurements_are_solved_anew(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    y[3] += 7
    videos = pnp_sci.reconstruct(y, masks, out, client, **FAST)
    np.testing.assert_array_equal(videos.video(3), pnp_sci.solve(y[3], masks, **FAST).x)


def test_other_settings_are_refused(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, threads=1, **FAST)
    assert pnp_sci.reconstruct(y, masks, out, client, threads=2, **FAST).ok
    with pytest.raises(InputError, match="options iterations 3 there, 4 now"):
        pnp_sci.reconstruct(y, masks, out, client, prior="tv", iterations=4)
    with pytest.raises(InputError, match="masks"):
        pnp_sci.reconstruct(y, 1 - masks, out, client, **FAST)
    with pytest.raises(InputError, match="measurements 5 there, 4 now"):
        pnp_sci.reconstruct(y[:4], masks, out, client, **FAST)
    (tmp_path / "other").mkdir()
    with pytest.raises(FormatError, match="no result of pnp-sci reconstruct"):
        pnp_sci.reconstruct(y, masks, tmp_path / "other", client, **FAST)


def test_a_failure_stops_no_other_measurement(client, tmp_path):
    y, masks = capture(dtype=np.float32)
    whole, y[0, 3, 3] = y.copy(), np.nan
    out = tmp_path / "v.zarr"
    videos = pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert not videos.ok
    assert "1 failed" in videos.status
    assert "NaN" in videos.record(0)["error"]
    assert np.isnan(videos.video(0)).all()
    assert [row["ok"] for row in videos.table()] == [False, True, True, True, True]
    with pytest.raises(SolverError, match="1 failed"):
        videos.raise_for_status()
    assert pnp_sci.reconstruct(whole, masks, out, client, **FAST).ok  # it is tried again


def test_a_measurement_that_is_not_there_fails(client, tmp_path):
    """What a store without a chunk, or a file that was not written to the end, gives instead is 0."""
    y, masks = capture()
    y[3] = 0
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    assert [row["ok"] for row in videos.table()] == [True, True, True, False, True]
    assert "y is 0 everywhere" in videos.record(3)["error"]
    assert np.isnan(videos.video(3)).all()


@pytest.mark.parametrize(
    ("kind", "error"), [("0", "0 everywhere"), ("nan", r"NaN .* index \(3, 4\)"), ("file", "y1.npy cannot be read")]
)
def test_what_fails_ends_a_sequence(client, tmp_path, kind, error):
    """The others of its group, and the groups beside, are solved without it; later they are solved with it."""
    y, masks = capture(dtype=np.float32)
    whole, source = y.copy(), y
    if kind == "file":
        source = [tmp_path / f"y{n}.npy" for n in range(5)]
        for path, picture in zip(source, y):
            np.save(path, picture)
        source[1].write_bytes(b"damaged")
    else:
        y[1] = np.where(np.arange(576).reshape(24, 24) == 3 * 24 + 4, np.nan, y[1]) if kind == "nan" else 0
    for size, chunks in ((4, [((0, 1), [0]), ((2, 5), [2, 3]), ((3, 5), [4])]), (1, [((0, 1), [0]), ((2, 4), [2])])):
        out = tmp_path / f"{size}.zarr"
        videos = pnp_sci.reconstruct(source, masks, out, client, sequence=size, **FAST)
        assert [row["ok"] for row in videos.table()] == [True, False, True, True, True]
        assert re.search(error, videos.record(1)["error"])
        assert np.isnan(videos.video(1)).all()
        for seen, kept in chunks:
            together = pnp_sci.solve(whole[slice(*seen)], masks, sequence=True, **FAST)
            for n in kept:
                np.testing.assert_array_equal(videos.video(n), together.x[n - seen[0]])
    videos = pnp_sci.reconstruct(whole, masks, tmp_path / "1.zarr", client, sequence=1, **FAST)
    np.testing.assert_array_equal(videos.video(2), pnp_sci.solve(whole[1:4], masks, sequence=True, **FAST).x[1])


def test_what_is_given_for_each_measurement(client, process, tmp_path):
    """Bad pixels, masked values and first estimates: each measurement has its own."""
    y, masks = capture(dtype=np.float32)
    rng = np.random.default_rng(2)
    bad, init = rng.random(y.shape) < 0.1, 50 * rng.random((5, *masks.shape), np.float32)
    masked = np.ma.MaskedArray(y, bad)
    videos = pnp_sci.reconstruct(masked, masks, tmp_path / "m.zarr", process, **FAST)
    given = pnp_sci.reconstruct(y, masks, tmp_path / "b.zarr", process, bad=bad, init=init, **FAST)
    together = pnp_sci.reconstruct(y, masks, tmp_path / "s.zarr", client, bad=bad, init=init, sequence=2, **FAST)
    for n in range(5):
        alone = pnp_sci.solve(y[n], masks, bad=bad[n], **FAST)
        np.testing.assert_array_equal(videos.video(n), alone.x)
        np.testing.assert_array_equal(given.video(n), pnp_sci.solve(y[n], masks, bad=bad[n], init=init[n], **FAST).x)
    expected = pnp_sci.solve(y[1:5], masks, bad=bad[1:5], init=init[1:5], sequence=True, **FAST)
    np.testing.assert_array_equal(together.video(2), expected.x[1])
    masked[3, 5:9] = np.ma.masked
    videos = pnp_sci.reconstruct(masked, masks, tmp_path / "m.zarr", client, **FAST)
    np.testing.assert_array_equal(videos.video(3), pnp_sci.solve(masked[3], masks, **FAST).x)
    for name, wrong in (("bad", bad[1:]), ("init", init[1:])):
        with pytest.raises(InputError, match=rf"{name} has shape \(4, .*5"):
            pnp_sci.reconstruct(y, masks, tmp_path / "w.zarr", client, **{name: wrong})


def test_masks_among_the_measurements_are_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    y, masks = capture()
    (tmp_path / "caps").mkdir()
    np.save("caps/y.npy", y)
    np.save("caps/z.npy", masks[0])
    for words in (("--masks", "caps/z.npy"), ("--masks", "z.npy", "--bad", "caps/z.npy")):
        np.save("z.npy", masks[0])
        done = CliRunner().invoke(main, ["reconstruct", "caps", *words])
        assert done.exit_code == 2
        assert "caps/z.npy is in the folder of the measurements" in done.output
    assert not (tmp_path / "video.zarr").exists()


def test_warnings_and_remarks_are_recorded(client, tmp_path):
    y, masks = capture()
    videos = pnp_sci.reconstruct(y, np.roll(masks, 5, -1)[:, :, ::-1], tmp_path / "v.zarr", client, **FAST)
    alone = pnp_sci.solve(y[0], np.roll(masks, 5, -1)[:, :, ::-1], **FAST)
    assert videos.table()[0]["remarks"] == alone.scene["remarks"] != []
    assert videos.table()[0]["warnings"]


def test_a_preview_comes_first_and_leaves_no_trace(client, tmp_path, monkeypatch):
    from pnp_sci.fleet import store

    y, masks = capture()
    said, put = [], store.put_record
    monkeypatch.setattr(store, "put_record", lambda path, n, record: (said.append((n, record["method"])), put(path, n, record)))  # fmt: skip # noqa: E501
    pnp_sci.reconstruct(y, masks, tmp_path / "a.zarr", client, preview="wavelet", **FAST)
    methods = [method for _, method in said]
    assert methods == ["solve"] + ["wavelet"] * 4 + ["solve"] * 4
    pnp_sci.reconstruct(y, masks, tmp_path / "b.zarr", client, **FAST)
    assert files(tmp_path / "a.zarr") == files(tmp_path / "b.zarr")


def test_a_full_disk_is_noticed_after_the_first_chunk(client, tmp_path, monkeypatch, caplog):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
        with pytest.raises(InputError, match=r"out is .* 1\.0 kB left: \d+\.\d kB were"):
            pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert len(pnp_sci.Reconstruction(out).table()) == 1
    with caplog.at_level("INFO", "pnp_sci.fleet"):
        pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert "3 measurements on 2 workers" in caplog.text  # one was done, and one more is measured


def shifted(x, sigma):
    """A prior of the user's."""
    return 0.9 * x + 0.01


@dataclass(frozen=True)
class Mean:
    """Another one."""

    weight: float = 0.5

    def __call__(self, x, sigma):
        """Nearer to the mean."""
        return x + self.weight * (x.mean() - x)


def test_priors_of_ones_own_and_arrays_among_the_options(client, tmp_path):
    y, masks = capture()
    bad = np.zeros(y.shape[1:], bool)
    bad[3, 4] = True
    out = tmp_path / "v.zarr"
    for prior in (shifted, Mean(0.3)):
        options = {"prior": prior, "iterations": 3, "bad": bad, "noise": pnp_sci.Sensor(1.0, gain=0.5)}
        videos = pnp_sci.reconstruct(y, masks, out, client, **options)
        np.testing.assert_array_equal(videos.video(2), pnp_sci.solve(y[2], masks, **options).x)
        with pytest.raises(InputError, match="options bad"):
            pnp_sci.reconstruct(y, masks, out, client, **options | {"bad": ~bad})
        shutil.rmtree(out)


def test_predicted_errors_lie_beside_the_videos(client, tmp_path):
    y, masks = capture(2, size=48)
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, uncertainty=True, **FAST)
    alone = pnp_sci.solve(y[1], masks, uncertainty=True, **FAST)
    assert np.isfinite(alone.uncertainty).all()
    np.testing.assert_array_equal(videos.uncertainty[4:].swapaxes(0, 1), alone.uncertainty)


def test_a_sequence_is_solved_with_a_neighbour_on_either_side(client, tmp_path):
    y, masks = capture()
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, sequence=2, **FAST)
    for seen, kept in (((0, 3), (0, 1)), ((1, 5), (2, 3)), ((3, 5), (4,))):
        together = pnp_sci.solve(y[slice(*seen)], masks, sequence=True, **FAST)
        for n in kept:
            np.testing.assert_array_equal(videos.video(n), together.x[n - seen[0]])
            assert videos.record(n)["iterations"] == together.history[-1].iteration
    assert [videos.record(n)["y"] for n in range(5)] == [pnp_sci.solve(p, masks, **FAST).settings["y"] for p in y]


def test_arguments_are_checked_before_any_work(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    for error, match, options in (
        (InputError, "callback", {"callback": print}),
        (InputError, "reference", {"reference": y}),
        (InputError, "workers is 0", {"workers": 0}),
        (InputError, "no_such", {"prior": "no_such"}),
        (InputError, "preview is 'no_such': .*ofanet-fast.*wavelet", {"preview": "no_such"}),
        (InputError, "effort", {"effort": "great"}),
        (InputError, "bad has shape", {"bad": np.zeros((2, 2), bool)}),
        (InputError, "last two dimensions", {"masks": masks[..., 1:]}),
        (InputTypeError, "client is 3", {"client": 3}),
        (InputTypeError, "progress", {"progress": 1}),
    ):
        with pytest.raises(error, match=match):
            pnp_sci.reconstruct(y, **{"masks": masks, "out": out, "client": client} | options)
        assert not out.exists()
    with pytest.raises(FileNotFoundError):
        pnp_sci.reconstruct(y, masks, tmp_path / "no" / "v.zarr", client)


def test_there_is_only_json_and_arrays_of_numbers(client, tmp_path):
    y, masks = capture(2)
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, uncertainty=True, **FAST)
    arrays = dict(zarr.open_group(out, mode="r").arrays())
    assert {array.dtype.kind for array in arrays.values()} <= set("biuf")
    codecs = [codec["name"] for a in arrays.values() for codec in a.metadata.to_dict()["codecs"]]
    assert set(codecs) <= {"bytes", "zstd"}
    files = [file.relative_to(out) for file in out.rglob("*") if file.is_file()]
    for file in (file for file in files if file.parts[0] not in arrays or file.parts[1] != "c"):
        json.loads((out / file).read_text())
