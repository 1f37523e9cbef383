"""What a noise that prediction bounds gains in scenes whose estimate is mostly texture or flicker.

python benchmarks/unseen_pixels.py [--prior video] [--side 96]
"""

import click
import numpy as np
from scipy.ndimage import gaussian_filter

import pnp_sci

FRAMES = 8
NOISES = (0.0, 0.005, 0.02)  # of the largest y
FLICKER = (1, 0.5, 0.9, 0.4, 0.8, 0.6, 1, 0.5)


def smoothed(side, width, seed):
    picture = gaussian_filter(np.random.default_rng(seed).random((side, side + FRAMES)), width)
    return (picture - picture.min()) / np.ptp(picture)


def scenes(side):
    """Names and videos (1, B, H, W)."""
    for seed in range(3):
        picture = smoothed(side, 1.5, seed)
        yield "texture that pans", [picture[:, b : b + side] for b in range(FRAMES)]
    for seed in range(3):
        yield "smooth picture that flickers", [level * smoothed(side, 4, seed)[:, :side] for level in FLICKER]
    for period in (8, 12, 15):
        phases = 2 * np.pi * (np.arange(side) + 0.7 * np.arange(FRAMES)[:, None]) / period
        yield "grating that drifts", [np.tile(0.5 + 0.4 * np.sin(row), (side, 1)) for row in phases]


@click.command()
@click.option("--prior", default="video", show_default=True)
@click.option("--side", default=96, show_default=True)
def main(prior, side):
    print("| scene | noise | estimate | told | PSNR with the estimate (dB) | auto | with the true noise |")
    print("|---" * 7 + "|")
    rows = {}
    for n, (name, frames) in enumerate(scenes(side)):
        truth = np.array(frames, np.float32)[None]
        masks = pnp_sci.random_masks(truth.shape, seed=n)
        top = float(pnp_sci.simulate(truth, masks).max())
        for noise in NOISES:
            y = pnp_sci.simulate(truth, masks, noise, seed=n)
            estimate = pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)
            results = [pnp_sci.solve(y, masks, prior, noise=told) for told in (estimate, "auto", noise * top)]
            levels = [estimate / top, results[1].settings["noise"][0] / top]
            rows.setdefault((name, noise), []).append(
                levels + [float(pnp_sci.psnr(result.x, truth)[0]) for result in results]
            )
    for (name, noise), values in rows.items():
        estimate, told, *psnr = np.mean(values, 0)
        print(f"| {name} | {noise:g} | {estimate:.4f} | {told:.4f} | " + " | ".join(f"{p:.1f}" for p in psnr) + " |")


if __name__ == "__main__":
    main()
