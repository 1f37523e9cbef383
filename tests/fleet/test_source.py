"""What may be a source, and that only what is asked for is read."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small import capture

from pnp_sci import io
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.fleet.source import open_source

Y = capture()[0]


def as_npy(folder):
    np.save(folder / "y.npy", Y)
    return folder / "y.npy"


def as_memmap(folder):
    return np.load(as_npy(folder), mmap_mode="r")


def as_hdf5(folder):
    pytest.importorskip("h5py")
    io.write(folder / "y.h5", {"meas": Y, "masks": Y[:2]})
    return folder / "y.h5"


def as_dataset(folder):
    h5py = pytest.importorskip("h5py")
    return h5py.File(as_hdf5(folder), "r")["meas"]


def as_zarr(folder):
    zarr = pytest.importorskip("zarr")
    zarr.save_array(folder / "y.zarr", Y)
    return folder / "y.zarr"


def as_zarr_group(folder):
    zarr = pytest.importorskip("zarr")
    zarr.create_group(folder / "g.zarr").create_array("raw/y", data=Y)
    return folder / "g.zarr"


def as_zarr_array(folder):
    return pytest.importorskip("zarr").open_array(as_zarr(folder))


def as_stack(folder):
    io.write(folder / "y.tif", Y)
    return folder / "y.tif"


def as_packed_stack(folder):
    pytest.importorskip("tifffile").imwrite(folder / "y.tif", Y, compression="zlib")
    return folder / "y.tif"


def as_pages(folder):
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffWriter(folder / "y.tif") as file:
        for picture in Y:
            file.write(picture)
    return folder / "y.tif"


def as_folder(folder):
    for n, picture in enumerate(Y):
        io.write(folder / f"picture_{n + 8}.png", picture)  # 9 comes before 10
    return folder


def as_files(folder):
    np.save(folder / "first.npy", Y[:2])
    io.write(folder / "then.tif", Y[2:4])
    io.write(folder / "last.npz", {"y": Y[4]})
    return [folder / "first.npy", str(folder / "then.tif"), folder / "last.npz"]


def as_array(folder):
    return Y


SOURCES = [
    as_npy, as_memmap, as_hdf5, as_dataset, as_zarr, as_zarr_group, as_zarr_array, as_stack, as_packed_stack, as_pages,
    as_folder, as_files, as_array,
]  # fmt: skip


@pytest.mark.parametrize("made", SOURCES)
def test_any_part_of_any_source(made, tmp_path):
    source = open_source(made(tmp_path))
    assert (source.count, source.shape, source.dtype) == (len(Y), Y.shape[1:], Y.dtype)
    for start, stop in ((0, 5), (1, 4), (2, 3), (4, 5)):
        np.testing.assert_array_equal(source.read(start, stop), Y[start:stop])
    assert source.travels == (made is not as_array)


@pytest.mark.parametrize("shape", [Y.shape, Y.shape[1:]])
def test_masked_values_stay_masked(shape):
    array = np.ma.MaskedArray(
        Y.ravel()[: np.prod(shape)].reshape(shape), np.arange(np.prod(shape)).reshape(shape) % 7 < 1
    )
    read = open_source(array).read(0, 1)
    np.testing.assert_array_equal(read.mask, array.mask.reshape(-1, *shape[-2:])[:1])


def test_one_picture_is_one_measurement(tmp_path):
    io.write(tmp_path / "one.png", Y[0])
    for source in (Y[0], tmp_path / "one.png"):
        np.testing.assert_array_equal(open_source(source).read(0, 1), Y[:1])


@pytest.mark.parametrize(
    "seen",
    [
        lambda m: m[1:3], lambda m: m[::-1], lambda m: m[:, ::-1], lambda m: m[:, :, ::-1], lambda m: m[:, :4],
        lambda m: m.swapaxes(1, 2), lambda m: m[::2], lambda m: m[2], lambda m: m.view(np.int16), lambda m: m + 1,
        lambda m: m.copy(), lambda m: m[:],
    ],
)  # fmt: skip
def test_what_is_seen_of_a_mapped_file_is_read(tmp_path, seen):
    """The values of the array that was given, not those of the file that it is a part of."""
    array = seen(as_memmap(tmp_path))
    expected = np.array(array if array.ndim == 3 else array[None])
    source = open_source(array)
    np.testing.assert_array_equal(source.read(0, source.count), expected)
    assert source.dtype == expected.dtype


def test_changes_of_a_copy_on_write_are_read(tmp_path):
    array = np.load(as_npy(tmp_path), mmap_mode="c")
    array[1] = 7
    assert (open_source(array).read(1, 2) == 7).all()


@pytest.mark.parametrize("name", ["y.npz", "y.npy", "y.tif", "y.mat", "y.h5", "y.png"])
def test_a_file_that_is_written_anew_is_read_anew(tmp_path, name):
    """By the source that was opened before, and by another one; also within a folder."""
    whole = Y[:1] if name.endswith("png") else Y
    other = whole[:, ::-1].copy()
    for given in (tmp_path / name, tmp_path, [tmp_path / name]):
        for array in (whole, other):
            io.write(tmp_path / name, array[0] if name.endswith("png") else array)
            if array is whole:
                source = open_source(given)
            for opened in (source, open_source(given)):
                np.testing.assert_array_equal(opened.read(0, 1), array[:1])


@pytest.mark.parametrize("made", [as_pages, as_packed_stack, as_stack])
@pytest.mark.parametrize("in_folder", [False, True])
def test_reading_a_page_looks_at_no_others(tmp_path, monkeypatch, made, in_folder):
    tifffile = pytest.importorskip("tifffile")
    path = made(tmp_path)
    source, looked = open_source(tmp_path if in_folder else path), []
    source.read(0, 1)
    for kind in ("TiffPage", "TiffFrame"):

        class Counted(getattr(tifffile, kind)):
            def __init__(self, *arguments, **options):
                looked.append(1)
                super().__init__(*arguments, **options)

        monkeypatch.setattr(tifffile.tifffile, kind, Counted)
    np.testing.assert_array_equal(source.read(3, 4), Y[3:4])
    assert len(looked) <= 2  # the first, and that one


def test_colours_are_no_measurements(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    pixels, planes = np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 3, 8, 8), np.uint8)
    in_planes = {"planarconfig": "separate"}
    for x, options in ((pixels, {}), (pixels, {"compression": "zlib"}), (planes, in_planes), (planes[0], in_planes)):
        tifffile.imwrite(tmp_path / "y.tif", x, photometric="rgb", **options)
        with pytest.raises(FormatError, match="grey pictures"):
            open_source(tmp_path / "y.tif")


def test_a_folder_holds_files_of_known_formats(tmp_path, caplog):
    as_folder(tmp_path)
    for name in ("notes.txt", "Thumbs.db", "y.PNG.bak", "README"):
        (tmp_path / name).write_bytes(b"no picture")
    source = open_source(tmp_path)
    np.testing.assert_array_equal(source.read(0, 5), Y)
    assert "README, Thumbs.db, notes.txt, y.PNG.bak" in caplog.text
    for file in tmp_path.glob("*.png"):
        file.unlink()
    with pytest.raises(FormatError, match=r"no files of these kinds: .*\.zarr"):
        open_source(tmp_path)


def test_a_relative_folder_is_found_from_elsewhere(tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr")
    as_zarr_group(tmp_path)
    monkeypatch.chdir(tmp_path)
    sources = [
        open_source("g.zarr"),
        open_source(zarr.open_array("g.zarr/raw/y")),
        open_source(zarr.open("g.zarr")["raw/y"]),
    ]
    monkeypatch.chdir(os.sep)
    for source in sources:
        assert source.travels
        np.testing.assert_array_equal(source.read(1, 3), Y[1:3])


def test_hdf5_that_is_being_written_is_named(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = as_hdf5(tmp_path)
    with h5py.File(path, "r+"):
        code = f"from pnp_sci.fleet.source import open_source; open_source({str(path)!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert f"{path}: another program has it open for writing" in done.stderr
    assert "damaged" not in done.stderr.splitlines()[-1]


def test_an_array_is_a_file_of_its_own_format_only(tmp_path):
    """Numbers without a head in a file that is named like NPY."""
    raw = np.memmap(tmp_path / "raw.npy", Y.dtype, "w+", shape=Y.shape)
    raw[:] = Y
    np.testing.assert_array_equal(open_source(raw).read(1, 3), Y[1:3])


class Counting:
    """An array that counts what is read."""

    shape, dtype = Y.shape, Y.dtype

    def __init__(self):
        self.read = 0

    def __getitem__(self, part):
        self.read += len(Y[part])
        return Y[part]


def test_only_what_is_asked_for_is_read():
    counting = Counting()
    source = open_source(counting)
    assert counting.read == 0
    source.read(1, 3)
    assert counting.read == 2


@pytest.mark.parametrize(("place", "fails"), [(0, 0), (1, 2)])
@pytest.mark.parametrize("name", ["damaged.png", "damaged.npy"])
def test_a_damaged_file_among_others_is_met_in_its_turn(tmp_path, place, fails, name):
    files = as_files(tmp_path)
    files[place] = tmp_path / name
    files[place].write_bytes(b"no picture")
    source = open_source(files)
    assert (source.count, source.shape) == (4, Y.shape[1:])
    np.testing.assert_array_equal(source.read(3, 4), Y[4:])
    with pytest.raises(FormatError, match="damaged"):
        source.read(fails, fails + 1)
    with pytest.raises(FormatError, match="damaged"):
        open_source([files[place]] * 2)


@pytest.mark.parametrize("code", [errno.EIO, errno.ESTALE, errno.ETIMEDOUT])
def test_a_disk_that_is_away_for_a_moment_costs_one_measurement(tmp_path, monkeypatch, code):
    """Bug: it ended the run, where a damaged file fails alone."""
    source, stat, opens = as_folder(tmp_path), Path.stat, Path.open

    def away(path, **options):
        if path.name == "picture_10.png":
            raise OSError(code, os.strerror(code), str(path))
        return stat(path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda path, *mode, **options: away(path) and opens(path, *mode, **options))
        opened = open_source(source)
        patch.setattr(Path, "stat", away)
        with pytest.raises(OSError, match=r"picture_10\.png"):
            opened.read(2, 3)
        np.testing.assert_array_equal(opened.read(3, 4), Y[3:4])
    np.testing.assert_array_equal(opened.read(2, 3), Y[2:3])


def test_nobody_is_advised_to_unpickle(tmp_path):
    np.save(tmp_path / "objects.npy", np.array([{}, None]))
    (tmp_path / "text.npy").write_text("no array")
    for name in ("objects.npy", "text.npy"):
        for read in (open_source, io.read):
            with pytest.raises(FormatError, match=f"{name} cannot be read, it may be damaged or hold Python objects$"):
                read(tmp_path / name)


def test_what_is_no_source_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"missing\.npy"):
        open_source(tmp_path / "missing.npy")
    with pytest.raises(FormatError, match="no files of these kinds"):
        open_source(tmp_path)
    with pytest.raises(InputError, match=r"source has shape \(3,\)"):
        open_source(np.ones(3))
    with pytest.raises(InputTypeError, match="source has dtype complex"):
        open_source(np.ones((2, 3, 3), complex))
    np.save(tmp_path / "a.npy", Y)
    np.save(tmp_path / "b.npy", Y[:, 1:])
    with pytest.raises(InputError, match=r"b\.npy has pictures of \(23, 24\)"):
        open_source(tmp_path)
    zarr = pytest.importorskip("zarr")
    group = zarr.create_group(tmp_path / "two.zarr")
    for name in ("a", "b"):
        group.create_array(name, data=Y)
    with pytest.raises(FormatError, match=r"a \(5, 24, 24\), b"):
        open_source(tmp_path / "two.zarr")
    np.testing.assert_array_equal(open_source(tmp_path / "two.zarr", "b").read(0, 1), Y[:1])


def _in_two_files(folder, names=("y_0.ome.tif", "y_1.ome.tif")):
    """An OME-TIFF whose pictures are in two files, as microscopes write it."""
    tifffile = pytest.importorskip("tifffile")
    planes = "".join(
        f'<TiffData FirstC="0" FirstT="{t}" FirstZ="0" IFD="{t % 2}" PlaneCount="1">'
        f'<UUID FileName="{names[t // 2]}">urn:uuid:{t // 2}</UUID></TiffData>'
        for t in range(4)
    )
    size = 'SizeC="1" SizeT="4" SizeX="24" SizeY="24" SizeZ="1" Type="uint16"'
    for i, name in enumerate(names):
        text = (
            '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
            f'UUID="urn:uuid:{i}"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYCZT" {size}>{planes}'
            "</Pixels></Image></OME>"
        )
        with tifffile.TiffWriter(folder / name) as file:
            for n, picture in enumerate(Y[2 * i : 2 * i + 2]):
                file.write(picture, description=None if n else text, metadata=None, contiguous=False)
    return folder / names[0], folder / names[1]


def _virtual(folder):
    h5py = pytest.importorskip("h5py")
    io.write(folder / "part.h5", {"d": Y})
    layout = h5py.VirtualLayout(Y.shape, Y.dtype)
    layout[:] = h5py.VirtualSource(str(folder / "part.h5"), "d", Y.shape)
    with h5py.File(folder / "y.h5", "w") as file:
        file.create_virtual_dataset("meas", layout)
    return folder / "y.h5", folder / "part.h5"


def _external(folder):
    h5py = pytest.importorskip("h5py")
    (folder / "part.bin").write_bytes(Y.tobytes())
    with h5py.File(folder / "y.h5", "w") as file:
        file.create_dataset("meas", Y.shape, Y.dtype, external=[(str(folder / "part.bin"), 0, Y.nbytes)])
    return folder / "y.h5", folder / "part.bin"


@pytest.mark.parametrize("made", [_virtual, _external, _in_two_files])
def test_a_file_whose_other_part_is_missing_is_refused(made, tmp_path):
    """It is not read as 0, neither before nor after the source was opened."""
    path, part = made(tmp_path)
    source = open_source(path)
    np.testing.assert_array_equal(source.read(0, source.count), Y[: source.count])
    part.unlink()
    with pytest.raises(FormatError, match=r"in (an)?other files?.*not there"):
        open_source(path)
    with pytest.raises(FormatError, match="not there"):
        source.read(0, source.count)


def test_parts_of_one_series_do_not_count_twice(tmp_path):
    first, second = _in_two_files(tmp_path)
    assert open_source(first).count == 4
    for given in (tmp_path, [second, first]):
        with pytest.raises(InputError, match="give it alone"):
            open_source(given)
    second.rename(tmp_path / "elsewhere")
    with pytest.raises(FormatError, match="not there"):
        open_source(tmp_path)


def test_chunks_that_are_not_stored_are_counted(tmp_path, caplog):
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(tmp_path / "y.zarr", shape=Y.shape, chunks=(1, 24, 12), dtype=Y.dtype)
    array[:] = Y
    open_source(tmp_path / "y.zarr")
    assert not caplog.records
    (tmp_path / "y.zarr" / "c" / "3" / "0" / "1").unlink()
    open_source(tmp_path / "y.zarr")
    assert "1 of 10 chunks are not stored" in caplog.text
