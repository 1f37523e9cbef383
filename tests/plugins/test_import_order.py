"""What else is imported, and when, does not change what pnp_sci does."""

import importlib
import importlib.metadata
import subprocess
import sys

import pytest

SOLVE = """
import pnp_sci
scene = pnp_sci.datasets.embedded_scene(32)
assert pnp_sci.solve(scene.y, scene.masks, "tv", iterations=2).status.ok
assert "total variation" in " ".join(pnp_sci.citations(pnp_sci.solve(scene.y, scene.masks, "tv", iterations=2))).lower()
"""

# what `import importlib_metadata` does, which dask imports on Python 3.10 and 3.11: entry points of another class
BACKPORT = """
import importlib.metadata as m

class EntryPoint:
    def __init__(self, point):
        self.name, self.value, self.group, self.attr = point.name, point.value, point.group, point.attr
        self._point = point

    def load(self):
        return self._point.load()

found = m.entry_points
m.entry_points = lambda **k: [EntryPoint(p) for p in found(**k)] if k else found()
"""


@pytest.mark.parametrize("before", ["", BACKPORT, "import torch", "import cv2, scipy.signal"])
def test_a_named_prior_is_found(before):
    done = subprocess.run([sys.executable, "-c", before + SOLVE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("earlier", "name"),
    [
        ("pnp_sci.judge", "view_levels"),
        ("pnp_sci.result", "Result"),
        ("pnp_sci.result", "History"),
        ("pnp_sci.weights", "read"),
    ],
)
def test_a_module_that_has_moved_is_found_with_a_warning(earlier, name):
    sys.modules.pop(earlier, None)
    with pytest.warns(DeprecationWarning, match="has moved to pnp_sci"):
        module = importlib.import_module(earlier)
    assert hasattr(module, name)


def test_other_modules_are_not_found():
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("pnp_sci.nothing")
