"""How true predicted errors are: root mean square error over prediction, in tenths of the pixels by prediction.

    python benchmarks/uncertainty.py FOLDER [PRIORS] [CLIPS]

FOLDER holds clips, such as those for training. Where the prediction is right, all ratios are 1.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci import io

FRAMES, SIDE, TENTHS = 8, 128, 10
CASES = ((2, 0.0), (2, 0.01), (2, 0.05), (1, 0.0), (1, 0.01))  # views, noise of y in parts of its largest value


def scenes(folder: Path, views: int, count: int) -> Iterator[np.ndarray]:
    """The middle of every so many clips, in [0, 1]."""
    files = sorted(folder.glob("*.mp4"))
    files = files[:: max(len(files) // (count * views), 1)]
    for first in range(0, count * views, views):
        films = [io.read(file)[:FRAMES] for file in files[first : first + views]]
        cuts = [tuple((n - SIDE) // 2 for n in film.shape[1:]) for film in films]
        yield np.stack([f[:, r : r + SIDE, c : c + SIDE] / 255 for f, (r, c) in zip(films, cuts)])


def ratios(predicted: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Root mean square error over predicted error of each tenth of the pixels, by prediction."""
    parts = np.array_split(np.argsort(predicted), TENTHS)
    return np.array([np.sqrt((error[p] ** 2).mean() / (predicted[p] ** 2).mean()) for p in parts])


def main(folder: str, priors: str = "tv,flow,bm3d,ffdnet,video", count: str = "5") -> None:
    """Print a row for each prior and case: tenths of the pixels of all clips, and the range over the clips."""
    from scipy.stats import spearmanr

    print("| prior | views | noise | tenths of the pixels, by prediction | clip by clip | rank correlation |")
    print("| --- " * 6 + "|")
    for prior in priors.split(","):
        for views, noise in CASES:
            pairs = []
            for seed, truth in enumerate(scenes(Path(folder), views, int(count))):
                masks = pnp_sci.random_masks(truth.shape, seed=seed)
                y = pnp_sci.simulate(truth, masks, noise=noise, seed=seed)
                result = pnp_sci.solve(y, masks, prior, uncertainty=True)
                pairs.append((result.uncertainty.ravel().astype(float), np.abs(result.x - truth).ravel()))
            predicted, error = (np.concatenate(parts) for parts in zip(*pairs))
            cells = " ".join(f"{value:.2f}" for value in ratios(predicted, error))
            clips = [np.sqrt((e**2).mean() / (p**2).mean()) for p, e in pairs]
            rank = spearmanr(predicted[::7], error[::7])[0]
            spread = f"{min(clips):.2f} to {max(clips):.2f}"
            print(f"| {prior} | {views} | {noise} | {cells} | {spread} | {rank:.2f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
