"""What parts of a reconstruction gain: PSNR without a part minus PSNR with it, on 20 cases of validation clips.

`true-motion` is no part: its change is what `video` gains if its motion is found in the true frames.

PNP_SCI_DATA=DIR python benchmarks/parts.py [PART ...] [--seed 20]

The cases are crops of 128 x 128 pixels of clips that are not in the training set, without noise, or with noise for
parts that act with noise only or are named so. All runs start from `ofanet-fast`. The output is a table: the mean
change in dB with its standard error, the worst and the best, the number of cases in which the part gains, and the
median ratio of seconds.
"""

import itertools
import os
import time
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from unittest import mock

import click
import numpy as np

import pnp_sci
from pnp_sci.pipeline import measurement
from pnp_sci.pipeline.unseen import Unseen
from pnp_sci.solvers import iterate
from pnp_sci.solvers.averaging import RunningMean
from pnp_sci.training.clips import load_clips, split
from priors import flow
from priors.motion import measure
from priors.networks import along_motion

SIZE = 128
# (views, frames): number of cases
SETUPS = {(2, 10): 10, (2, 6): 2, (2, 14): 2, (1, 8): 6}
QUIET = (0.0,)
FAINT = 0.005, 0.01  # of max(y)
NOISES = 0.02, 0.04, 0.06, 0.08, 0.1


def validation_clips():
    """Frames of the clips, (T, H, W) each."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    return [c.frames for c in held_out if len(c.frames) >= 14 and min(c.frames.shape[1:]) >= SIZE]


def cases(clips, noises, first=0):
    """Truth (V, B, 128, 128), masks and y of each case, by seeds from `first` on; clips and noises form circles."""
    following = itertools.cycle(clips)
    setups = [setup for setup, count in SETUPS.items() for _ in range(count)]
    for seed, ((views, frames), noise) in enumerate(zip(setups, itertools.cycle(noises)), first):
        truth = np.stack([crop(next(following), frames, seed) for _ in range(views)])
        masks = pnp_sci.moving_masks(truth.shape, seed=seed)
        yield truth, masks, pnp_sci.simulate(truth, masks, noise, seed=seed)


def crop(clip, frames, seed):
    """Frames of a random square of a clip, (frames, 128, 128) in [0, 1]."""
    random = np.random.default_rng(seed)
    first, top, left = (int(random.integers(n - m + 1)) for n, m in zip(clip.shape, (frames, SIZE, SIZE)))
    return clip[first : first + frames, top : top + SIZE, left : left + SIZE] / np.float32(255)


def without_averaging(_):
    return mock.patch.object(RunningMean, "__call__", lambda _, state, averages: state)


def unmoved(*_):
    """In the place of `displace`."""


def without_displacement(_):
    return mock.patch.object(iterate, "displace", unmoved)


@contextmanager
def without_finish(_):
    unchanged = {"finished": lambda x, *_: x}
    with mock.patch.multiple(along_motion, **unchanged), mock.patch.multiple(flow, **unchanged):
        yield


def without_credit(_):
    return mock.patch.object(measure, "credit", lambda mean, *_: np.ones_like(mean))


def with_three_neighbours(_):
    return mock.patch.object(along_motion, "MOTION", replace(measure.TUNED, neighbours=3))


def without_share(_):
    return mock.patch.object(measurement, "blended", lambda _, x, decoded: (x, [0.0] * len(x)))


def with_true_motion(truth):
    see = along_motion.see

    def true(x, _):
        return truth * np.float32(np.vdot(x, truth) / np.vdot(truth, truth))  # in the units of the estimate x

    return mock.patch.object(along_motion, "see", lambda _, x, *rest: see(true, x, *rest))


def without_lower_noise(_):
    return mock.patch.object(Unseen, "__call__", lambda _, schedule, state: schedule)


# part: what leaves it out (or puts the truth in), prior, and noises of max(y)
PARTS = {
    "averaging-video": (without_averaging, "video", QUIET),
    "averaging-flow": (without_averaging, "flow", QUIET),
    "credit-video": (without_credit, "video", QUIET),
    "credit-flow": (without_credit, "flow", QUIET),
    "credit-video-noise": (without_credit, "video", NOISES),
    "displacement-video": (without_displacement, "video", QUIET),
    "displacement-flow": (without_displacement, "flow", QUIET),
    "displacement-video-noise": (without_displacement, "video", NOISES),
    "displacement-flow-noise": (without_displacement, "flow", NOISES),
    "fourth-neighbour": (with_three_neighbours, "video", QUIET),
    "finish-video": (without_finish, "video", QUIET),
    "finish-flow": (without_finish, "flow", QUIET),
    "true-motion": (with_true_motion, "video", QUIET),
    "lower-noise-video": (without_lower_noise, "video", QUIET),
    "lower-noise-video-faint": (without_lower_noise, "video", FAINT),
    "lower-noise-flow": (without_lower_noise, "flow", QUIET),
    "lower-noise-flow-faint": (without_lower_noise, "flow", FAINT),
    "share-video": (without_share, "video", NOISES),
    "share-flow": (without_share, "flow", NOISES),
}


def solved(context, prior, truth, masks, y):
    """PSNR in dB and seconds of a solve within a context."""
    began = time.perf_counter()
    with context(truth):
        result = pnp_sci.solve(y, masks, prior, init="ofanet-fast", scene="full")
    return float(np.mean(pnp_sci.psnr(result.x, truth))), time.perf_counter() - began


@click.command()
@click.argument("names", metavar="[PART]...", nargs=-1, type=click.Choice(sorted(PARTS)))
@click.option("--seed", default=0, show_default=True, help="Of the first case; 20 or more for other cases.")
def main(names, seed):
    clips = validation_clips()
    print(
        "| part | change without it (dB) | worst | best | gains in | time without / with |\n|---|---|---|---|---|---|"
    )
    for name in names or PARTS:
        without, prior, noises = PARTS[name]
        contexts, pairs = (without, nullcontext), []
        for n, case in enumerate(cases(clips, noises, seed)):
            if n == 0:
                solved(nullcontext, prior, *case)  # loads and compiles
            order = (0, 1) if n % 2 else (1, 0)
            pair = {k: solved(contexts[k], prior, *case) for k in order}
            pairs.append((pair[0], pair[1]))
        values = np.array(pairs)
        change = values[:, 0, 0] - values[:, 1, 0]
        mean, error = change.mean(), change.std(ddof=1) / np.sqrt(len(change))
        seconds = np.median(values[:, 0, 1] / values[:, 1, 1])
        cells = f"{mean:+.3f} ± {error:.3f}", f"{change.min():+.2f}", f"{change.max():+.2f}"
        print(f"| {name} | {' | '.join(cells)} | {np.sum(change < 0)} of {len(change)} | {seconds:.2f} |", flush=True)


if __name__ == "__main__":
    main()
