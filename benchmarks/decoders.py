"""The learned decoders side by side: PSNR in dB, seconds, and a solver from each within the same time.

PNP_SCI_DATA=DIR python benchmarks/decoders.py

The scenes are pairs of validation clips and the dual-view pairs at hand. The decoders alternate; seconds are medians.
The last columns are the prior "video" from the decoder's estimate, the decoder included, within a time budget. A dash:
there was no time for the decoder.
"""

import os
import statistics
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.bench.cases import Case
from pnp_sci.errors import DataUnavailableError
from pnp_sci.training.clips import load_clips, split

DECODERS = ("ofanet-fast", "ofanet", "unet", "admm-net", "birnat")
BUDGETS = (2.0, 5.0)  # seconds
SIZE, FRAMES = 256, 10


def of_clips():
    """Pairs of validation clips, measured through moving masks: (truth, masks, y) each."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = [c.frames for c in held_out if len(c.frames) >= FRAMES and min(c.frames.shape[1:]) >= SIZE]
    masks = pnp_sci.moving_masks((2, FRAMES, SIZE, SIZE), seed=1)
    for first, second in zip(clips[::2], clips[1::2]):
        truth = np.stack([_middle(first), _middle(second)])
        yield truth, masks, pnp_sci.simulate(truth, masks)


def of_pairs():
    """The dual-view pairs whose files are here."""
    for name in pnp_sci.datasets.DUAL_VIEW_PAIRS:
        try:
            scene = Case(name).load()
        except DataUnavailableError:
            continue
        yield scene.truth, scene.masks, scene.y


def _middle(frames):
    top, left = ((n - SIZE) // 2 for n in frames.shape[1:])
    return frames[:FRAMES, top : top + SIZE, left : left + SIZE] / np.float32(255)


def main():
    scenes = {"validation clips": list(of_clips()), "pairs": list(of_pairs())}
    budgets = [f"within {b:g} s" for b in BUDGETS]
    for name, cases in scenes.items():
        scores = {decoder: [] for decoder in DECODERS}
        seconds = {decoder: [] for decoder in DECODERS}
        for truth, masks, y in cases:
            for decoder in DECODERS:
                results = [pnp_sci.decode(y, masks, model=decoder)]
                results += [pnp_sci.solve(y, masks, "video", init=decoder, time_budget=b) for b in BUDGETS]
                from_it = [True, *(result.settings["init"] == decoder for result in results[1:])]
                psnr = [np.mean(pnp_sci.psnr(result.x, truth)) for result in results]
                scores[decoder].append(np.where(from_it, psnr, np.nan))
                seconds[decoder].append(results[0].settings["seconds"])
        print(f"\n| {name} ({len(cases)}) | PSNR | seconds | {' | '.join(budgets)} |")
        print(f"|---|---|---|{'---|' * len(BUDGETS)}")
        for decoder in DECODERS:
            alone, *later = np.mean(scores[decoder], 0)
            cells = [f"{alone:.2f}", f"{statistics.median(seconds[decoder]):.2g}"]
            cells += ["-" if np.isnan(value) else f"{value:.2f}" for value in later]
            print(f"| `{decoder}` | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
