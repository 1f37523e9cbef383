"""What the unit of a scene gains where its brightest parts are small, or in one dim view: PSNR without it and with it.

python benchmarks/bright_parts.py [--prior video] [--side 64]
"""

from unittest import mock

import click
import numpy as np

import pnp_sci
from pnp_sci.pipeline import solve

SEEDS = range(6)


def particles(side, frames, seed):
    """Points of light that move steadily in the dark, (B, H, W)."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:side, :side]
    video = np.zeros((frames, side, side), np.float32)
    for _ in range(random.integers(3, 20)):
        place, speed = random.uniform(0, side, 2), random.uniform(-3, 3, 2)
        width, level = random.uniform(1, 3), random.uniform(0.3, 1)
        for b in range(frames):
            i, j = place + b * speed
            video[b] += level * np.exp(-((rows - i) ** 2 + (columns - j) ** 2) / (2 * width**2))
    return video.clip(0, 1)


def scenes(side, seed):
    """Names and videos (V, B, H, W)."""
    usual = pnp_sci.datasets.embedded_scene(side).truth
    yield "particles", particles(side, 10, seed)[None]
    yield "particles beside a usual view", np.stack([particles(side, 10, seed), usual[1]])
    yield "a usual view that is 0.1 as bright", usual * np.float32([[[[0.1]]], [[[1]]]])
    yield "usual views", usual


@click.command()
@click.option("--prior", default="video", show_default=True)
@click.option("--side", default=64, show_default=True)
def main(prior, side):
    print(f"| scene | `{prior}` without (dB) | with (dB) |\n" + "|---" * 3 + "|")
    rows = {}
    for seed in SEEDS:
        for name, truth in scenes(side, seed):
            masks = pnp_sci.random_masks(truth.shape, seed=seed)
            y = pnp_sci.simulate(truth, masks, 0.003, seed=seed)
            with mock.patch.object(solve, "in_unit_of_scene", lambda problems, until: list(problems)):
                before = pnp_sci.solve(y, masks, prior)
            after = pnp_sci.solve(y, masks, prior)
            rows.setdefault(name, []).append([pnp_sci.psnr(result.x, truth).mean() for result in (before, after)])
    for name, values in rows.items():
        print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in np.mean(values, 0)) + " |")


if __name__ == "__main__":
    main()
