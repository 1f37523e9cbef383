"""Milliseconds of the network of "video" on 20 frames of 256 x 256: this package, and OpenVINO (pip install openvino).

python benchmarks/inference_engines.py [THREADS]

The calls alternate. The output is the median and range of the milliseconds, the ratio to the first row, and the root
mean square of the difference from float32 in torch.
"""

import sys
import time

import numba
import numpy as np
import openvino
import torch

from priors.networks import files
from priors.networks.image import WEIGHTS, runner

FRAMES, SIZE, AT_ONCE, LAPS = 20, 256, 4, 15


def engine(model, precision, threads):
    """A call of OpenVINO, a few frames at a time as in this package."""
    hints = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_NUM_THREADS": threads, "INFERENCE_PRECISION_HINT": precision}
    request = openvino.Core().compile_model(model.clone(), "CPU", hints).create_infer_request()

    def noise(frames, level):
        out = np.empty_like(frames)
        for start in range(0, len(frames), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            out[part] = request.infer([frames[part], level[part]], share_inputs=True, share_outputs=True)[0]
        return out

    return noise


def main(threads):
    torch.set_num_threads(threads)
    numba.set_num_threads(threads)
    network, _ = files.load(WEIGHTS / "video.safetensors", "video")
    rng = np.random.default_rng(0)
    frames, level = rng.random((FRAMES, SIZE, SIZE), np.float32), np.full((FRAMES, SIZE, SIZE), 0.1, np.float32)
    example = torch.rand(AT_ONCE, SIZE, SIZE), torch.rand(AT_ONCE, SIZE, SIZE)
    model = openvino.convert_model(network, example_input=example)
    calls = {"this package": runner("video").noise}
    calls |= {f"OpenVINO, {precision}": engine(model, precision, threads) for precision in ("bf16", "f32")}
    with torch.inference_mode():
        exact = network(torch.from_numpy(frames), torch.from_numpy(level)).numpy()
    apart = {name: np.sqrt(np.mean((call(frames, level) - exact) ** 2)) for name, call in calls.items()}
    took = {name: [] for name in calls}
    for _ in range(LAPS):
        for name, call in calls.items():
            began = time.perf_counter()
            call(frames, level)
            took[name].append(1000 * (time.perf_counter() - began))
    first = np.array(took["this package"])
    for name, own in took.items():
        ratio = np.median(np.array(own) / first)
        print(f"{name:16s} {np.median(own):4.0f} ms ({min(own):.0f} to {max(own):.0f}), {ratio:.2f}, {apart[name]:.1e}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
