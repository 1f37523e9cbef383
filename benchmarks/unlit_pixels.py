"""PSNR in dB beside a stop, through sparse masks and in light that flickers, on validation clips.

PNP_SCI_DATA=DIR python benchmarks/unlit_pixels.py [--side 96]

Mean of four cases of two views of 8 frames each. `y` is 0 in pixels that no mask opens to; photon noise is that of 100
electrons a pixel on average, Gaussian noise in parts of the largest y. Only lit pixels count.
"""

import click
import numpy as np
from parts import crop, validation_clips

import pnp_sci

FRAMES = 8
LIGHTS = {"strobed": (1, 0.3), "mains": (1.1, 0.9)}  # of frames in turn
SCENES = (
    "usual",
    "circle",
    "leaking circle",
    "borders",
    "block",
    "sparse, random",
    "sparse, moving",
    "strobed",
    "mains",
)
NOISES = 0.0, 0.01, "photon"


def case(name, clips, seed, side):
    """Truth, masks (2, 8, side, side) and the lit pixels (side, side)."""
    truth = np.stack([crop(clips[(3 * seed + v) % len(clips)], FRAMES, seed)[:, :side, :side] for v in range(2)])
    lit, leak = np.ones((side, side), bool), 0.0
    if "circle" in name:
        lit = np.sum((np.indices(lit.shape) - side / 2) ** 2, 0) < (0.47 * side) ** 2
        leak = 0.002 if "leaking" in name else 0.0
    elif name == "borders":
        lit = np.pad(lit[12:-12, 12:-12], 12)
    elif name == "block":
        lit[side // 4 : side // 2, side // 3 : 2 * side // 3] = False
    density, sort = (0.05, name.split()[-1]) if "sparse" in name else (0.5, "moving")
    masks = getattr(pnp_sci, f"{sort}_masks")(truth.shape, density, seed=seed) * np.where(lit, 1, leak)
    light = np.resize(LIGHTS.get(name, 1), FRAMES)[:, None, None]
    return truth * light, masks.astype(np.float32), lit


def measured(truth, masks, noise, seed):
    """A measurement without negative values, 0 where no mask opens."""
    random, clean = np.random.default_rng(seed), pnp_sci.simulate(truth, masks)
    if noise == "photon":
        electron = clean.mean() / 100
        return random.poisson(clean / electron) * electron
    y = np.maximum(clean + noise * clean.max() * random.standard_normal(clean.shape), 0)
    return y * (masks.max((0, 1)) > 0)


@click.command()
@click.option("--side", default=96, show_default=True)
def main(side):
    clips = validation_clips()
    print("| scene | noise | ofanet-fast alone | video | video from adjoint | tv |\n" + "|---" * 6 + "|")
    for name in SCENES:
        for noise in NOISES:
            rows = []
            for seed in range(4):
                truth, masks, lit = case(name, clips, seed, side)
                y = measured(truth, masks, noise, seed)
                results = [pnp_sci.decode(y, masks, "ofanet-fast"), pnp_sci.solve(y, masks, "video")]
                results += [pnp_sci.solve(y, masks, "video", init="adjoint"), pnp_sci.solve(y, masks, "tv")]
                rows.append([-10 * np.log10(np.mean((r.x - truth)[..., lit] ** 2)) for r in results])
            print(f"| {name} | {noise} | " + " | ".join(f"{p:.1f}" for p in np.mean(rows, 0)) + " |", flush=True)


if __name__ == "__main__":
    main()
