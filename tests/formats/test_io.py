import contextlib
import gc
import os
import sys
import zlib
from pathlib import Path

import h5py
import imageio.v3
import numpy as np
import pytest
import scipy.io
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pnp_sci import io
from pnp_sci.errors import FormatError, InputError, InputTypeError

DTYPES = [bool, np.uint8, np.int16, np.uint16, np.int32, np.float32, np.float64]
EXACT = ["mat", "npy", "npz", "h5", "hdf5", "tif", "tiff"]
DATA = os.environ.get("PNP_SCI_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="set PNP_SCI_DATA to the folder with the benchmark files")


def sample(shape, dtype: type = np.float32, seed=0):
    values = 255 * np.random.default_rng(seed).random(shape)
    return values > 127 if dtype is bool else values.astype(dtype)


def smooth_frames(count=6, rows=48, columns=64):
    r, c, b = np.meshgrid(np.arange(rows), np.arange(columns), np.arange(count), indexing="ij")
    return np.moveaxis((0.5 + 0.4 * np.sin(r / 9 + b / 5) * np.cos(c / 11)), 2, 0)


def v73(path, **arrays):
    """A file as MATLAB's ``save -v7.3`` makes it: HDF5 behind a header of 512 bytes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, array in arrays.items():
            made = file.create_dataset(key, data=array.T.astype(np.uint8) if array.dtype == bool else array.T)
            made.attrs["MATLAB_class"] = np.bytes_("logical" if array.dtype == bool else str(array.dtype))
        file.create_group("#refs#").create_dataset("a", data=np.zeros((3, 3)))
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


# ---- round trips ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", EXACT)
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(9, 7), (3, 9, 7), (1, 9, 7), (2, 3, 9, 7), (2, 1, 9, 7), (1, 1, 9, 7)])
def test_round_trip_keeps_values_dtype_and_shape(tmp_path, suffix, dtype, shape):
    array = sample(shape, dtype)
    path = tmp_path / f"file.{suffix}"
    io.write(path, array)
    back = io.read(path)
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert np.array_equal(back, array)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", ["mat", "npz", "h5", "tif"])
@settings(max_examples=25, deadline=None)
@given(
    array=hnp.arrays(
        st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
        hnp.array_shapes(min_dims=2, max_dims=4, max_side=6),
    )
)
def test_any_array_round_trips(tmp_path_factory, suffix, array):
    path = tmp_path_factory.mktemp("any") / f"file.{suffix}"
    io.write(path, array)
    back = io.read(path)
    assert back.dtype == array.dtype
    np.testing.assert_array_equal(back, array)


@pytest.mark.parametrize("suffix", ["mat", "npz", "h5"])
def test_a_scene_in_one_file(tmp_path, suffix):
    scene = {"y": sample((20, 30)), "masks": sample((2, 4, 20, 30), bool), "x": sample((2, 4, 20, 30))}
    path = tmp_path / f"scene.{suffix}"
    io.write(path, scene)
    assert np.array_equal(io.read_measurement(path), scene["y"])
    assert np.array_equal(io.read_masks(path), scene["masks"])
    assert np.array_equal(io.read_video(path), scene["x"])
    assert {entry.key for entry in io.describe(path)} == set(scene)


@pytest.mark.parametrize("suffix", ["avi", "gif"])
@pytest.mark.parametrize(("rows", "columns"), [(48, 64), (33, 47)])
def test_avi_and_gif_keep_eight_bits_exactly(tmp_path, suffix, rows, columns):
    frames = sample((5, rows, columns), np.uint8)
    frames[3] = frames[2]  # equal frames must not be merged
    path = tmp_path / f"video.{suffix}"
    io.write_video(path, frames, fps=30)
    assert np.array_equal(io.read(path), frames)


@pytest.mark.parametrize(("rows", "columns"), [(48, 64), (33, 47)])
def test_mp4_is_close_and_of_even_size(tmp_path, rows, columns):
    """QuickTime and Firefox play no other H.264; a last row or column is repeated."""
    frames = smooth_frames(6, rows, columns)
    io.write_video(tmp_path / "video.mp4", frames)
    back = io.read_video(tmp_path / "video.mp4")
    assert back.dtype == np.uint8
    assert back.shape == (1, 6, rows + rows % 2, columns + columns % 2)
    assert np.abs(back[0, :, :rows, :columns] / 255 - frames).mean() < 0.01


def test_png_folder_and_single_pngs(tmp_path):
    frames = sample((12, 9, 7), np.uint16)
    io.write(tmp_path / "frames", frames)
    assert np.array_equal(io.read(tmp_path / "frames"), frames)
    io.write(tmp_path / "y.png", frames[0])
    assert np.array_equal(io.read_measurement(tmp_path / "y.png"), frames[0])


def test_png_folder_is_in_the_order_of_its_numbers(tmp_path):
    for number in (10, 9, 1):
        imageio.v3.imwrite(tmp_path / f"f{number}.png", np.full((4, 5), number, np.uint8))
    assert io.read(tmp_path)[:, 0, 0].tolist() == [1, 9, 10]


def test_floats_are_clipped_for_eight_bits(tmp_path):
    io.write(tmp_path / "a.png", np.array([[-1.0, 0.0, 0.5], [1.0, 2.0, np.nan]]))
    assert io.read(tmp_path / "a.png").tolist() == [[0, 0, 128], [255, 255, 0]]


def test_imagej_order(tmp_path):
    """ImageJ sees the views as channels and the frames as time."""
    array = sample((2, 3, 9, 7))
    io.write(tmp_path / "a.tif", array)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.series[0].axes == "TCYX"
        assert file.series[0].shape == (3, 2, 9, 7)
    stack = sample((4, 9, 7), np.uint16)
    tifffile.imwrite(tmp_path / "b.tif", stack, imagej=True, metadata={"axes": "ZYX"})
    assert np.array_equal(io.read(tmp_path / "b.tif"), stack)
    tifffile.imwrite(tmp_path / "c.tif", stack, imagej=True)  # of unsaid axes, which tifffile calls channels
    assert np.array_equal(io.read(tmp_path / "c.tif"), stack)


def test_tiff_pages_written_one_by_one_are_a_stack(tmp_path):
    stack = sample((4, 9, 7), np.uint16)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for page in stack:
            file.write(page)
    assert np.array_equal(io.read(tmp_path / "a.tif"), stack)
    with tifffile.TiffWriter(tmp_path / "b.tif") as file:
        file.write(stack[0])
        file.write(stack[1, :5])
    with pytest.raises(FormatError, match=r"series0.*series1"):
        io.read(tmp_path / "b.tif")


def test_videos_of_several_measurements(tmp_path):
    x = sample((3, 2, 4, 9, 7))
    io.write(tmp_path / "a.npz", {"x": x})
    assert np.array_equal(io.read_video(tmp_path / "a.npz"), x)
    assert np.array_equal(io.read_video(tmp_path / "a.npz", 2), x)
    with pytest.raises(FormatError, match="planes for 3 views"):
        io.read_video(tmp_path / "a.npz", 3)
    assert np.array_equal(io.read_masks(tmp_path / "a.npz", key="x"), x)
    with pytest.raises(FormatError, match="planes for 3 views"):
        io.read_masks(tmp_path / "a.npz", 3, key="x")


# ---- layouts --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("save", [lambda path, **a: scipy.io.savemat(path, a), v73], ids=["v5", "v7.3"])
def test_mat_planes_last(tmp_path, save):
    masks, video, meas = sample((8, 9, 6), bool), sample((8, 9, 24), np.uint8), sample((8, 9, 4))
    save(tmp_path / "a.mat", mask=masks, orig=video, meas=meas)
    read_masks = io.read_masks(tmp_path / "a.mat", views=2)
    assert np.array_equal(read_masks, np.moveaxis(masks, 2, 0).reshape(2, 3, 8, 9))
    assert read_masks.dtype == bool
    assert np.array_equal(io.read_video(tmp_path / "a.mat"), np.moveaxis(video, 2, 0)[None])
    assert np.array_equal(io.read_measurement(tmp_path / "a.mat"), np.moveaxis(meas, 2, 0))
    save(tmp_path / "b.mat", x=sample((8, 9, 3, 2)))
    assert io.read_video(tmp_path / "b.mat").shape == (2, 3, 8, 9)


@pytest.mark.parametrize(("key", "read"), [("simu_mask", io.read_masks), ("patch_save", io.read_video)])
def test_dual_view_layouts_have_two_views(tmp_path, key, read):
    planes = sample((8, 8, 20), np.uint8)
    scipy.io.savemat(tmp_path / "a.mat", {key: planes})
    views = read(tmp_path / "a.mat")
    assert np.array_equal(views[1, 0], planes[:, :, 10])
    assert read(tmp_path / "a.mat", views=1).shape == (1, 20, 8, 8)


def test_pic_has_planes_first(tmp_path):
    pic = sample((14, 32, 32))
    scipy.io.savemat(tmp_path / "a.mat", {"pic": pic})
    assert np.array_equal(io.read_video(tmp_path / "a.mat")[0], pic)


def test_square_frames_on_the_wrong_axes_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", sample((16, 16, 8)))
    np.save(tmp_path / "b.npy", sample((16, 16, 8, 2)))
    scipy.io.savemat(tmp_path / "c.mat", {"mask": sample((8, 16, 16))})
    for name in ("a.npy", "b.npy", "c.mat"):
        with pytest.raises(FormatError, match=rf"{name}.*square frames.*pnp_sci\.io\.read reads it"):
            io.read_masks(tmp_path / name)
        assert io.read(tmp_path / name).ndim > 2


@pytest.mark.parametrize("suffix", ["npy", "npz", "mat", "h5", "tif"])
@pytest.mark.parametrize("shape", [(64, 64, 48), (64, 48, 64), (48, 64, 64)])
def test_as_many_measurements_as_rows_or_columns(tmp_path, suffix, shape):
    array = sample(shape, np.uint8)
    io.write(tmp_path / f"a.{suffix}", array)
    assert np.array_equal(io.read_measurement(tmp_path / f"a.{suffix}"), array)


def test_as_many_colour_frames_as_rows(tmp_path):
    array = sample((8, 8, 6, 3), np.uint8)
    io.write(tmp_path / "a.npy", array)
    assert np.array_equal(io.read_video(tmp_path / "a.npy", colour=True)[0], array)


@pytest.mark.parametrize("suffix", ["NPY", "NPZ", "MAT", "H5", "TIF", "PNG"])
def test_suffixes_in_capitals(tmp_path, suffix):
    array = sample((9, 7), np.uint8)
    io.write(tmp_path / f"a.{suffix}", array)
    assert os.listdir(tmp_path) == [f"a.{suffix}"]
    assert np.array_equal(io.read(tmp_path / f"a.{suffix}"), array)


@pytest.mark.parametrize("suffix", ["npy", "npz", "h5", "mat"])
def test_complex_numbers_are_real_or_left_out(tmp_path, suffix, caplog):
    """Imaginary parts that rounding leaves are dropped in every format."""
    real = sample((8, 9), np.float64)
    for rounding in (1e-12, 1.0):
        content = real * (1 + 1j * rounding)
        path = tmp_path / f"a.{suffix}"
        if suffix == "npy":
            np.save(path, content)
        elif suffix == "npz":
            np.savez(path, y=content)
        elif suffix == "h5":
            with h5py.File(path, "w") as file:
                file["y"] = content
        else:
            scipy.io.savemat(path, {"y": content})
        if rounding < 1:
            assert np.array_equal(io.read_measurement(path), real)
            assert not caplog.text
    with pytest.raises(FormatError, match="no measurement was recognised"):
        io.read_measurement(path)
    assert "is complex" in caplog.text


def test_views_must_share_the_planes(tmp_path):
    np.save(tmp_path / "a.npy", sample((7, 9, 8)))
    with pytest.raises(FormatError, match=r"\(7, 9, 8\).*2 views"):
        io.read_masks(tmp_path / "a.npy", views=2)
    with pytest.raises(InputError, match="views is 0"):
        io.read_masks(tmp_path / "a.npy", views=0)
    np.save(tmp_path / "b.npy", sample((2, 3, 9, 8)))
    with pytest.raises(FormatError, match="3 views"):
        io.read_video(tmp_path / "b.npy", views=3)


def test_what_cannot_be_told_names_what_is_there(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, first=sample((4, 5)), second=sample((3, 4, 5)))
    for read in (io.read, io.read_measurement, io.read_masks, io.read_video):
        with pytest.raises(FormatError, match=r"a\.npz.*first \(4, 5\), second \(3, 4, 5\)"):
            read(path)
    assert io.read_measurement(path, key="first").shape == (4, 5)
    with pytest.raises(FormatError, match="'third' is not in the file"):
        io.read(path, "third")
    np.savez(tmp_path / "b.npz", second=sample((2, 3, 4, 5)))
    with pytest.raises(FormatError, match="second has shape"):
        io.read_measurement(tmp_path / "b.npz")


def test_an_array_of_another_kind_is_not_taken(tmp_path):
    np.savez(tmp_path / "a.npz", masks=sample((3, 4, 5)))
    with pytest.raises(FormatError, match="no video was recognised"):
        io.read_video(tmp_path / "a.npz")


def test_two_names_of_one_kind_are_ambiguous(tmp_path):
    np.savez(tmp_path / "a.npz", y=sample((4, 5)), meas=sample((4, 5)))
    with pytest.raises(FormatError, match="meas and y could each be the measurement"):
        io.read_measurement(tmp_path / "a.npz")


def test_describe_says_what_it_looks_like(tmp_path):
    arrays = {"meas": sample((5, 8, 9)), "masks": sample((2, 5, 8, 9), bool), "history": np.arange(3.0)}
    io.write(tmp_path / "a.npz", arrays)
    entries = {entry.key: entry for entry in io.describe(tmp_path / "a.npz")}
    assert entries["meas"][1:] == ((5, 8, 9), "float32", "5 measurements of 8 x 9")
    assert entries["masks"].meaning == "masks: 2 views x 5 frames of 8 x 9"
    assert entries["history"].meaning == "not a picture"


# ---- what goes wrong ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [*EXACT, "png", "mp4", "avi", "gif"])
@pytest.mark.parametrize("damage", [0, 0.3, 0.8, "noise"])
def test_damaged_files_are_named(tmp_path, suffix, damage):
    path = tmp_path / f"file.{suffix}"
    io.write(path, sample((32, 24) if suffix == "png" else (6, 32, 24), np.uint8))
    whole = path.read_bytes()
    path.write_bytes(np.random.default_rng(0).bytes(4000) if damage == "noise" else whole[: int(damage * len(whole))])
    with pytest.raises(FormatError, match=path.name):
        io.read(path)


@pytest.mark.parametrize("suffix", [*EXACT, "avi", "gif"])
def test_a_truncated_file_is_never_half_read(tmp_path, suffix):
    """Wherever a file is cut, either FormatError or all of it (what is lost was no more than an index or a trailer)."""
    array = sample((6, 32, 24), np.uint8)
    path = tmp_path / f"file.{suffix}"
    io.write(path, array)
    whole = path.read_bytes()
    for length in np.linspace(0.5, 0.999, 8) * len(whole):
        path.write_bytes(whole[: int(length)])
        with contextlib.suppress(FormatError):
            assert np.array_equal(io.read(path), array)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", [0, 8, 14, 88, 255])
def test_a_type_that_mat_files_do_not_have(tmp_path, kind, compressed):
    """SciPy looks it up beyond the end of a table: the process would crash."""
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"y": sample((8, 9), np.float32)})
    content = bytearray(path.read_bytes())
    assert content[176] == 7  # of the numbers: single
    content[176] = kind
    if compressed:
        packed = zlib.compress(content[128:])
        content[128:] = np.array([15, len(packed)], "<u4").tobytes() + packed
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.mat cannot be read, it may be damaged"):
        io.read(path)


def test_an_imaginary_part_that_is_not_there(tmp_path):
    """SciPy takes the next array for it, and crashes."""
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"y": sample((8, 9), np.float32), "z": sample((8, 9), np.float32)})
    content = bytearray(path.read_bytes())
    content[145] = 8
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.mat cannot be read, it may be damaged"):
        io.read(path)


def test_a_cell_array_too_large_for_its_file(tmp_path):
    """SciPy makes room for all cells first, here for 1.5 GB, in a process of its own."""
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"c": np.array([[1, "a"]], object)})
    content = bytearray(path.read_bytes())
    assert content[160:168] == bytes([1, 0, 0, 0, 2, 0, 0, 0])  # rows and columns
    content[167] = 11
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.mat cannot be read, it may be damaged"):
        io.read(path)


def test_names_that_are_no_text(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset(b"\xff", data=sample((4, 5)))
        file.create_dataset(b"\xfe", data=sample((4, 5)))
    with pytest.raises(FormatError, match=r"name the .* by key="):
        io.read(tmp_path / "a.h5")
    assert len(io.describe(tmp_path / "a.h5")) == 2


@pytest.mark.parametrize("target", [8, 300, 10**6])
def test_tiff_pages_that_have_no_end(tmp_path, target):
    """The last page points to the first, into some data, or out of the file: tifffile would read on for ever."""
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as file:
        for frame in sample((3, 9, 7)):
            file.write(frame, metadata=None)
    with tifffile.TiffFile(path) as file:
        end = file.pages.next_page_offset
    content = bytearray(path.read_bytes())
    content[end : end + 4] = target.to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(FormatError, match="last page"):
        io.read(path)


def test_a_tiff_page_without_all_its_parts(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, sample((64, 32)), rowsperstrip=16)
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[0].tags["StripOffsets"].overwrite(file.pages[0].dataoffsets[:2])
    with pytest.raises(FormatError, match="2 parts"):
        io.read(path)


@pytest.mark.parametrize("key", [3, ["y"], np.ones(3)])
def test_keys_and_views_of_other_types(tmp_path, key):
    io.write(tmp_path / "a.npz", {"masks": sample((2, 3, 4, 5))})
    with pytest.raises(FormatError, match="is not in the file"):
        io.read(tmp_path / "a.npz", key)
    with pytest.raises(InputError, match="views is"):
        io.read_masks(tmp_path / "a.npz", views=[key])


@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_pickles_are_never_loaded(tmp_path, suffix):
    path = tmp_path / f"evil.{suffix}"
    (np.save if suffix == "npy" else np.savez)(path, np.array([{"a": 1}, None], object))
    with pytest.raises(FormatError, match=r"hold Python objects|no numeric array"):
        io.read(path)


def test_missing_and_unknown_files(tmp_path):
    for read in (io.read, io.read_measurement, io.read_masks, io.read_video, io.describe):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.mat"):
            read(tmp_path / "nowhere.mat")
    (tmp_path / "a.doc").touch()
    with pytest.raises(FormatError, match=r"cannot read \.doc"):
        io.read(tmp_path / "a.doc")
    with pytest.raises(FormatError, match="no pictures"):
        io.read(tmp_path)
    scipy.io.savemat(tmp_path / "text.mat", {"name": "words"})
    with pytest.raises(FormatError, match="no numeric array"):
        io.read(tmp_path / "text.mat")


def test_colour_is_refused(tmp_path):
    colour = sample((8, 9, 3), np.uint8)
    imageio.v3.imwrite(tmp_path / "a.png", colour)
    tifffile.imwrite(tmp_path / "a.tif", colour, photometric="rgb")
    for name in ("a.png", "a.tif"):
        with pytest.raises(FormatError, match=f"{name}.*colour"):
            io.read(tmp_path / name)
    imageio.v3.imwrite(tmp_path / "grey.png", np.repeat(colour[..., :1], 3, 2))
    assert np.array_equal(io.read(tmp_path / "grey.png"), colour[..., 0])


@pytest.mark.parametrize("suffix", [".mat", ".npy", ".npz", ".h5", ".tif", ".png", ".avi", ".mp4", ""])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError("no space left on device")])
def test_an_interrupted_write_leaves_nothing_behind(tmp_path, monkeypatch, suffix, stop):
    array = sample((32, 24) if suffix == ".png" else (3, 32, 24), np.uint8)
    path = tmp_path / f"file{suffix}"
    if suffix:
        path.write_bytes(b"what was there before")

    def interrupted(*_):
        raise stop

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(BaseException, match="no space" if isinstance(stop, OSError) else None):
        io.write(path, array)
    assert os.listdir(tmp_path) == ([path.name] if suffix else [])
    assert not suffix or path.read_bytes() == b"what was there before"


def test_a_failed_write_leaves_nothing_behind(tmp_path):
    bad: list[tuple[str, object, type[Exception]]] = [
        ("a.npy", np.array(["text"]), InputTypeError),
        ("a.npz", {"x": np.ones(3, complex)}, InputTypeError),
        ("a.mat", np.ones((3, 3), np.float16), InputTypeError),
        ("a.png", np.ones((2, 3, 3)), InputError),
        ("a.png", np.ones((3, 3), np.int32), InputTypeError),
        ("a.mp4", np.ones((3, 3)), InputError),
        ("a.npy", {"x": np.ones((3, 3))}, InputError),
        ("a.doc", np.ones((3, 3)), FormatError),
        ("folder", np.ones((3, 3)), InputError),
    ]
    for name, array, error in bad:
        with pytest.raises(error):
            io.write(tmp_path / name, array)
        assert os.listdir(tmp_path) == []
    with pytest.raises(FormatError, match=r"/run\.1: cannot write \.1"):  # not the name of a temporary file
        io.write(tmp_path / "run.1", np.ones((2, 4, 4)))
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        io.write(tmp_path / "no" / "a.npy", np.ones(3))


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_a_number_beside_an_array_is_kept(tmp_path, suffix):
    io.write(tmp_path / f"a.{suffix}", {"y": np.ones((4, 4)), "fps": 5.0})
    assert io.read(tmp_path / f"a.{suffix}", key="fps").item() == 5


@pytest.mark.parametrize("suffix", [*EXACT, "png", "avi", "mp4", "gif", ""])
@pytest.mark.parametrize("shape", [(), (0,), (0, 4, 4), (2, 0, 4)])
def test_an_array_without_values_or_axes_is_refused_by_its_shape(tmp_path, suffix, shape):
    array = np.zeros(shape)
    path = tmp_path / f"a.{suffix}".rstrip(".")
    with pytest.raises(InputError, match=rf"array has shape \({', '.join(map(str, shape))},?\)"):
        io.write(path, array)
    if suffix in ("mat", "npz", "h5", "hdf5"):
        if array.ndim:
            with pytest.raises(InputError, match="dark has shape"):
                io.write(path, {"y": np.ones((4, 4)), "dark": array})
        with pytest.raises(InputError, match="without arrays"):
            io.write(path, {})
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("suffix", [*EXACT, "png", "gif", ""])
@pytest.mark.filterwarnings("error")
def test_reading_leaves_no_file_open(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}".rstrip(".")
    io.write(path, sample((16, 16) if suffix == "png" else (3, 16, 16), np.uint8))
    unraisable = []
    hook, sys.unraisablehook = sys.unraisablehook, unraisable.append
    try:
        io.read(path)
        gc.collect()
    finally:
        sys.unraisablehook = hook
    assert not unraisable


def test_a_full_folder_is_not_replaced(tmp_path):
    io.write(tmp_path / "frames", np.ones((2, 4, 4)))
    with pytest.raises(FileExistsError, match="not empty"):
        io.write(tmp_path / "frames", np.zeros((2, 4, 4)))
    assert io.read(tmp_path / "frames").all()


def test_write_video_refuses(tmp_path):
    with pytest.raises(FormatError, match=r"cannot write a video as \.npy"):
        io.write_video(tmp_path / "a.npy", np.ones((2, 4, 4)))
    with pytest.raises(InputError, match="fps is 0"):
        io.write_video(tmp_path / "a.mp4", np.ones((2, 4, 4)), fps=0)


@needs_data
def test_describe_knows_the_files_of_the_field():
    folder = Path(str(DATA))
    meanings = {
        "dualview/256_simu_mask10.mat": {"masks: 2 views x 10 frames of 256 x 256"},
        "dualview/gt/bear_blackswan.mat": {"video: 2 views x 10 frames of 256 x 256"},
        "dualview/meas/bear_blackswan.mat": {"measurement: 256 x 256"},
        "real/6fan14_cacti.mat": {"masks: 14 planes of 256 x 256", "measurement: 256 x 256"},
        "real/BIRNAT_wheel.mat": {"video: 14 planes of 256 x 256"},
    }
    for name, expected in meanings.items():
        assert {entry.meaning for entry in io.describe(folder / name)} == expected
