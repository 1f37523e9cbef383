"""What works without any extra, and what an error says where one is missing."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
APART = "napari"  # the extra that `all` leaves out: 60 packages, and it needs a desktop
OPTIONAL = ["matplotlib", "av", "h5py", "xarray", "zarr", "pooch", "jinja2", "torch", "safetensors"]
OPTIONAL += ["deepinv", "onnx", "distributed", "psutil"]
HIDE = """
import sys
from importlib.machinery import PathFinder

class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in {hidden} else super().find_spec(name, path, target)

sys.meta_path = [Finder if finder is PathFinder else finder for finder in sys.meta_path]
"""
SCENE = "import numpy as np, pnp_sci\nfrom pnp_sci import io\nscene = pnp_sci.datasets.embedded_scene(32)\n"
RESULT = SCENE + "result = pnp_sci.solve(scene.y, scene.masks, 'tv', iterations=2)\n"
BENCH = "import pnp_sci.bench; NONE = pnp_sci.bench.grid(['none'], iterations=1)"
ERROR = """
from pnp_sci.errors import MissingExtraError
try:
    {code}
except MissingExtraError as error:
    assert isinstance(error, ImportError)
    print(error)
"""
DISTRIBUTIONS = {"cv2": "opencv-python-headless", "pywt": "pywavelets", "skimage": "scikit-image", "PIL": "pillow"}
DISTRIBUTIONS["llvmlite"] = "numba"  # which brings it
WITH_TORCH = {
    "torch",
    "safetensors",
    "deepinv",
    "onnx",
    "onnxscript",
}  # of plugins: the registry names the extra


def without(hidden, code, folder):
    """What a fresh interpreter prints that does not find these modules."""
    done = subprocess.run(
        [sys.executable, "-c", HIDE.format(hidden=set(hidden)) + code], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def extras():
    """Names of the extras, and the distributions of each; those of the hard dependencies are under ""."""
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = {"": project["dependencies"], **project["optional-dependencies"]}
    return {name: {re.match(r"[\w-]+", line)[0].lower() for line in lines} for name, lines in listed.items()}


@pytest.mark.parametrize(
    ("package", "code", "extra"),
    [
        ("matplotlib", "result.plot()", "plot"),
        ("matplotlib", "pnp_sci.plot.plot_history(result)", "plot"),
        ("matplotlib", "from pnp_sci.bench import draw; draw('curves.svg', {})", "plot"),
        ("av", "result.export('views.mp4')", "video"),
        ("av", "io.write_video('views.gif', result.x[0] * 0)", "video"),
        ("av", "open('views.avi', 'wb').close(); io.read_video('views.avi')", "video"),
        ("h5py", "io.write('views.h5', result.x)", "hdf5"),
        ("h5py", "open('views.h5', 'wb').close(); io.read('views.h5')", "hdf5"),
        ("h5py", "result.save('result.h5')", "hdf5"),
        ("h5py", "open('result.h5', 'wb').close(); pnp_sci.Result.load('result.h5')", "hdf5"),
        ("xarray", "result.to_xarray()", "xarray"),
        ("zarr", "result.save('result.zarr')", "zarr"),
        ("pooch", "pnp_sci.datasets.singleview('runner')", "data"),
        ("pooch", "pnp_sci.datasets.available()", "data"),
        ("distributed", "pnp_sci.reconstruct(scene.y, scene.masks)", "cluster"),
        ("zarr", "pnp_sci.reconstruct(scene.y, scene.masks)", "cluster"),
        ("jinja2", "pnp_sci.bench.compare(scene.y, scene.masks, NONE).save_html('report.html')", "report"),
    ],
)
def test_the_error_names_the_package_and_the_extra(package, code, extra, tmp_path, monkeypatch):
    monkeypatch.delenv("PNP_SCI_DATA", raising=False)
    printed = without([package], RESULT + BENCH + ERROR.format(code=code), tmp_path)
    assert re.fullmatch(
        rf'.+ needs {package}: python -m pip install "\.\[{extra}\]" in the folder of the sources\n', printed
    )
    assert extra in extras()


def test_solving_and_looking_need_no_extra(tmp_path):
    code = SCENE + (
        "for prior in ('tv', 'wavelet', 'bm3d', 'flow', 'desci', 'auto', 'none'):\n"
        "    result = pnp_sci.solve(scene.y, scene.masks, prior, reference=scene.truth, iterations=3)\n"
        "    assert np.isfinite(result.x).all() and result.history[-1].ssim is not None\n"
        "assert pnp_sci.citations(result)\n"
        "result.save('result.npz'); assert (pnp_sci.Result.load('result.npz').x == result.x).all()\n"
        "for name in ('views.png', 'views.tif'): result.export(name)\n"
        "for name in ('a.mat', 'a.npy', 'a.npz', 'a.tif'):\n"
        "    io.write(name, {'x': result.x} if name[-1] in 'tz' else result.x)\n"
        "    assert (io.read(name) == result.x).all()\n"
        "assert '<table>' in result._repr_html_() and 'image/gif' in result._repr_html_()\n"
        "print('done')"
    )
    assert without(OPTIONAL, code, tmp_path) == "done\n"


def test_a_mat_file_of_version_7_3_asks_for_h5py(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        file["mask"] = [[1.0]]
    printed = without(["h5py"], SCENE + ERROR.format(code="io.read('new.mat')"), tmp_path)
    assert "MAT-files v7.3" in printed
    assert '".[hdf5]"' in printed


def test_local_data_need_no_download(tmp_path, data):
    code = "import pnp_sci; print(pnp_sci.datasets.dualview('bear_blackswan'))"
    assert "bear_blackswan" in without(["pooch"], code, tmp_path)


def test_the_demo_says_what_it_leaves_out(tmp_path):
    code = "from pnp_sci.cli.main import main; main(['demo', '--size', '32', '--prior', 'tv'])"
    printed = without(["av"], code, tmp_path)
    assert re.search(r'No demo\.mp4: .+ "\.\[video\]"', printed)
    assert [file.name for file in tmp_path.iterdir()] == ["demo.png"]


def imports(path):
    """Top-level names of what a file imports, and whether each is within ``needed_for``; not for type checking."""

    def walk(node, optional):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], optional) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0], optional
        inside = isinstance(node, ast.With) and "needed_for" in ast.unparse(node.items[0].context_expr)
        for child in ast.iter_child_nodes(node):
            yield from walk(child, optional or inside)

    return set(walk(ast.parse(path.read_text(encoding="utf-8")), False))


def test_every_import_is_declared():
    own, declared = {"pnp_sci", "priors", "ofanet_init"}, extras()
    known = set.union(*declared.values())
    for folder in own:
        for path in (ROOT / folder).rglob("*.py"):
            for name, optional in imports(path):
                if name in sys.stdlib_module_names or name in own or name in WITH_TORCH:
                    continue
                distribution = DISTRIBUTIONS.get(name, name.replace("_", "-")).replace("lazy-loader", "lazy_loader")
                allowed = known if optional else declared[""]
                assert distribution in allowed, f"{path.relative_to(ROOT)} imports {name}"


def test_all_holds_every_extra_for_users():
    lines = extras()
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (listed,) = re.findall(r'^all = \["pnp-sci\[([\w,]+)\]"\]', pyproject, re.M)
    assert set(listed.split(",")) == set(lines) - {"", "all", "test", "docs", APART}


def test_the_list_of_optional_packages_is_complete():
    """So that the test above hides all of them: no extra for users brings what is not in it."""
    lines = extras()
    names = set.union(*(own for extra, own in lines.items() if extra not in ("", "all", "test", "docs", APART)))
    assert {name.replace("-", "_") for name in names} - {"pnp_sci", "onnxscript"} == set(OPTIONAL)


def test_the_readme_names_every_extra():
    lines = (ROOT / "README.md").read_text(encoding="utf-8")
    for extra in set(extras()) - {"", "test", "docs"}:
        assert f"`{extra}`" in lines, extra
    assert json.dumps(".[plot,video]") in lines
