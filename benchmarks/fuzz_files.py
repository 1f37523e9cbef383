"""Files with one byte changed: every one is read, or refused with a FormatError; nothing crashes or hangs.

    python benchmarks/fuzz_files.py [COUNT] [SEED]

Prints, for each kind of file, how many of COUNT were read and refused, and the slowest. Any other exception ends it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.io

from pnp_sci import Result, io
from pnp_sci.errors import FormatError
from pnp_sci.results.history import History, Record, Status


def originals(folder: Path) -> dict[str, Path]:
    """One small file of each kind."""
    rng = np.random.default_rng(0)
    y, masks = rng.random((8, 8)), rng.random((2, 3, 8, 8)) < 0.5
    paths = {name: folder / file for name, file in {"HDF5": "a.h5", "result in HDF5": "r.h5", "NPZ": "a.npz"}.items()}
    io.write(paths["HDF5"], {"meas": y, "mask": masks})
    io.write(paths["NPZ"], {"meas": y, "mask": masks})
    record = Record(1, 0.1, 0.2, 0.3)
    Result(np.ones((1, 1, 4, 4)), Status.CONVERGED, History([record]), {"prior": "tv"}).save(paths["result in HDF5"])
    cell = np.array([1.0, "words"], object)
    for compressed in (False, True):
        name = f"MAT{', compressed' * compressed}"
        paths[name] = folder / f"{name}.mat"
        content = {"meas": y, "mask": masks.astype("u1"), "words": "text", "data": {"a": y}, "cell": cell}
        scipy.io.savemat(paths[name], content, do_compression=compressed)
    return paths


def main(count: str = "1000", seed: str = "0") -> None:
    """Change bytes, and read."""
    rng = np.random.default_rng(int(seed))
    with tempfile.TemporaryDirectory() as folder:
        for name, path in originals(Path(folder)).items():
            whole, target, refused, slowest = path.read_bytes(), Path(folder) / f"x{path.suffix}", 0, 0.0
            for _ in range(int(count)):
                content = bytearray(whole)
                content[rng.integers(len(content))] = rng.integers(256)
                target.write_bytes(content)
                began = time.perf_counter()
                try:
                    (Result.load if name.startswith("result") else io.describe)(target)
                except FormatError:
                    refused += 1
                slowest = max(slowest, time.perf_counter() - began)
            print(f"{name}: {int(count) - refused} read, {refused} refused, {slowest:.1f} s at most", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
