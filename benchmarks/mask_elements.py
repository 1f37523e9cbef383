"""What it gains that sigma follows the masks and the number of frames: PSNR in dB, and the gain over sigma of 0.05.

PNP_SCI_DATA=DIR python benchmarks/mask_elements.py [--cases N]

Validation clips of 128 x 128 pixels with noise of 0.005 of max(y), by masks: elements of one pixel and more, one pixel
blurred by a Gaussian of 0.7 pixels, and parts of the calibrated masks of two real captures. Then the real captures
themselves, two in one measurement: the agreement with what each gives alone, with white at the 0.995 quantile of that.
"""

import argparse
from unittest import mock

import numpy as np
from parts import crop, validation_clips
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.solvers import schedule

PRIORS = ("tv", "flow", "video")
SETUPS = ((1, 8), (2, 10), (2, 14), (2, 20))


def masks_of(kind, shape, seed):
    """Masks (V, B, H, W); kind is the side of the elements, "blurred" or "real"."""
    views, frames, *picture = shape
    if kind == "real":
        given, (top, left) = pnp_sci.datasets.real_dual().masks, np.random.default_rng(seed).integers(0, 112, 2)
        return given[:views, :frames, top : top + picture[0], left : left + picture[1]]
    if kind == "blurred":
        return gaussian_filter(pnp_sci.moving_masks(shape, seed=seed).astype(np.float32), (0, 0, 0.7, 0.7))
    small = pnp_sci.moving_masks((views, frames, *(-(-n // kind) for n in picture)), seed=seed)
    return small.repeat(kind, 2).repeat(kind, 3)[:, :, : picture[0], : picture[1]]


def scenes(kind, views, frames, count):
    """Truth, masks and y of validation clips."""
    clips = validation_clips()
    for seed in range(20, 20 + count):
        truth = np.stack([crop(clips[(2 * seed + 3 * view) % len(clips)], frames, seed) for view in range(views)])
        masks = masks_of(kind, truth.shape, seed)
        yield masks, pnp_sci.simulate(truth, masks, 0.005, seed=seed), truth


def captures():
    """Two real captures in one measurement, the second of them turned; and for "truth" what each gives alone."""
    alone = {name: pnp_sci.datasets.real(name) for name in ("wheel", "hand")}
    videos = {name: pnp_sci.solve(scene.y, scene.masks, "auto").x[0] for name, scene in alone.items()}
    shift = 16
    for first, second, turn in (("wheel", "hand", 0), ("wheel", "hand", 2), ("wheel", "wheel", 2), ("hand", "hand", 2)):
        early = alone[first].y, alone[first].masks, videos[first]
        late = (np.rot90(a, turn, (-2, -1)) for a in (alone[second].y, alone[second].masks, videos[second]))
        y, masks, truth = ((a[..., :-shift, :-shift], b[..., shift:, shift:]) for a, b in zip(early, late, strict=True))
        white = [np.quantile(view, 0.995) for view in truth]
        yield np.concatenate(masks), sum(y), np.stack([np.clip(view / w, 0, 1) for view, w in zip(truth, white)]), white


def decibels(x, truth, white=1.0):
    return np.mean(pnp_sci.psnr(x / np.reshape(white, (-1, 1, 1, 1)), truth))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=4, help="clips of each kind")
    count = parser.parse_args().cases
    print(f"| masks | views x frames | {' | '.join(PRIORS)} |\n|---|---|{'---|' * len(PRIORS)}")

    def row(name, setup, cases):
        cells = []
        for prior in PRIORS:
            gains = []
            for masks, y, *rest in cases:
                ruled = pnp_sci.solve(y, masks, prior, scene="full").x
                with mock.patch.object(schedule, "element", return_value=0.0):
                    fixed = pnp_sci.solve(y, masks, prior, scene="full").x
                gains.append((decibels(ruled, *rest), decibels(fixed, *rest)))
            ruled, fixed = np.mean(gains, axis=0)
            cells.append(f"{ruled:.2f} ({ruled - fixed:+.2f})")
        print(f"| {name} | {setup} | {' | '.join(cells)} |", flush=True)

    for kind in (1, 2, 4, "blurred", "real"):
        for views, frames in SETUPS:
            if kind != "real" or frames <= 14:
                name = f"{kind} pixels" if isinstance(kind, int) else kind
                row(name, f"{views} x {frames}", list(scenes(kind, views, frames, count)))
    row("two real captures", "2 x 14", list(captures()))


if __name__ == "__main__":
    main()
