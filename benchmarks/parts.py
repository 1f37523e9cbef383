"""What parts of a reconstruction gain: PSNR without a part minus PSNR with it, on 20 cases of validation clips.

PNP_SCI_DATA=DIR python benchmarks/parts.py [PART ...]

The cases are crops of 128 x 128 pixels of clips that are not in the training set, without noise, or with noise for
parts that act with noise only. The output is a table: the mean change and the worst and best in dB, the number of cases
in which the part gains, and the ratio of seconds, without to with the part.
"""

import itertools
import os
import sys
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path
from unittest import mock

import numpy as np

import pnp_sci
from pnp_sci.pipeline import measurement
from pnp_sci.solvers.averaging import RunningMean
from pnp_sci.training.clips import load_clips, split
from priors import flow
from priors.networks import along_motion

SIZE = 128
# (views, frames): number of cases
SETUPS = {(2, 10): 10, (2, 6): 2, (2, 14): 2, (1, 8): 6}
NOISES = 0.02, 0.04, 0.06, 0.08, 0.1  # of max(y)


def cases(noises=(0.0,)):
    """Truth (V, B, 128, 128), masks and y of each case; clips and noises follow each other in a circle."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = itertools.cycle([c.frames for c in held_out if len(c.frames) >= 14 and min(c.frames.shape[1:]) >= SIZE])
    setups = [setup for setup, count in SETUPS.items() for _ in range(count)]
    for seed, ((views, frames), noise) in enumerate(zip(setups, itertools.cycle(noises))):
        truth = np.stack([crop(next(clips), frames, seed) for _ in range(views)])
        masks = pnp_sci.moving_masks(truth.shape, seed=seed)
        yield truth, masks, pnp_sci.simulate(truth, masks, noise, seed=seed)


def crop(clip, frames, seed):
    """Frames of a random square of a clip, (frames, 128, 128) in [0, 1]."""
    random = np.random.default_rng(seed)
    first, top, left = (int(random.integers(n - m + 1)) for n, m in zip(clip.shape, (frames, SIZE, SIZE)))
    return clip[first : first + frames, top : top + SIZE, left : left + SIZE] / np.float32(255)


def without_averaging():
    return mock.patch.object(RunningMean, "__call__", lambda _, state, averages: state)


@contextmanager
def without_finish():
    unchanged = {"finished": lambda x, *_: x}
    with mock.patch.multiple(along_motion, **unchanged), mock.patch.multiple(flow, **unchanged):
        yield


def without_share():
    return mock.patch.object(measurement, "blended", lambda _, x, decoded: (x, [0.0] * len(x)))


# part: what leaves it out, prior, and whether it acts with noise only
PARTS = {
    "averaging of iterates, video": (without_averaging, "video", False),
    "averaging of iterates, flow": (without_averaging, "flow", False),
    "finish along the motion, video": (without_finish, "video", False),
    "finish along the motion, flow": (without_finish, "flow", False),
    "decoder's share, with noise, video": (without_share, "video", True),
    "decoder's share, with noise, flow": (without_share, "flow", True),
}


def solved(context, prior, truth, masks, y):
    """PSNR in dB and seconds of a solve from a decoder's estimate, within a context."""
    began = time.perf_counter()
    with context():
        result = pnp_sci.solve(y, masks, prior, init="ofanet-fast", scene="full")
    return float(np.mean(pnp_sci.psnr(result.x, truth))), time.perf_counter() - began


def main(*names):
    quiet, noisy = list(cases()), list(cases(NOISES))
    print("| part | change without it (dB) | worst | best | gains in | seconds without it |\n|---|---|---|---|---|---|")
    for name in names or PARTS:
        without, prior, with_noise = PARTS[name]
        contexts = without, nullcontext
        pairs = np.array([[solved(c, prior, *case) for c in contexts] for case in (noisy if with_noise else quiet)])
        change = pairs[:, 0, 0] - pairs[:, 1, 0]
        seconds = np.median(pairs[:, 0, 1] / pairs[:, 1, 1])
        gains = f"{np.sum(change < 0)} of {len(change)}"
        print(
            f"| {name} | {change.mean():+.3f} | {change.min():+.2f} | {change.max():+.2f} | {gains} | {seconds:.2f} |"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
