"""Still scenes: PSNR with the noise that predicts held-back pixels best, and with the estimate from y alone.

PNP_SCI_DATA=DIR python benchmarks/noise_of_still.py [--prior video] [--side 96] [--seed 0]

The cases are single frames of validation clips, which masks that move see as a video: 15 scenes, each with six levels
of noise in parts of the largest y. The output is a table: PSNR from the estimate, the mean change in dB with its
standard error, the worst and the best, in how many scenes the noise was lowered, and the median ratio of seconds.
"""

import time
from contextlib import nullcontext
from unittest import mock

import click
import numpy as np
import parts

import pnp_sci
from pnp_sci.pipeline import measurement

SETUPS = {(1, 8): 5, (2, 10): 5, (1, 16): 2, (3, 6): 3}  # (views, frames): number of cases
NOISES = 0.0, 0.002, 0.005, 0.01, 0.02, 0.05


def solved(context, y, masks, truth, prior):
    """PSNR in dB, seconds, and the noise that was told."""
    model = pnp_sci.SceneModel((True,) * len(truth), still=True)
    began = time.perf_counter()
    with context:
        result = pnp_sci.solve(y, masks, prior, scene=model)
    seconds = time.perf_counter() - began
    return float(np.mean(pnp_sci.psnr(result.x, truth))), seconds, result.settings["noise"][0]


@click.command()
@click.option("--prior", default="video", show_default=True)
@click.option("--side", default=96, show_default=True, help="Of the crops, in pixels.")
@click.option("--seed", default=0, show_default=True, help="Of the first case.")
def main(prior, side, seed):
    clips = parts.validation_clips()
    print("| noise | PSNR before (dB) | change | worst | best | lowered in | time |\n|---|---|---|---|---|---|---|")
    with mock.patch.multiple(parts, SIZE=side, SETUPS=SETUPS):
        cases = [
            (truth[:, :1].repeat(truth.shape[1], 1), masks) for truth, masks, _ in parts.cases(clips, (0.0,), seed)
        ]
    for noise in NOISES:
        pairs = []
        for n, (truth, masks) in enumerate(cases):
            y = pnp_sci.simulate(truth, masks, noise, seed=n)
            if noise == NOISES[0] and n == 0:
                solved(nullcontext(), y, masks, truth, prior)  # loads and compiles
            pair = {}
            for old in (True, False) if n % 2 else (False, True):
                patch = mock.patch.object(measurement, "noise_of_still", lambda problems, *_: problems)
                pair[old] = solved(patch if old else nullcontext(), y, masks, truth, prior)
            pairs.append((pair[True], pair[False]))
        before, after = np.array(pairs).transpose(1, 2, 0)
        change = after[0] - before[0]
        error = change.std(ddof=1) / np.sqrt(len(change))
        print(
            f"| {noise:g} | {before[0].mean():.2f} | {change.mean():+.2f} ± {error:.2f} | {change.min():+.2f} "
            f"| {change.max():+.2f} | {np.sum(after[2] < before[2])} of {len(change)} "
            f"| {np.median(after[1] / before[1]):.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
