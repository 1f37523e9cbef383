"""Files as other software leaves them: every number is read as it was stored, or the error says what is missing."""

import contextlib
import os
import struct
import subprocess
import sys
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
from PIL import Image

from pnp_sci import Result, io
from pnp_sci.errors import FormatError
from pnp_sci.fleet.source import open_source
from pnp_sci.results.history import History, Record, Status

imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
pytest.importorskip("av")
RNG = np.random.default_rng(0)
Y = RNG.random((12, 16))
MASKS = RNG.random((12, 16, 4)) < 0.5  # planes last, as in MATLAB
GREY = RNG.integers(0, 4096, (24, 32)).astype(np.uint16)
VIEWS = RNG.integers(0, 4096, (2, 5, 24, 32)).astype(np.uint16)


def matlab73(path, fill):
    """A MAT-file v7.3: HDF5 behind a header of MATLAB, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + b" " * 8 + b"\x00\x02IM")


def in_struct(file):
    group = file.create_group("data")
    group.attrs["MATLAB_class"] = np.bytes_("struct")
    group["meas"], group["mask"] = Y.T, MASKS.T.astype("u1")


@pytest.mark.parametrize("version", ["v5", "v7.3"])
@pytest.mark.parametrize("separator", [".", "/"])
def test_fields_of_a_struct(tmp_path, version, separator):
    path = tmp_path / "a.mat"
    if version == "v5":
        scipy.io.savemat(path, {"data": {"meas": Y, "mask": MASKS.astype("u1")}})
    else:
        matlab73(path, in_struct)
    np.testing.assert_array_equal(io.read_measurement(path, f"data{separator}meas"), Y)
    np.testing.assert_array_equal(io.read_measurement(path), Y)  # there is but one `meas`
    np.testing.assert_array_equal(io.read_masks(path)[0], MASKS.transpose(2, 0, 1))


def test_cells_sparse_and_complex_arrays(tmp_path):
    planes = np.empty((1, 4), object)
    planes[0] = [MASKS[..., n].astype(float) for n in range(4)]
    mixed = np.array([Y, "words", Y[:3]], object)
    content = {
        "mask": planes,
        "mixed": mixed,
        "meas": Y + 1e-17j,
        "truly": Y * (1 + 1j),
        "few": scipy.sparse.csc_array(Y > 0.9),
    }
    scipy.io.savemat(tmp_path / "a.mat", content)
    np.testing.assert_array_equal(io.read_masks(tmp_path / "a.mat")[0], MASKS.transpose(2, 0, 1))
    np.testing.assert_array_equal(io.read_measurement(tmp_path / "a.mat"), Y)
    np.testing.assert_array_equal(io.read(tmp_path / "a.mat", "few"), Y > 0.9)
    np.testing.assert_array_equal(io.read(tmp_path / "a.mat", "mixed[2]"), Y[:3])
    assert "truly" not in {entry.key for entry in io.describe(tmp_path / "a.mat")}


def written(file, name, array, kind="double", **attributes):
    made = file.create_dataset(name, data=array)
    made.attrs["MATLAB_class"] = np.bytes_(kind)
    made.attrs.update(attributes)
    return made


def references(file, name, parts, kind=None):
    """A cell of parts, or a field of an array of structs, as MATLAB v7.3 stores them."""
    hidden = file.require_group("#refs#")
    made = file.create_dataset(name, (len(parts), 1), h5py.ref_dtype)
    for n, part in enumerate(parts):
        if isinstance(part, str):
            codes = np.array([[ord(letter)] for letter in part], np.uint16)
            made[n, 0] = written(hidden, f"{len(hidden)}", codes, "char", MATLAB_int_decode=2).ref
        else:
            made[n, 0] = written(hidden, f"{len(hidden)}", part.T).ref
    if kind:
        made.attrs["MATLAB_class"] = np.bytes_(kind)


def as_struct_array(file):
    group = file.create_group("data")
    group.attrs["MATLAB_class"] = np.bytes_("struct")
    references(file, "data/meas", [Y, Y[:3]])
    references(file, "data/name", ["one", "two"])


def as_mixed_cells(file):
    references(file, "mixed", [Y, "words", Y[:3]], "cell")
    references(file, "one", [Y], "cell")


def as_table_of_cells(file):
    hidden, made = file.require_group("#refs#"), file.create_dataset("cells", (3, 2), h5py.ref_dtype)
    made.attrs["MATLAB_class"] = np.bytes_("cell")
    for i, j in np.ndindex(2, 3):
        made[j, i] = written(hidden, f"{i}{j}", Y.T + 10 * i + j).ref


def as_texts(file):
    written(file, "name", np.array([[ord(letter)] for letter in "words"], np.uint16), "char", MATLAB_int_decode=2)
    written(file, "mask", MASKS.T.astype("u1"), "logical")


def as_sparse(file):
    for name, matrix in {"few": scipy.sparse.csc_array(np.where(Y > 0.9, Y, 0)), "none": None}.items():
        group = file.create_group(name)
        group.attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": np.uint64(len(Y))})
        group["jc"] = matrix.indptr.astype("u8") if matrix is not None else np.zeros(Y.shape[1] + 1, "u8")
        if matrix is not None:
            group["data"], group["ir"] = matrix.data, matrix.indices.astype("u8")


def as_complex(file):
    made = np.empty(Y.T.shape, [("real", "f8"), ("imag", "f8")])
    made["real"], made["imag"] = Y.T, 1e-17
    written(file, "meas", made)


def cell(*parts):
    made = np.empty((len(parts), 1), object)
    made[:, 0] = parts
    return made


V5 = {
    as_struct_array: {"data": np.array([[(Y, "one"), (Y[:3], "two")]], [("meas", object), ("name", object)])},
    as_mixed_cells: {"mixed": cell(Y, "words", Y[:3]), "one": cell(Y)},
    as_table_of_cells: {"cells": np.fromfunction(np.frompyfunc(lambda i, j: Y + 10 * i + j, 2, 1), (2, 3))},
    as_texts: {"name": "words", "mask": MASKS},
    as_sparse: {
        "few": scipy.sparse.csc_array(np.where(Y > 0.9, Y, 0)),
        "none": scipy.sparse.csc_array(Y.shape, dtype=float),
    },
    as_complex: {"meas": Y + 1e-17j},
}


@pytest.mark.parametrize("fill", V5, ids=lambda fill: fill.__name__)
def test_both_versions_of_matlab_files_give_the_same(tmp_path, fill):
    scipy.io.savemat(tmp_path / "5.mat", V5[fill])
    matlab73(tmp_path / "73.mat", fill)
    old, new = ({entry.key: entry for entry in io.describe(tmp_path / f"{name}.mat")} for name in ("5", "73"))
    assert list(old) == list(new)
    for key in old:
        np.testing.assert_array_equal(io.read(tmp_path / "73.mat", key), io.read(tmp_path / "5.mat", key))
        assert new[key].dtype == old[key].dtype


def test_hdf5_of_python_under_a_name_of_matlab(tmp_path):
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["meas"], file["masks"] = Y, MASKS.transpose(2, 0, 1)
    np.testing.assert_array_equal(io.read_measurement(tmp_path / "a.mat"), Y)
    np.testing.assert_array_equal(io.read_masks(tmp_path / "a.mat")[0], MASKS.transpose(2, 0, 1))


def test_planes_first_in_matlab_73(tmp_path):
    pic = MASKS.transpose(2, 0, 1).astype("f4")
    matlab73(tmp_path / "a.mat", lambda file: file.create_dataset("pic", data=pic.T))
    np.testing.assert_array_equal(io.read_video(tmp_path / "a.mat")[0], pic)


def png(path, colour_type, samples):
    def chunk(tag, data):
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    head = struct.pack(">IIBBBBB", samples.shape[1], samples.shape[0], 16, colour_type, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in samples.astype(">u2")))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b""))


@pytest.mark.parametrize(("colour_type", "channels"), [(0, 1), (2, 3), (4, 2), (6, 4)])
def test_png_of_sixteen_bits(tmp_path, colour_type, channels):
    samples = np.repeat(GREY[..., None], channels, 2)
    if channels in (2, 4):
        samples[..., -1] = 65535
    png(tmp_path / "a.png", colour_type, samples)
    np.testing.assert_array_equal(io.read(tmp_path / "a.png"), GREY)


def ffmpeg(*arguments, **options):
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", *map(str, arguments)], check=True, **options)


def test_film_of_sixteen_bits(tmp_path):
    raw = ["-f", "rawvideo", "-pix_fmt", "gray16le", "-s", "32x24", "-i", "-"]
    ffmpeg(*raw, "-c:v", "ffv1", tmp_path / "a.mkv", input=GREY.tobytes())
    np.testing.assert_array_equal(io.read(tmp_path / "a.mkv")[0], GREY)


@pytest.mark.parametrize("pixels", ["rgb48be", "rgba64be", "ya16be", "gray16be"])
def test_no_bits_are_lost_in_any_format_of_pixels(tmp_path, pixels):
    raw = ["-f", "rawvideo", "-pix_fmt", "gray16le", "-s", "32x24", "-i", "-"]
    ffmpeg(*raw, "-c:v", "png", "-pix_fmt", pixels, tmp_path / "a.mov", input=GREY.tobytes())
    difference = io.read(tmp_path / "a.mov")[0].astype(int) - GREY
    assert np.abs(difference).max() <= 0.004 * GREY.max()  # ffmpeg rounds where it makes grey of colours


@pytest.mark.parametrize("fps", [1e-4, 0.5, 1000, 12345])
@pytest.mark.parametrize("suffix", ["mp4", "avi", "mkv", "mov", "gif"])
def test_films_of_any_speed(tmp_path, fps, suffix):
    io.write_video(tmp_path / f"a.{suffix}", VIEWS[0] / 4095, fps)
    assert io.read(tmp_path / f"a.{suffix}").shape == VIEWS[0].shape


@pytest.mark.parametrize("seconds", [0.3, 1.5])
@pytest.mark.parametrize(
    ("suffix", "codec"), [("mp4", "aac"), ("mov", "pcm_s16le"), ("avi", "mp3"), ("mkv", "libopus")]
)
def test_films_with_sound(tmp_path, suffix, codec, seconds):
    """Sound may be shorter or longer than the film; of a film that is cut off nothing is read."""
    io.write_video(tmp_path / "a.mp4", np.repeat(VIEWS[0], 2, 0) / 4095)
    path = tmp_path / f"b.{suffix}"
    sound = ["-f", "lavfi", "-t", seconds, "-i", "sine"]
    ffmpeg("-i", tmp_path / "a.mp4", *sound, "-c:v", "copy", "-c:a", codec, path)
    assert len(io.read(path)) == 10
    whole = path.read_bytes()
    for part in (0.3, 0.5, 0.7, 0.9):
        path.write_bytes(whole[: int(part * len(whole))])
        with contextlib.suppress(FormatError):
            assert len(io.read(path)) == 10


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_film_behind_its_sound(tmp_path, suffix):
    levels = 10 * np.arange(25)
    io.write(tmp_path / "a.avi", np.broadcast_to(levels[:, None, None], (25, 16, 24)).astype(np.uint8))
    sound, coded = ["-f", "lavfi", "-t", "2.5", "-i", "sine"], ["-c:v", "libx264", "-bf", 4, "-crf", 10]
    ffmpeg("-i", tmp_path / "a.avi", *sound, "-map", "1:a", "-map", "0:v", *coded, tmp_path / f"b.{suffix}")
    read = io.read(tmp_path / f"b.{suffix}").mean((1, 2))
    assert len(read) == 25
    assert np.abs(read - levels).max() < 3


@pytest.mark.parametrize("turned", [["-display_rotation", "90"], ["-display_rotation", "180"], ["-display_hflip"]])
def test_a_film_is_read_as_it_is_shown(tmp_path, turned):
    """The oracle is ffmpeg, which turns and mirrors frames."""
    io.write(tmp_path / "a.mp4", np.repeat(np.arange(16 * 24, dtype=np.uint8).reshape(1, 16, 24) // 2, 3, 0))
    ffmpeg(*turned, "-i", tmp_path / "a.mp4", "-c", "copy", tmp_path / "b.mp4")
    ffmpeg("-i", tmp_path / "b.mp4", "-c:v", "rawvideo", "-pix_fmt", "gray", tmp_path / "c.avi")
    np.testing.assert_array_equal(io.read(tmp_path / "b.mp4"), io.read(tmp_path / "c.avi"))


def test_a_film_with_subtitles_that_stay(tmp_path):
    io.write_video(tmp_path / "a.mp4", VIEWS[0] / 4095)
    (tmp_path / "a.srt").write_text("1\n00:00:00,000 --> 00:00:05,000\nwords\n")
    ffmpeg("-i", tmp_path / "a.mp4", "-i", tmp_path / "a.srt", "-c:v", "copy", "-c:s", "srt", tmp_path / "b.mkv")
    assert len(io.read(tmp_path / "b.mkv")) == 5


def test_a_film_that_was_trimmed_without_coding_it_anew(tmp_path):
    """The frames from the cut on are read: those before it are hidden by an edit list."""
    levels = 20 * np.arange(10) + 10
    io.write(tmp_path / "a.mp4", np.broadcast_to(levels[:, None, None], (10, 16, 24)).astype(np.uint8))
    ffmpeg("-ss", "0.41", "-i", tmp_path / "a.mp4", "-c", "copy", tmp_path / "b.mp4")
    read = io.read(tmp_path / "b.mp4").mean((1, 2))
    assert np.abs(read - levels[-len(read) :]).max() < 3
    assert len(read) in (5, 6)


@pytest.mark.parametrize("times", ["(N+N*N/3)*100", "if(lt(N,5),N*100,500+(N-5)*4)", "3000+N*100"])
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_all_frames_of_any_times(tmp_path, times, suffix):
    levels = 20 * np.arange(10) + 10
    io.write(tmp_path / "film.avi", np.broadcast_to(levels[:, None, None], (10, 16, 24)).astype(np.uint8))
    stamps = ["-vf", f"settb=1/1000,setpts='{times}'", "-fps_mode", "passthrough", "-enc_time_base", "1/1000"]
    target = tmp_path / f"a{suffix}"
    ffmpeg("-i", tmp_path / "film.avi", *stamps, "-c:v", "libx264", "-crf", 10, target)
    assert np.abs(io.read(target).mean((1, 2)) - levels).max() < 3


@pytest.mark.parametrize("name", ["10:30:00.mp4", "-a.mp4", "%03d.mp4", "a b [c] é'.mp4"])
def test_films_of_odd_names(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    frames = np.zeros((5, 32, 32), np.uint8)
    io.write_video(name, frames)
    assert os.listdir() == [name]
    assert io.read(name).shape == frames.shape


def test_parts_in_other_files(tmp_path):
    with h5py.File(tmp_path / "part.h5", "w") as file:
        file["d"] = Y
    layout = h5py.VirtualLayout(Y.shape, Y.dtype)
    layout[:] = h5py.VirtualSource("part.h5", "d", Y.shape)
    with h5py.File(tmp_path / "whole.h5", "w") as file:
        file.create_virtual_dataset("meas", layout)
        file["linked"] = h5py.ExternalLink("part.h5", "/d")
    np.testing.assert_array_equal(io.read_measurement(tmp_path / "whole.h5"), Y)
    np.testing.assert_array_equal(io.read(tmp_path / "whole.h5", "linked"), Y)
    (tmp_path / "part.h5").unlink()
    with pytest.raises(FormatError, match=r"part\.h5, which is not there"):
        io.read_measurement(tmp_path / "whole.h5")


@pytest.mark.parametrize("compression", [None, "tiff_lzw"])
def test_ome_tiff_of_which_a_file_is_missing(tmp_path, compression):
    uuid = [f"urn:uuid:00000000-0000-0000-0000-00000000000{i}" for i in range(2)]
    planes = "".join(
        f'<TiffData FirstT="{t}" IFD="0" PlaneCount="1"><UUID FileName="m_{t}.ome.tif">{uuid[t]}</UUID></TiffData>'
        for t in range(2)
    )
    for i in range(2):
        xml = (
            f'<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="{uuid[i]}"><Image ID="Image:0">'
            '<Pixels ID="Pixels:0" DimensionOrder="XYCZT" SizeC="1" SizeT="2" SizeX="32" SizeY="24" SizeZ="1" '
            f'Type="uint16">{planes}</Pixels></Image></OME>'
        )
        pillow_tiff(tmp_path / f"m_{i}.ome.tif", [GREY + i], compression, xml)
    np.testing.assert_array_equal(io.read(tmp_path / "m_0.ome.tif"), [GREY, GREY + 1])
    (tmp_path / "m_1.ome.tif").unlink()
    with pytest.raises(FormatError, match="in other files, which are not there"):
        io.read(tmp_path / "m_0.ome.tif")


def test_a_folder_with_what_others_left_in_it(tmp_path):
    for n in (1, 2, 10):
        Image.fromarray(np.full((4, 5), n, np.uint8)).save(tmp_path / f"m{n}.PNG", format="png")
    (tmp_path / "._m1.png").write_bytes(b"\0\5\x16\7Mac OS X")
    (tmp_path / "Thumbs.db").write_bytes(b"\xd0\xcf")
    assert io.read(tmp_path)[:, 0, 0].tolist() == [1, 2, 10]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["f_1.png", "f_2.png", "f_3.jpg"], "left out: f_3.jpg"),
        (
            ["f_001.png", "f_002.png", "f_004.png", "f_005.png"],
            "numbers are missing in the names of its pictures: 1 of 5",
        ),
        (["10.png", "20.png", "40.png", "50.png"], "1 of 5"),
        (["t0.5.png", "t0.10.png", "t0.75.png"], "equally many digits"),
        (["t0.05.png", "t0.10.png", "t0.15.png"], None),
        (["1.png", "2.png", "3.png"], None),
        (["8.tif", "9.tif", "10.tif"], None),
        (["t17.png", "t33.png", "t50.png", "t67.png"], None),  # times in milliseconds
        (["a1_b1.png", "a1_b2.png", "a2_b1.png", "a2_b3.png"], None),
        (["left.png", "right.png"], None),
    ],
)
def test_what_a_folder_of_frames_seems_to_lack_is_said(tmp_path, caplog, names, said):
    for name in names:
        Image.fromarray(GREY).save(tmp_path / name) if not name.endswith("jpg") else (tmp_path / name).touch()
    assert len(io.read(tmp_path)) == sum(not name.endswith("jpg") for name in names)
    assert said in caplog.text if said else not caplog.text


def test_a_pipe_is_refused(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes with names")
    os.mkfifo(tmp_path / "a.npz")
    with pytest.raises(FormatError, match="is a pipe"):
        io.read(tmp_path / "a.npz")


def pillow_tiff(path, pages, compression=None, about=None, photometric=None):
    """Pages by Pillow, which knows LZW, with the description of other software."""
    tags = {270: about, 262: photometric}
    options = {"compression": compression, "tiffinfo": {tag: value for tag, value in tags.items() if value is not None}}
    first, *rest = map(Image.fromarray, pages)
    first.save(path, save_all=True, append_images=rest, **options)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_deflate"])
def test_tiff_with_a_compression(tmp_path, compression):
    pillow_tiff(tmp_path / "a.tif", [GREY], compression)
    np.testing.assert_array_equal(io.read(tmp_path / "a.tif"), GREY)


@pytest.mark.parametrize("compression", [None, "tiff_lzw"])
@pytest.mark.parametrize("axes", ["TCYX", "ZCYX", "CTYX", "CZYX", "ZTCYX", "TZCYX"])
@pytest.mark.parametrize("kind", ["ome", "imagej"])
def test_channels_are_views_and_times_or_slices_frames(tmp_path, kind, axes, compression):
    """Whatever the order in which other software stores them, and the compression."""
    if kind == "imagej" and axes not in ("TCYX", "ZCYX", "TZCYX"):
        pytest.skip("ImageJ has the order TZCYX")
    stack = VIEWS if axes[0] == "C" else VIEWS.swapaxes(0, 1)
    stack = stack if len(axes) == 4 else stack[:, None] if axes[0] == "T" else stack[None]
    whole, path = tmp_path / "whole.ome.tif", tmp_path / "a.ome.tif"
    tifffile.imwrite(whole, stack, **{kind: True}, metadata={"axes": axes})
    with tifffile.TiffFile(whole) as file:
        about = file.pages[0].description
    pillow_tiff(path, stack.reshape(-1, 24, 32), compression, about)
    for written in (whole, path):
        np.testing.assert_array_equal(io.read_masks(written), VIEWS)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_deflate", "group4"])
@pytest.mark.parametrize("dtype", [bool, np.uint8, np.uint16])
def test_white_is_the_largest_value(tmp_path, dtype, compression):
    """A TIFF may store 0 for white (MinIsWhite): what is read is as displayed, whatever the compression."""
    if compression == "group4" and dtype is not bool:
        pytest.skip("group 4 is for two levels")
    stored = GREY > 2048 if dtype is bool else (GREY >> 4).astype(dtype)
    white = stored if dtype is np.uint16 else ~stored  # Pillow takes values as displayed, those of 16 bits as stored
    pillow_tiff(tmp_path / "a.tif", [white], compression, photometric=0)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert file.pages[0].photometric == 0
    np.testing.assert_array_equal(io.read(tmp_path / "a.tif"), ~stored)


def tiff_of_twelve_bits(path, samples, order="<"):
    """Two samples in three bytes, as cameras write Mono12p."""
    first, second = samples.reshape(-1, 2).T.astype(np.uint32)
    data = np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], 1).astype(np.uint8).tobytes()
    rows, columns = samples.shape
    sizes = [(256, columns), (257, rows), (258, 12), (259, 1), (262, 1), (273, 8), (277, 1), (278, rows)]
    tags = [*sizes, (279, len(data))]
    directory = struct.pack(f"{order}H", len(tags)) + b"".join(struct.pack(f"{order}HHII", t, 4, 1, v) for t, v in tags)
    mark = b"II*\0" if order == "<" else b"MM\0*"
    path.write_bytes(mark + struct.pack(f"{order}I", 8 + len(data)) + data + directory + bytes(4))


def test_tiff_of_twelve_bits(tmp_path):
    tiff_of_twelve_bits(tmp_path / "a.tif", GREY)
    np.testing.assert_array_equal(io.read(tmp_path / "a.tif"), GREY)


def test_a_package_that_is_missing_for_a_tiff_is_named(tmp_path):
    tiff_of_twelve_bits(tmp_path / "a.tif", GREY, ">")  # Pillow knows the other order of bytes only
    with contextlib.suppress(ImportError):
        import imagecodecs  # noqa: F401

        pytest.skip("imagecodecs is installed")
    with pytest.raises(FormatError, match="pip install imagecodecs"):
        io.read(tmp_path / "a.tif")


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_grey_and_colour_tiff(tmp_path, planar):
    """Colours that are grey are one plane, others need colour=True; transparency is dropped."""
    frames = np.stack([VIEWS[0], VIEWS[0] // 2, VIEWS[0] // 3], -1)
    options = {"photometric": "rgb", "planarconfig": planar}
    for name, content in {"colour": frames, "grey": np.repeat(frames[..., :1], 3, -1)}.items():
        stored = content if planar == "contig" else np.moveaxis(content, -1, 1)
        tifffile.imwrite(tmp_path / f"{name}.tif", stored, **options)
        np.testing.assert_array_equal(io.read_video(tmp_path / f"{name}.tif", colour=True)[0], content)
    np.testing.assert_array_equal(io.read(tmp_path / "grey.tif"), VIEWS[0])
    with pytest.raises(FormatError, match=r"colour\.tif: a colour picture came"):
        io.read(tmp_path / "colour.tif")


def test_a_grey_tiff_with_transparency(tmp_path):
    samples = np.stack([GREY, np.full_like(GREY, 65535)], -1)
    tifffile.imwrite(tmp_path / "a.tif", samples, photometric="minisblack", extrasamples=["unassalpha"])
    np.testing.assert_array_equal(io.read(tmp_path / "a.tif"), GREY)


@pytest.mark.parametrize("kind", ["png", "tif"])
def test_a_folder_of_colour_pictures(tmp_path, kind):
    frames = np.stack([GREY, GREY // 2, GREY // 3], -1)[None] // np.arange(16, 19)[:, None, None, None]
    frames = frames.astype(np.uint8)
    for n, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{n}.{kind}")
    np.testing.assert_array_equal(io.read_video(tmp_path, colour=True)[0], frames)
    with pytest.raises(FormatError, match="a colour picture came"):
        io.read_video(tmp_path)


def test_colours_of_sixteen_bits(tmp_path):
    frame = np.stack([GREY, GREY // 2, GREY // 3], -1)
    png(tmp_path / "0.png", 2, frame)
    np.testing.assert_array_equal(io.read_video(tmp_path, colour=True)[0, 0], frame)


@pytest.mark.parametrize("channels", [1, 3])
def test_an_animated_png_is_a_film(tmp_path, channels):
    frames = (VIEWS[0] >> 4).astype(np.uint8)
    first, *rest = (Image.fromarray(frame if channels == 1 else np.stack([frame] * 3, -1)) for frame in frames)
    first.save(tmp_path / "a.png", save_all=True, append_images=rest)
    np.testing.assert_array_equal(io.read_masks(tmp_path / "a.png")[0], frames)


def test_objects_beside_arrays_in_npz(tmp_path):
    np.savez(tmp_path / "a.npz", meas=Y, info={"exposure": 0.02}, truth=None)
    np.testing.assert_array_equal(io.read_measurement(tmp_path / "a.npz"), Y)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.mat", b"# Created by Octave 9.2.0\n# name: meas\n", "save -v7"),
        ("a.h5", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n", "git lfs pull"),
    ],
)
def test_what_is_not_the_file_itself(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=said):
        io.read(tmp_path / name)


def test_hdf5_that_is_being_written(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["meas"] = Y
        file.flush()
        code = f"from pnp_sci import io; io.read({str(tmp_path / 'a.h5')!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "another program has it open" in done.stderr


def test_more_is_declared_than_there_is(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("meas", (60000, 50000), "u1", chunks=True)
    np.savez_compressed(tmp_path / "a.npz", meas=np.zeros((20000, 20000), np.uint8))
    for name in ("a.h5", "a.npz"):
        with pytest.raises(FormatError, match="PNP_SCI_LARGEST"):
            io.describe(tmp_path / name)
    monkeypatch.setenv("PNP_SCI_LARGEST", "1e9")
    assert io.read(tmp_path / "a.npz").shape == (20000, 20000)


@pytest.mark.parametrize("kind", ["mat", "h5", "result"])
def test_flipped_bytes_harm_nobody(tmp_path, kind):
    """What crashes SciPy or HDF5 does not crash the caller; benchmarks/fuzz_files.py tries 20,000."""
    path = tmp_path / ("a.mat" if kind == "mat" else "a.h5")
    if kind == "result":
        Result(np.ones((1, 1, 4, 4)), Status.CONVERGED, History([Record(1, 0.1, 0.2, 0.3)]), {"a": "b"}).save(path)
    else:
        io.write(path, {"meas": Y, "mask": MASKS})
    whole = path.read_bytes()
    for _ in range(60):
        content = bytearray(whole)
        content[RNG.integers(len(content))] = RNG.integers(256)
        path.write_bytes(content)
        with contextlib.suppress(FormatError):  # any other exception, and a crash, fails the test
            (Result.load if kind == "result" else io.describe)(path)


def test_no_room_for_what_is_read_is_said(tmp_path):
    """The child passes arrays on in a temporary file."""
    resource = pytest.importorskip("resource")
    io.write(tmp_path / "a.h5", {"meas": np.zeros((300, 300))})
    code = (
        "import resource, sys; from pnp_sci import io\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (9000, resource.RLIM_INFINITY)); io.read(sys.argv[1])"
    )
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a.h5"], capture_output=True, text=True)
    assert resource
    assert "no room for its arrays" in done.stderr


def test_a_folder_of_grey_pictures_in_colour(tmp_path):
    for n in range(3):
        Image.fromarray((GREY >> 4).astype(np.uint8) // (n + 1)).save(tmp_path / f"{n}.png")
    colour, grey = io.read_video(tmp_path, colour=True), io.read_video(tmp_path)
    np.testing.assert_array_equal(colour, np.repeat(grey[..., None], 3, -1))


def test_a_colour_film_in_a_mat_file_as_long_as_it_is_high(tmp_path):
    video = np.random.default_rng(0).random((16, 16, 12, 3))
    scipy.io.savemat(tmp_path / "a.mat", {"x": video.transpose(1, 2, 3, 0)})
    np.testing.assert_array_equal(io.read_video(tmp_path / "a.mat", colour=True)[0], video)


@pytest.mark.parametrize("ramp", [1, -1])
def test_grey_palettes_are_read_as_displayed(tmp_path, ramp):
    picture = Image.fromarray((GREY >> 4).astype(np.uint8), "P")
    picture.putpalette(np.repeat(np.arange(256)[::ramp], 3).astype(np.uint8).tobytes())
    for kind in ("tif", "png"):
        picture.save(tmp_path / f"a.{kind}")
        np.testing.assert_array_equal(io.read(tmp_path / f"a.{kind}"), np.asarray(picture.convert("L")))
    with pytest.raises(FormatError, match="its values are not as displayed"):
        open_source(tmp_path / "a.tif")
