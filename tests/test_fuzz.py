"""Random input for ``solve``, ``decode`` and the readers: a clear error or a finite result, nothing else.

"Clear" is an `InputError` or `InputTypeError`, for files an `OSError` too. No exception of a library gets through, no
RuntimeWarning of ours, no NaN, no hang (an example of a long run may take 20 s), and no file takes much memory.

A normal run takes some 600 examples, the same every time. ``PNP_SCI_FUZZ=10000 pytest tests/test_fuzz.py`` takes about
10,000, others every time; what fails is kept in ``.hypothesis`` and tried first by the next run. Add
``--hypothesis-seed=N`` to repeat a long run.
"""

import datetime
import json
import os
import pathlib
import resource
import tempfile
from fractions import Fraction

import h5py
import imageio.v3
import numpy as np
import pytest
import scipy.io
import scipy.sparse
import tifffile
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from pnp_sci import Result, SensingOperator, decode, io, solve
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.results.history import History, Record, Status
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor

LONG = "PNP_SCI_FUZZ" in os.environ
EXAMPLES = int(os.environ.get("PNP_SCI_FUZZ", "600"))


def share(part):
    """So much of all examples; the same every time in a normal run."""
    return settings(
        max_examples=max(round(part * EXAMPLES), 1),
        derandomize=not LONG,
        deadline=datetime.timedelta(seconds=20) if LONG else None,  # kernels may have to be compiled in a short one
        suppress_health_check=list(HealthCheck),
    )


def clear(call, *expected):
    """What the call returns, or None where it raises an error that says what is wrong."""
    try:
        return call()
    except (InputError, InputTypeError, *expected) as error:
        assert str(error)  # noqa: PT017
        return None


# ---- solve and decode ------------------------------------------------------------------------------------------------

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 255.0, 1e-6, 1e-20, 1e-38, 1e-45, 1e-160, 1e-310, 5e-324, 1e6, 1e20, 3.4e38]
SPECIAL += [-3.4e38, 1e160, 1.7e308, -1.7e308, np.nan, np.inf, -np.inf]
DTYPES = ["f4", "f4", "f4", "f8", "f8", "f2", "u1", "?", "i1", "u2", "i4", "i8", "u8", ">f4", ">f8", ">i2", "g"]
numbers = st.sampled_from(SPECIAL) | st.floats()
amounts = st.sampled_from([0.0, 1e-30, 1e-6, 0.01, 0.1, 1.0, 30.0, 1e10, 1e38, 1e100]) | st.floats(0, 1)
scales = st.sampled_from([1.0] * 8 + [abs(x) for x in SPECIAL if np.isfinite(x)])


@st.composite
def arrays(draw, shape):
    """An array of any kind, in any layout."""
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    kind = draw(
        st.sampled_from(["uniform"] * 4 + ["binary", "binary", "normal", "sparse", "constant", "powers", "few"])
    )
    values = {
        "uniform": rng.random,
        "binary": lambda n: rng.integers(0, 2, n),
        "normal": rng.standard_normal,
        "sparse": lambda n: (rng.random(n) < 0.1) * rng.random(n),
        "constant": lambda n: np.full(n, draw(numbers)),
        "powers": lambda n: 10.0 ** rng.integers(-40, 5, n),
        "few": lambda n: rng.choice([0.0, 1.0, *draw(st.lists(numbers, min_size=1, max_size=3))], n),
    }[kind](shape)
    with np.errstate(all="ignore"):
        array = (values * draw(scales)).astype(draw(st.sampled_from(DTYPES)))
    layout = draw(st.sampled_from(["C"] * 5 + ["F", "reversed", "strided", "list"]))
    if layout == "strided":
        return np.repeat(array, 2, -1)[..., ::2]
    return {"F": np.asfortranarray(array), "reversed": array[..., ::-1], "list": array.tolist()}.get(layout, array)


def once_nan():
    calls = []
    return lambda x, sigma: calls.append(x) or (x * np.nan if len(calls) == 2 else x)


PRIORS = ["tv", "tv", "tv", "wavelet", "wavelet", "flow", "none", "tv+wavelet", "auto", [("tv", 2), ("none", 1)]]
CALLABLES = {
    "zero": lambda: lambda x, sigma: 0 * x,
    "grows": lambda: lambda x, sigma: 1e30 * x,
    "nan": once_nan,
    "float64": lambda: lambda x, sigma: x.astype(np.float64) + 1e300,
    "float16": lambda: lambda x, sigma: x.astype(np.float16),
    "bool": lambda: lambda x, sigma: x > 0.5,
    "list": lambda: lambda x, sigma: x.tolist(),
    "strings": lambda: lambda x, sigma: x.astype(str),
    "complex": lambda: lambda x, sigma: x.astype(complex),
    "other shape": lambda: lambda x, sigma: x[0],
    "None": lambda: lambda x, sigma: None,
    "ragged": lambda: lambda x, sigma: [[1], [1, 2]],
}


@st.composite
def problems(draw):
    """y and masks of matching shapes, most of them."""
    shape = draw(st.tuples(st.integers(1, 4), st.integers(1, 6), st.integers(1, 24), st.integers(1, 24)))
    masks = draw(arrays(shape))
    kind = draw(st.sampled_from(["measured"] * 4 + ["any"] * 3 + ["several", "transposed"]))
    if kind == "measured" and np.asarray(masks).dtype.kind in "biuf":
        video = np.random.default_rng(0).random(shape)
        with np.errstate(all="ignore"):
            y = (np.asarray(masks, float) * video).sum((0, 1)).astype(draw(st.sampled_from(["f4", "f8", "u2"])))
    else:
        y = draw(arrays({"several": (2, *shape[2:]), "transposed": shape[:1:-1]}.get(kind, shape[2:])))
    return shape, y, draw(st.sampled_from([masks] * 3 + [np.asarray(masks)[0]] * (shape[0] == 1)))


CAMERAS = [
    Sensor(read, gain, full, bits)
    for read, gain, full, bits in (
        ("auto", 0, 1, None), ("auto", 0, 1e-300, 32), (0, 0, 0.5, 8), (0, 1, None, None), (0.1, 1e-30, 3, 1),
        (1e30, 1e300, 1e30, 12), (1e-300, 5, 100, None),
    )
]  # fmt: skip


@st.composite
def options(draw, shape):
    """Arguments of solve that could be meant, most of them."""
    optional = {
        "algorithm": st.sampled_from(["gap", "plain-gap", "admm"]),
        "effort": st.sampled_from(["fast", "balanced", "best"]),
        "noise": st.just("auto") | amounts | numbers | st.sampled_from(CAMERAS),
        "sigma": st.none() | amounts | amounts.map(np.float32) | st.sampled_from([np.nan, -1.0, np.inf]),
        "tol": amounts | numbers,
        "time_budget": st.none() | st.sampled_from([0, 1e-9, 0.01, 5, 1e300]) | numbers,
        "scene": st.sampled_from(["auto", "full"])
        | st.builds(SceneModel, st.tuples(*[st.booleans()] * shape[0]), st.booleans()),
        "init": st.just("adjoint") | arrays(shape) | arrays(shape).map(lambda a: lambda problem, scene: a),
        "reference": arrays(shape) | st.just(np.full(shape, 0.5)),
        "seed": st.integers(-1, 2**70),
        "strength": st.sampled_from([0.5, 1e-30, 1e30, 0, -1, np.nan]),
    }
    prior = draw(st.sampled_from(PRIORS) | st.sampled_from(sorted(CALLABLES)).map(lambda name: CALLABLES[name]()))
    if prior == "auto":
        del optional["time_budget"]  # the two together measure the machine first
    names = draw(st.lists(st.sampled_from(sorted(optional)), unique=True, max_size=5))
    calls = draw(st.sampled_from([1, 2, 3, 4, 5, 6, 6, 0, 66 if prior == "flow" else 3]))
    return {"prior": prior, "iterations": calls} | {name: draw(optional[name]) for name in names}


def sound(result, y, shape):
    """Of the right shape and dtype, finite, and fit to be saved."""
    y = np.asarray(y)
    assert result.x.shape == ((len(y), *shape) if y.ndim == 3 else shape)
    assert result.x.dtype == (np.float64 if y.dtype == np.float64 else np.float32)
    assert np.isfinite(result.x).all()
    assert np.isfinite(result.history["residual"]).all()
    assert repr(result)
    assert str(result)
    json.dumps(result.settings)
    assert len(result.scenes) == (len(y) if y.ndim == 3 else 1)
    json.dumps(result.scenes)


# where the masks are 1e-20 of the others, the estimate is 1e20, and its square too large for float32
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning:priors")
@share(0.4)
@given(st.data(), problems())
def test_solve(data, problem):
    shape, y, masks = problem
    arguments = data.draw(options(shape))
    result = clear(lambda: solve(y, masks, **arguments))
    if result:
        sound(result, y, shape)


JUNK = {
    "None": None, "True": True, "zero": 0, "negative": -1, "float": 2.5, "nan": float("nan"), "inf": float("inf"),
    "huge": 10**400, "complex": 1j, "numpy complex": np.complex64(1), "numpy float": np.float32(0.5),
    "fraction": Fraction(1, 2), "text": "tv", "empty text": "", "bytes": b"tv", "list": [], "ragged": [[1], [1, 2]],
    "tuple": (), "dict": {}, "set": {1}, "object": object(), "0-d": np.array(1), "1-d": np.ones(3),
    "2-d": np.ones((2, 2)), "5-d": np.ones((1, 1, 1, 8, 8)), "empty array": np.ones((0, 3)),
    "strings": np.array(["a"]), "objects": np.array([None]), "complex array": np.ones((8, 8), complex),
    "structured": np.zeros((8, 8), "f4,i4"), "dates": np.zeros((8, 8), "M8[s]"), "path": pathlib.Path("y.npy"),
    "pairs": [("tv", 1), ("no such", 2)], "pair": ("tv", 1), "many plus": "tv++", "type": dict, "generator": iter("ab"),
    "sparse": scipy.sparse.eye(8), "scene": SceneModel((True,)), "two views": SceneModel((True, False)),
    "operator": SensingOperator(np.ones((1, 1, 2, 2))), "date": datetime.date(2020, 1, 1), "slice": slice(3),
    "masked": np.ma.masked_array(np.ones((8, 8)), True), "memory": memoryview(b"abc"),
}  # fmt: skip
JUNK |= {f"gives {name}": lambda *_, value=value: value for name, value in JUNK.items()}
ARGUMENTS = ["y", "masks", "prior", "init", "algorithm", "effort", "scene", "iterations", "noise", "sigma", "tol"]
ARGUMENTS += ["time_budget", "reference", "callback", "progress", "device", "seed", "threads", "strength", "no_option"]


@share(0.2)
@example("prior", "type", "gap")
@example("init", "type", "gap")
@example("seed", "text", "gap")
@example("tol", "None", "gap")
@example("threads", "huge", "gap")
@given(st.sampled_from(ARGUMENTS), st.sampled_from(sorted(JUNK)), st.sampled_from(["gap", "admm"]))
def test_wrong_types(argument, junk, algorithm):
    masks = np.random.default_rng(0).random((2, 3, 8, 8))
    good = {"y": masks.sum((0, 1)), "masks": masks, "iterations": 2, "algorithm": algorithm}
    if (argument, junk) == ("strength", "numpy complex") or (argument == "callback" and junk[:5] in ("type", "gives")):
        return  # what a class or function given by the caller does is its own affair
    arguments = good | {argument: JUNK[junk]}
    try:
        result = solve(**arguments)
    except (InputError, InputTypeError) as error:
        assert argument in str(error)  # noqa: PT017
    else:
        sound(result, np.asarray(arguments["y"]), np.shape(masks))


@share(0.01)
@given(st.data(), st.sampled_from(["ofanet", "ofanet-fast"]))
def test_decode(data, model):
    """The network has weights for 2 views of 10 frames."""
    shape = (2, 10, *data.draw(st.tuples(st.integers(1, 24), st.integers(1, 24))))
    masks, y = data.draw(arrays(shape)), data.draw(arrays(shape[2:]))
    result = clear(lambda: decode(y, masks, model))
    if result:
        sound(result, y, shape)


@share(0.04)
@given(problems(), st.sampled_from(["ofanet", "ofanet-fast", "no such", *JUNK.values()]))
def test_decode_refuses(problem, model):
    _, y, masks = problem
    assert clear(lambda: decode(y, masks, model)) is None
    with pytest.raises(InputError, match="options of decoder"):
        decode(np.ones((8, 8)), np.ones((2, 10, 8, 8)), no_option=1)


# ---- files -----------------------------------------------------------------------------------------------------------

load = Result.load
READERS = [io.read, io.read_measurement, io.read_masks, io.read_video, io.describe, load]


def _scene():
    rng = np.random.default_rng(0)
    video = (255 * rng.random((2, 3, 16, 12))).astype(np.uint8)
    return {"y": rng.random((16, 12), np.float32), "masks": rng.random((2, 3, 16, 12)) < 0.5, "x": video}


def _v73(path, arrays):
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, array in arrays.items():
            made = file.create_dataset(key, data=array.T.astype(np.uint8), chunks=True, compression="gzip")
            made.attrs["MATLAB_class"] = np.bytes_("logical" if array.dtype == bool else "uint8")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _result(path, arrays):
    history = History([Record(1, 0.5, 0.25, 0.1, 20.5), Record(2, 1.0, 0.125, 0.05, 21.0, 0.75)])
    Result(arrays["x"] / np.float32(255), Status.CONVERGED, history, {"prior": "tv"}).save(path)


def _odd(path, arrays):
    """A MAT-file with much that is no picture."""
    other = {
        "cell": np.array([1, "a"], object),
        "sparse": scipy.sparse.eye(3),
        "text": "words",
        "none": np.ones((0, 3)),
    }
    scipy.io.savemat(path, other | {"struct": {"a": np.ones(3)}, "z": np.ones((3, 3), complex), **arrays})


MAKERS = {
    "v5.mat": io.write,
    "plain.mat": lambda path, a: scipy.io.savemat(path, a),
    "v4.mat": lambda path, a: scipy.io.savemat(path, {"y": a["y"]}, format="4"),
    "v73.mat": _v73,
    "odd.mat": _odd,
    "a.npy": lambda path, a: np.save(path, a["x"]),
    "pickle.npy": lambda path, a: np.save(path, np.array([None, {}]), allow_pickle=True),
    "records.npy": lambda path, a: np.save(path, np.zeros((4, 4), "f4,i2")),
    "a.npz": io.write,
    "stored.npz": lambda path, a: np.savez(path, allow_pickle=False, **a),
    "a.h5": io.write,
    "plain.hdf5": lambda path, a: _h5(path, a),
    "a.tif": lambda path, a: io.write(path, a["x"]),
    "float.tiff": lambda path, a: io.write(path, a["y"].astype(float)),
    "packed.tif": lambda path, a: tifffile.imwrite(path, a["x"][0], compression="zlib", photometric="minisblack"),
    "tiles.tif": lambda path, a: tifffile.imwrite(path, a["x"][0, 0], tile=(16, 16)),
    "a.png": lambda path, a: io.write(path, a["x"][0, 0]),
    "palette.png": lambda path, a: imageio.v3.imwrite(path, a["x"][0, 0] // 64, mode="P"),
    "deep.png": lambda path, a: io.write(path, (257 * a["y"]).astype(np.uint16)),
    "a.mp4": lambda path, a: io.write(path, a["x"][0]),
    "a.avi": lambda path, a: io.write(path, a["x"][0]),
    "a.gif": lambda path, a: io.write(path, a["x"][0]),
    "a.mov": lambda path, a: io.write(path, a["x"][0]),
    "result.npz": _result,
    "result.h5": _result,
}
SUFFIXES = sorted({name[name.index(".") :] for name in MAKERS} | {".MAT", ".doc", "", ".mkv"})
FILMS = {".mp4", ".avi", ".gif", ".mov", ".mkv"}  # ffmpeg needs a process for each


def _h5(path, arrays):
    with h5py.File(path, "w") as file:
        for key, array in arrays.items():
            file[f"group/{key}"] = array
        file["link"] = h5py.SoftLink("/group/y")
        file["lost"] = h5py.SoftLink("/nowhere")
        file["far"] = h5py.ExternalLink("nowhere.h5", "/x")
        file["text"], file["nothing"] = "words", h5py.Empty("f4")


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory):
    """A folder with an intact file of every kind."""
    folder = tmp_path_factory.mktemp("whole")
    for name, make in MAKERS.items():
        make(folder / name, _scene())
    return folder


@st.composite
def damages(draw):
    """What happens to the bytes of a file, one thing after the other."""
    place = st.floats(0, 1, exclude_max=True) | st.floats(0, 0.1) | st.integers(0, 700)
    kind = st.sampled_from(["flip", "flip", "flip", "cut", "replace", "remove", "double", "append", "front", "empty"])
    filling = st.sampled_from([b"\0", b"\xff", b"\x7f\xff", b"\x80"]) | st.binary(min_size=1, max_size=8)
    return draw(st.lists(st.tuples(kind, place, st.integers(1, 64), filling), max_size=4))


def damaged(content, damage):
    for kind, place, length, filling in damage:
        at = min(place if isinstance(place, int) else int(place * len(content)), len(content))
        before, hit, after = content[:at], content[at : at + length], content[at + length :]
        content = {
            "flip": before + bytes(byte ^ (filling[0] or 1) for byte in hit[:1]) + hit[1:] + after,
            "cut": before,
            "replace": before + (filling * len(hit))[: len(hit)] + after,
            "remove": before + after,
            "double": before + hit + hit + after,
            "append": content + filling * length,
            "front": filling * length + content,
            "empty": b"",
        }[kind]
    return content


def check_read(path, reader, **arguments):
    """A clear error that names the file, or arrays as the reader promises them, without much memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        out = reader(path, **arguments)
    except (InputError, InputTypeError, OSError) as error:
        assert path.name in str(error) or arguments  # noqa: PT017
        return
    finally:
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20  # KiB
    if reader is io.describe:
        assert all(entry.shape and entry.meaning for entry in out)
        return
    if reader is load:
        assert out.x.ndim in (4, 5)
        assert out.x.dtype.kind == "f"
        assert isinstance(out.settings, dict)
        assert isinstance(out.scenes, list)
        assert repr(out)
        return
    assert out.size > 0
    assert out.dtype.kind in "biuf"
    assert out.flags.c_contiguous
    assert out.ndim in {io.read_measurement: (2, 3), io.read: range(65)}.get(reader, (4,))


@share(0.3)
@given(
    st.sampled_from(sorted(name for name in MAKERS if not FILMS & set(os.path.splitext(name)))),
    damages(),
    st.none() | st.none() | st.sampled_from(SUFFIXES),
    st.sampled_from(READERS),
)
def test_damaged_files(whole_files, name, damage, suffix, reader):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / (name if suffix is None else f"a{suffix}")
        path.write_bytes(damaged((whole_files / name).read_bytes(), damage))
        check_read(path, reader)


@share(0.03)
@given(st.sampled_from(sorted(MAKERS)), damages(), st.sampled_from(sorted(FILMS)))
def test_damaged_films(whole_files, name, damage, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / (name if os.path.splitext(name)[1] in FILMS else f"a{suffix}")
        path.write_bytes(damaged((whole_files / name).read_bytes(), damage))
        check_read(path, io.read_video)


@share(0.02)
@given(st.lists(st.tuples(st.sampled_from(["a.png", "deep.png", "palette.png", "a.npy"]), damages()), max_size=4))
def test_damaged_folders(whole_files, files):
    with tempfile.TemporaryDirectory() as folder:
        for n, (name, damage) in enumerate(files):
            (pathlib.Path(folder) / f"{n}.png").write_bytes(damaged((whole_files / name).read_bytes(), damage[:1]))
        check_read(pathlib.Path(folder), io.read)


@share(0.02)
@given(
    st.sampled_from(["a.npy", "a.npz", "v73.mat"]),
    st.sampled_from(READERS[:4]),
    st.sampled_from(["views", "key"]),
    st.sampled_from(sorted(JUNK)) | st.integers(-1, 2**70) | st.sampled_from(["x", "y", "masks"]),
)
def test_wrong_types_for_readers(whole_files, name, reader, argument, value):
    assume(argument == "key" or reader in (io.read_masks, io.read_video))
    value = JUNK.get(value, value)
    check_read(whole_files / name, reader, **{argument: value})
