"""How far noisy data should be trusted: PSNR by the balance of the noise, for numbers of frames and levels of noise.

PNP_SCI_DATA=DIR python benchmarks/noise_balance.py [--prior video] [--noise known]

The cases are crops of 96 x 96 pixels of validation clips. Each row is a number of views and frames and a noise in parts
of the largest y: the mean PSNR with the balance of the rule, and the change with a quarter, half, twice and four times
of it. `1 x 1` is one view of 8 equal frames that is modelled by one. The noise is estimated unless it is "known".
"""

from dataclasses import replace
from unittest import mock

import click
import numpy as np
from parts import crop, validation_clips

import pnp_sci
from pnp_sci.solvers import schedule

SIDE = 96
SETUPS = (1, 1), (2, 2), (1, 4), (1, 8), (2, 6), (2, 10)
NOISES = 0.0, 0.005, 0.01, 0.02, 0.05
FACTORS = 0.25, 0.5, 1.0, 2.0, 4.0
SEEDS = range(4)
STILL_FRAMES = 8


def case(clips, views, frames, seed):
    """Truth, masks and scene model."""
    chosen = [clips[(5 * seed + v) % len(clips)] for v in range(views)]
    truth = np.stack([crop(clip, frames, seed)[:, :SIDE, :SIDE] for clip in chosen])
    if frames > 1:
        return truth, pnp_sci.moving_masks(truth.shape, seed=seed), "full"
    truth = truth.repeat(STILL_FRAMES, 1)
    return truth, pnp_sci.moving_masks(truth.shape, seed=seed), pnp_sci.SceneModel((True,) * views, still=True)


def psnr(factor, prior, known, noise, seed, truth, masks, model):
    clean = pnp_sci.simulate(truth, masks)
    y = pnp_sci.simulate(truth, masks, noise, seed=seed)
    told = noise * float(clean.max()) if known else "auto"
    numbers = replace(schedule.TUNED, balance=factor * schedule.TUNED.balance)
    with mock.patch.object(schedule, "TUNED", numbers):
        x = pnp_sci.solve(y, masks, prior, scene=model, noise=told).x
    return float(np.mean(pnp_sci.psnr(x, truth)))


@click.command()
@click.option("--prior", default="video", show_default=True)
@click.option("--noise", "of", type=click.Choice(["estimated", "known"]), default="estimated", show_default=True)
def main(prior, of):
    clips = validation_clips()
    print("| views x frames | noise | PSNR (dB) | 1/4 | 1/2 | 2 | 4 |\n|---|---|---|---|---|---|---|")
    for views, frames in SETUPS:
        cases = [case(clips, views, frames, seed) for seed in SEEDS]
        for noise in NOISES:
            means = [
                np.mean([psnr(f, prior, of == "known", noise, seed, *c) for seed, c in zip(SEEDS, cases)])
                for f in FACTORS
            ]
            rule = means[FACTORS.index(1.0)]
            changes = " | ".join(f"{mean - rule:+.2f}" for f, mean in zip(FACTORS, means) if f != 1)
            print(f"| {views} x {frames} | {noise:g} | {rule:.2f} | {changes} |", flush=True)


if __name__ == "__main__":
    main()
