"""How true predicted errors are: root mean square error over prediction, in tenths of the pixels by prediction.

    python benchmarks/uncertainty.py FOLDER [PRIORS] [CLIPS]

FOLDER holds clips, such as those for training. Where the prediction is right, all numbers are 1. The last column is
the rank correlation of prediction and error.
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


def ratios(result: pnp_sci.Result, truth: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Of each tenth; of all pixels; rank correlation."""
    from scipy.stats import spearmanr

    predicted, error = result.uncertainty.ravel().astype(float), np.abs(result.x - truth).ravel()
    parts = np.array_split(np.argsort(predicted), TENTHS)
    of_tenths = [np.sqrt((error[p] ** 2).mean() / (predicted[p] ** 2).mean()) for p in parts]
    return (
        np.array(of_tenths),
        float(np.sqrt((error**2).mean() / (predicted**2).mean())),
        spearmanr(predicted, error)[0],
    )


def main(folder: str, priors: str = "tv,flow,bm3d,ffdnet,video", count: str = "5") -> None:
    """Print a row for each prior and case: medians over the clips."""
    print("| prior | views | noise | tenths of the pixels, by prediction | all | within 25 % | rank |")
    print("| --- " * 7 + "|")
    for prior in priors.split(","):
        for views, noise in CASES:
            found = []
            for seed, truth in enumerate(scenes(Path(folder), views, int(count))):
                masks = pnp_sci.random_masks(truth.shape, seed=seed)
                y = pnp_sci.simulate(truth, masks, noise=noise, seed=seed)
                found.append(ratios(pnp_sci.solve(y, masks, prior, uncertainty=True), truth))
            tenths = np.array([tenths for tenths, _, _ in found])
            within = np.mean(np.abs(np.log(tenths)) < np.log(1.25))
            cells = " ".join(f"{value:.2f}" for value in np.median(tenths, 0))
            whole, rank = (np.median([row[k] for row in found]) for k in (1, 2))
            print(f"| {prior} | {views} | {noise} | {cells} | {whole:.2f} | {within:.0%} | {rank:.2f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
