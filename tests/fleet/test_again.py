"""A second call with the same folder: what is done again, what is refused, and that nothing old stays."""

import numpy as np
import pytest
from small import FAST, capture, files

import pnp_sci
from pnp_sci import Result, io
from pnp_sci.errors import FormatError, InputError
from pnp_sci.fleet import store

pytest.importorskip("distributed")
pytest.importorskip("zarr")


def times(out):
    return [(out / "records" / f"{n:07d}.json").stat().st_mtime_ns for n in range(5)]


def test_a_result_is_neither_replaced_nor_opened_as_one_video(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    before = {f: f.read_bytes() for f in out.rglob("*") if f.is_file()}
    alone = pnp_sci.solve(y[0], masks, **FAST)
    with pytest.raises(FileExistsError, match="remove it first"):
        alone.save(out)
    assert {f: f.read_bytes() for f in out.rglob("*") if f.is_file()} == before
    with pytest.raises(FormatError, match=r"pnp_sci\.Reconstruction opens"):
        Result.load(out)
    alone.save(tmp_path / "alone.zarr")
    with pytest.raises(FormatError, match="no result of pnp-sci reconstruct"):
        pnp_sci.reconstruct(y, masks, tmp_path / "alone.zarr", client, **FAST)


@pytest.mark.parametrize(
    ("first", "then"),
    [
        ({}, {"bad": None}),
        ({"tol": 0}, {"tol": 0.0}),
        ({"noise": 1.0}, {"noise": 1}),
        ({"sigma": None}, {}),
        ({"algorithm": "gap", "seed": 0, "init": "auto"}, {}),
        ({}, {"register": False, "progress": True}),
    ],
)
def test_equal_options_in_other_words_are_the_same(client, tmp_path, first, then):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, **FAST, **first)
    before = times(out)
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST, **then).ok
    assert times(out) == before


def test_defaults_and_masks_of_another_dtype_are_the_same(client, tmp_path):
    """And the videos are, to the last bit."""
    y, masks = capture()
    out = tmp_path / "v.zarr"
    videos = pnp_sci.reconstruct(y, masks.astype(bool), out, client, iterations=3)
    before = times(out)
    for dtype in (np.float32, np.float64, np.uint8):
        videos = pnp_sci.reconstruct(y, masks.astype(dtype), out, client, prior="tv", iterations=3)
        np.testing.assert_array_equal(videos.video(1), pnp_sci.solve(y[1], masks.astype(dtype), **FAST).x)
    assert times(out) == before


def test_two_runs_do_not_write_to_one_folder(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    with store.only_run(out), pytest.raises(InputError, match=r"v\.zarr, where another run is writing"):
        pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert not out.exists()
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST).ok


def test_masks_of_the_same_bytes_are_other_masks(client, tmp_path):
    y, masks = capture(frames=4)
    pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    with pytest.raises(InputError, match=r"size \[1, 4, 24, 24\] there, \[2, 2, 24, 24\] now"):
        pnp_sci.reconstruct(y, masks.reshape(2, 2, 24, 24), tmp_path / "v.zarr", client, **FAST)


def test_a_changed_neighbour_changes_a_sequence(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, sequence=2, **FAST)
    before = times(out)
    y[2] += 9
    videos = pnp_sci.reconstruct(y, masks, out, client, sequence=2, **FAST)
    assert [a != b for a, b in zip(times(out), before)] == [True, True, True, True, False]
    together = pnp_sci.solve(y[:3], masks, sequence=True, **FAST)
    np.testing.assert_array_equal(videos.video(1), together.x[1])
    before = times(out)
    assert pnp_sci.reconstruct(y, masks, out, client, sequence=2, **FAST).ok
    assert times(out) == before


def test_a_file_that_was_written_anew_is_solved_anew(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    io.write(tmp_path / "y.npz", {"y": y})
    pnp_sci.reconstruct(tmp_path / "y.npz", masks, out, client, **FAST)
    y[3] += 7
    io.write(tmp_path / "y.npz", {"y": y})
    videos = pnp_sci.reconstruct(tmp_path / "y.npz", masks, out, client, **FAST)
    np.testing.assert_array_equal(videos.video(3), pnp_sci.solve(y[3], masks, **FAST).x)


@pytest.mark.parametrize("options", [{}, {"uncertainty": True}, {"preview": "wavelet"}])
def test_what_failed_has_no_video(client, tmp_path, options):
    """Neither that of earlier measurements nor a preview; the others stay."""
    y, masks = capture(size=48, dtype=np.float32)
    out = tmp_path / "v.zarr"
    videos = pnp_sci.reconstruct(y, masks, out, client, **FAST, **options)
    assert videos.uncertainty is None or np.isfinite(videos.uncertainty[:]).all()
    before = files(out)
    y[2, 3, 3] = np.inf
    videos = pnp_sci.reconstruct(y, masks, out, client, **FAST, **options)
    assert not videos.ok
    assert np.isnan(videos.video(2)).all()
    assert videos.uncertainty is None or np.isnan(videos.uncertainty[8:12]).all()
    assert files(out) == {name: content for name, content in before.items() if not name.startswith("0/c/2/")}


def test_no_record_outlives_the_video_it_describes(client, tmp_path, monkeypatch):
    """While a video is written over, there is no record of it."""
    y, masks = capture()
    out, put, seen = tmp_path / "v.zarr", store.put_videos, []
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    y[1] += 5

    def watched(path, start, *others):
        seen.append(store.record(path, start))
        put(path, start, *others)

    monkeypatch.setattr(store, "put_videos", watched)
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST).ok
    assert seen == [None]


def test_a_preview_has_no_errors_of_an_earlier_video(client, tmp_path, monkeypatch):
    y, masks = capture(size=48)
    out, put, seen = tmp_path / "v.zarr", store.put_record, []
    options = {"uncertainty": True, "preview": "wavelet"}
    videos = pnp_sci.reconstruct(y, masks, out, client, **FAST, **options)
    assert np.isfinite(videos.uncertainty[:]).all()
    y[1:3] += 5

    def watched(path, n, record):
        put(path, n, record)
        if record["method"] == "wavelet":
            seen.append(np.isnan(pnp_sci.Reconstruction(out).uncertainty[4 * n : 4 * n + 4]).all())

    monkeypatch.setattr(store, "put_record", watched)
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST, **options).ok
    assert seen == [True]


def test_what_a_kill_left_is_swept(client, tmp_path):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    before = {f for f in out.rglob("*") if f.is_file()}
    for name in (".1a2b", "records/.1a2b", "0/c/1/0/0/0.1a2b.partial"):
        (out / name).write_bytes(b"half")
    pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert {f for f in out.rglob("*") if f.is_file()} == before
