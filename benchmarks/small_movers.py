"""Small movers before standing scenes: is a disc of 8 to 20 pixels erased by `scene="auto"`?

72 cases: 3 backgrounds of scikit-image of 128 x 128 pixels, 3 diameters, 2 speeds, white and black, with and without
noise of 0.01 of max(y). For each prior a line has the motion seen with the full and with the automatic scene model:
1 if what moves does so as in the truth, 0 if nothing moves there. A mover is erased if the automatic model shows less
than 0.5 of it, and the full one more.

    python benchmarks/small_movers.py [PRIOR ...]  # by default tv flow auto
"""

import sys
from itertools import product

import numpy as np
from skimage import data

import pnp_sci

SIDE, FRAMES = 128, 8
BACKGROUNDS = ("camera", "coins", "grass")
DIAMETERS, SPEEDS, LEVELS, NOISES = (8, 13, 20), (2, 5), (1.0, 0.0), (0, 0.01)  # pixels, pixels per frame


def background(name):
    """A picture of scikit-image, its upper left square reduced to SIDE, values 0.1 to 0.8."""
    picture = getattr(data, name)()
    factor = min(picture.shape[:2]) // SIDE
    square = picture[: SIDE * factor, : SIDE * factor].reshape(SIDE, factor, SIDE, factor)
    return 0.1 + 0.7 / 255 * square.mean((1, 3))


def crossing(back, diameter, speed, level, start=0.3, frames=FRAMES):
    """A disc of brightness `level` that crosses the picture from left to right, (frames, SIDE, SIDE)."""
    row, column = np.mgrid[: len(back), : len(back)] - len(back) / 2
    middles = (start - 0.5) * len(back) + speed * np.arange(frames)
    return np.stack([np.where((column - m) ** 2 + row**2 <= diameter**2 / 4, level, back) for m in middles])


def motion_seen(x, truth):
    """Correlation of what changes along time where something moves, videos (B, H, W)."""
    path = np.ptp(truth, axis=0) > 0.05
    seen, true = ((a - a.mean(0))[:, path] for a in (x, truth))
    return float((seen * true).sum() / max(np.linalg.norm(seen) * np.linalg.norm(true), 1e-12))


def both(y, masks, prior, truth):
    """Motion seen with the full and with the automatic model."""
    auto = pnp_sci.solve(y, masks, prior)
    modelled = auto.scene["frames_modelled"] == auto.scene["frames"]
    full = auto if modelled else pnp_sci.solve(y, masks, prior, scene="full")
    return motion_seen(full.x[0], truth), motion_seen(auto.x[0], truth)


def main(priors):
    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=3)
    erased, count = dict.fromkeys(priors, 0), 0
    for name, diameter, speed, level, noise in product(BACKGROUNDS, DIAMETERS, SPEEDS, LEVELS, NOISES):
        truth = crossing(background(name), diameter, speed, level)
        y = pnp_sci.simulate(truth[None], masks, noise=noise)
        seen = {prior: both(y, masks, prior, truth) for prior in priors}
        for prior, (full, auto) in seen.items():
            erased[prior] += auto < 0.5 <= full
        count += 1
        cells = ", ".join(f"{prior} {full:.2f} {auto:.2f}" for prior, (full, auto) in seen.items())
        print(f"{name:7} {diameter:2} px, {speed} a frame, level {level:.0f}, noise {noise:4}: {cells}", flush=True)
    for prior in priors:
        print(f"{prior}: {erased[prior]} of {count} movers erased")


if __name__ == "__main__":
    main(sys.argv[1:] or ["tv", "flow", "auto"])
