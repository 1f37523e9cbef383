"""Priors as denoisers: PSNR against sigma on the validation clips, and milliseconds per frame.

The data are the first ten frames, central 256 x 256 pixels, of clips whose scenes are not in the training set, with
white Gaussian noise. The sixth frame is scored. Non-local means and the package bm3d (``pip install bm3d``; optional)
use this frame only. The strength of TV and wavelets is the best of several for each clip and sigma.

PNP_SCI_DATA=DIR python benchmarks/denoising.py
"""

import os
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from skimage.restoration import denoise_nl_means

import pnp_sci
from pnp_sci.plugins.protocols import Prior
from pnp_sci.training.clips import load_clips, split
from priors.bm3d import BM3D
from priors.networks.along_motion import VideoNet
from priors.networks.image import ImageNet
from priors.tv import TV
from priors.wavelet import Wavelet

LEVELS = (5, 15, 25, 40)  # of 255
SCORED = 5
STRENGTHS = (0.5, 0.75, 1, 1.5, 2, 3)


def alone(denoise):
    """Apply a denoiser of single pictures to the scored frame only."""

    def run(x, sigma):
        out = x.copy()
        out[0, SCORED] = denoise(x[0, SCORED], sigma)
        return out

    return run


def ready(candidate, x):
    """A function (x, sigma): a new session of a prior, or a denoiser itself."""
    return candidate.begin(x.shape, x.dtype) if isinstance(candidate, Prior) else candidate


def non_local_means(picture, sigma):
    return denoise_nl_means(picture, patch_size=5, patch_distance=9, h=0.6 * sigma, sigma=sigma, fast_mode=True)


METHODS = {  # candidates, of which the best counts, and frames that a call denoises
    "tv, best strength": ([TV(strength=s, time=0, inner=100) for s in STRENGTHS], 10),
    "tv along time too, best": ([TV(strength=s, time=1, inner=100) for s in STRENGTHS], 10),
    "wavelet, best strength": ([Wavelet(strength=s) for s in STRENGTHS], 10),
    "bm3d": ([BM3D()], 10),
    "non-local means": ([alone(non_local_means)], 1),
    "ffdnet": ([ImageNet()], 10),
    "video": ([VideoNet()], 10),
}
if find_spec("bm3d"):
    import bm3d

    METHODS["the package bm3d"] = ([alone(bm3d.bm3d)], 1)


def main():
    clips = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))[1]
    clean = []
    for clip in clips:
        top, left = ((size - 256) // 2 for size in clip.frames.shape[1:])
        clean.append(clip.frames[None, :10, top : top + 256, left : left + 256].astype(np.float32) / 255)
    print(f"| sigma (of 255) | {' | '.join(map(str, LEVELS))} | ms a frame |\n|---|{'---|' * (len(LEVELS) + 1)}")
    for name, (candidates, frames) in METHODS.items():
        ready(candidates[0], clean[0])(clean[0], 0.1)  # compile and load
        row, seconds = [], []
        for level in LEVELS:
            scores = []
            for x in clean:
                noise = np.random.default_rng(0).standard_normal(x.shape, np.float32)
                noisy, best = x + noise * np.float32(level / 255), -np.inf
                for candidate in candidates:
                    denoise = ready(candidate, x)
                    begin = time.perf_counter()
                    out = denoise(noisy, level / 255)
                    seconds.append((time.perf_counter() - begin) / frames)
                    best = max(best, pnp_sci.psnr(out[0, SCORED], x[0, SCORED]))
                scores.append(best)
            row.append(np.mean(scores))
        print(f"| {name} | {' | '.join(f'{s:.2f}' for s in row)} | {1000 * np.median(seconds):.0f} |", flush=True)


if __name__ == "__main__":
    main()
