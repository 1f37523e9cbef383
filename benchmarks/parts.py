"""What each part of the reconstruction gains: PSNR without it minus PSNR with it, on 20 cases of validation clips.

PNP_SCI_DATA=DIR python benchmarks/parts.py [PART ...]

The cases are crops of 128 x 128 pixels of clips that are not in the training set. Half are two views of 10 frames, the
others have other numbers of views and frames, and five have noise. The output is a table: the mean change and the worst
and best in dB, the number of cases in which the part gains, and the ratio of seconds, without to with the part.
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
from priors.both import Both
from priors.networks import along_motion
from priors.session import TUNED as SESSION
from priors.video import Video

SIZE = 128
# (views, frames, noise of max(y)): number of cases
SETUPS = {
    (2, 10, 0.0): 7, (2, 10, 0.02): 2, (2, 10, 0.08): 1, (2, 6, 0.0): 2, (2, 14, 0.0): 2,
    (1, 8, 0.0): 3, (1, 8, 0.02): 1, (1, 8, 0.08): 1, (1, 16, 0.0): 1,
}  # fmt: skip


def cases():
    """Truth (V, B, 128, 128), masks and y of each case; the clips follow each other in a circle."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = itertools.cycle([c.frames for c in held_out if len(c.frames) >= 16 and min(c.frames.shape[1:]) >= SIZE])
    for seed, (views, frames, noise) in enumerate(s for s, count in SETUPS.items() for _ in range(count)):
        truth = np.stack([crop(next(clips), frames, seed) for _ in range(views)])
        masks = pnp_sci.moving_masks(truth.shape, seed=seed)
        yield truth, masks, pnp_sci.simulate(truth, masks, noise, seed=seed)


def crop(clip, frames, seed):
    """Frames of a random square of a clip, (frames, 128, 128) in [0, 1]."""
    random = np.random.default_rng(seed)
    first, top, left = (int(random.integers(n - m + 1)) for n, m in zip(clip.shape, (frames, SIZE, SIZE)))
    return clip[first : first + frames, top : top + SIZE, left : left + SIZE] / np.float32(255)


@contextmanager
def without_demand():
    before = SESSION.demand
    object.__setattr__(SESSION, "demand", 1e9)
    try:
        yield
    finally:
        object.__setattr__(SESSION, "demand", before)


def without_averaging():
    return mock.patch.object(RunningMean, "__call__", lambda _, state, averages: state)


@contextmanager
def without_finish():
    unchanged = {"finished": lambda x, *_: x}
    with mock.patch.multiple(along_motion, **unchanged), mock.patch.multiple(flow, **unchanged):
        yield


def without_flow():
    return mock.patch.object(Both, "_serving", lambda both, _: Video(both.weights, both.device, both.first))


def without_share():
    return mock.patch.object(measurement, "blended", lambda _, x, decoded: (x, [0.0] * len(x)))


# part: what leaves it out, prior, effort
PARTS = {
    "flow beside video": (
        lambda: mock.patch.object(Both, "_serving", lambda b, _: Video(b.weights, b.device, b.first)),
        "both",
        "best",
    ),
    "averaging of iterates, video": (without_averaging, "video", "balanced"),
    "averaging of iterates, flow": (without_averaging, "flow", "balanced"),
    "finish along the motion, video": (without_finish, "video", "balanced"),
    "finish along the motion, flow": (without_finish, "flow", "balanced"),
    "decoder's share": (without_share, "video", "balanced"),
    "bound on what is new": (without_demand, "video", "balanced"),
}


def solved(context, prior, effort, truth, masks, y):
    """PSNR in dB and seconds of a solve within a context."""
    began = time.perf_counter()
    with context():
        result = pnp_sci.solve(y, masks, prior, effort=effort, scene="full")
    return float(np.mean(pnp_sci.psnr(result.x, truth))), time.perf_counter() - began


def main(*names):
    measured = list(cases())
    print("| part | change without it (dB) | worst | best | gains in | seconds without it |\n|---|---|---|---|---|---|")
    for name in names or PARTS:
        without, *how = PARTS[name]
        pairs = np.array([[solved(c, *how, *case) for c in (without, nullcontext)] for case in measured])
        change = pairs[:, 0, 0] - pairs[:, 1, 0]
        seconds = np.median(pairs[:, 0, 1] / pairs[:, 1, 1])
        gains = f"{np.sum(change < 0)} of {len(change)}"
        print(
            f"| {name} | {change.mean():+.3f} | {change.min():+.2f} | {change.max():+.2f} | {gains} | {seconds:.2f} |"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
