"""Limits of quality and convergence: sweeps of one property at a time from a common base, for priors and algorithms.

Base: two views of 10 frames of 64 x 64, random binary masks of density 0.5, no noise, and the defaults of `solve`.
Each point is written to stderr with PSNR, status, seconds and flags; a Markdown table per dimension goes to stdout.
Flags: not finite; a status such as DIVERGED; raised; warned; frozen (the scene model is still, but the scene moves);
trivial (PSNR below that of a uniform picture of the true mean); fell (dB below the best iterate); behind (dB below the
default algorithm).

python benchmarks/extremes.py --prior tv none --algorithm gap admm --dimension noise density > tables.md
"""

import argparse
import sys
import warnings
from functools import cache

import numpy as np

import pnp_sci

PRIORS = ("tv", "wavelet", "flow", "ffdnet", "video", "none")
ALGORITHMS = ("gap", "plain-gap", "admm")  # the first is the default algorithm
BASE = {
    "noise": 0.0, "frames": 10, "views": 2, "density": 0.5, "scale": 1.0, "bits": None, "size": 64, "iterations": None,
}  # fmt: skip
DIMENSIONS = {
    "noise": (0.0, 0.01, 0.05, 0.1, 0.3, 1.0),  # standard deviation, of max(y)
    "frames": (1, 2, 5, 10, 20, 40, 64),
    "views": (1, 2, 3, 4),
    "density": (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98),
    "scale": (1e-6, 1e-3, 1.0, 1e3, 1e6),  # factor on the masks
    "bits": (4, 8, 10, 12, 16, None),  # of the camera; None: no quantisation
    "size": (8, 16, 32, 64, 128, 256, 512),
    "iterations": (1, 10, 50, 100, 500, 2000),  # with tol=0; None in the base: the default
}
SLOW = ("flow", "ffdnet", "video")
WORK = 2e7  # values of the video times iterations: limit of the slow priors without --all
FELL = 0.5  # dB: allowed difference between the best iterate and the result
BEHIND = 1.0  # dB: allowed difference between the default algorithm and another one


def moving(views, frames, size):
    """Truth (V, B, H, W): pictures of scikit-image that move along a circle, about one pixel per frame."""
    from scipy.ndimage import shift
    from skimage import data
    from skimage.transform import resize

    margin, radius = 8, 5  # the margin contains the radius and the edge of the spline
    angles = np.arange(frames) / radius
    pictures = (data.camera(), data.astronaut()[..., 1], data.coins(), data.coffee()[..., 1])
    truth = np.empty((views, frames, size, size), np.float32)
    for v in range(views):
        side = min(pictures[v].shape)
        scene = resize(pictures[v][:side, :side], (size + 2 * margin,) * 2, anti_aliasing=True)
        for b, angle in enumerate(angles + v):  # the views move differently
            moved = shift(scene, (radius * np.sin(angle), radius * np.cos(angle)), mode="nearest")
            truth[v, b] = np.clip(moved[margin:-margin, margin:-margin], 0, 1)
    return truth


@cache
def scene(noise, frames, views, density, scale, bits, size):
    """Measurement, masks and truth."""
    truth = moving(views, frames, size)
    masks = pnp_sci.random_masks(truth.shape, density) * np.float32(scale)
    return pnp_sci.simulate(truth, masks, noise=noise, bits=bits), masks, truth


@cache
def solved(prior, algorithm, point):
    """PSNR in dB, status, seconds and flags of one point, given as the items of BASE."""
    settings = dict(point)
    iterations = settings.pop("iterations")
    y, masks, truth = scene(**settings)
    tol = {} if iterations is None else {"tol": 0}
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", RuntimeWarning)
            result = pnp_sci.solve(y, masks, prior, algorithm=algorithm, iterations=iterations, reference=truth, **tol)
    except Exception as error:  # an exception is a result of the sweep
        return float("nan"), f"{type(error).__name__}: {error}", float("nan"), ["raised"]
    score = float(np.mean(pnp_sci.psnr(result.x, truth)))
    best = float(result.history["psnr"].max())
    seen = {
        "not finite": not np.isfinite(result.x).all(),
        result.status.name: not result.status.ok,
        "frozen": result.scene["still"],  # the scene moves
        "warned": any(issubclass(w.category, RuntimeWarning) for w in said),
        "trivial": not score >= trivial(truth),
        f"fell {best - score:.1f}": best - score > FELL,
    }
    last = result.history[-1]
    status = f"{result.status.name}, {last.iteration} iterations, residual {last.residual:.1g}"
    return score, status, last.seconds, [flag for flag, on in seen.items() if on]


def trivial(truth):
    """PSNR in dB of a uniform picture of the true mean, a baseline without a measurement."""
    return float(np.mean(pnp_sci.psnr(np.full_like(truth, truth.mean()), truth)))


def row(dimension, value, columns, everything):
    """Cells of one value: PSNR and flags for each prior and algorithm; "-" if the point is left out."""
    point = BASE | {dimension: value}
    cells = []
    for prior, algorithm in columns:
        if prior in SLOW and not (everything or affordable(dimension, value)):
            cells.append("-")
            continue
        score, status, seconds, flags = solved(prior, algorithm, tuple(point.items()))
        default = solved(prior, ALGORITHMS[0], tuple(point.items()))[0] if algorithm != ALGORITHMS[0] else score
        flags = flags + [f"behind {default - score:.1f}"] * (default - score > BEHIND)
        text = f"{score:.1f}" + "".join(f" **{flag}**" for flag in flags)
        cells.append(text)
        line = f"{dimension} {value} {prior}/{algorithm}: {score:.2f} dB, {status}, {seconds:.1f} s"
        print(line + "; ".join(["", *flags]), file=sys.stderr, flush=True)
    return [f"{value}", f"{trivial(scene(**{k: v for k, v in point.items() if k != 'iterations'})[2]):.1f}", *cells]


def affordable(dimension, value):
    """Whether slow priors run this point by default: the base, and the first, middle and last value within WORK."""

    def work(n):
        p = BASE | {dimension: n}
        return p["views"] * p["frames"] * p["size"] ** 2 * (p["iterations"] or 100)

    little = [n for n in DIMENSIONS[dimension] if work(n) <= WORK]
    return value in (little[0], little[len(little) // 2], little[-1], BASE[dimension])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prior", nargs="+", choices=PRIORS, default=PRIORS)
    parser.add_argument("--algorithm", nargs="+", choices=ALGORITHMS, default=ALGORITHMS)
    parser.add_argument("--dimension", nargs="+", choices=DIMENSIONS, default=tuple(DIMENSIONS))
    parser.add_argument("--all", action="store_true", help="all points and algorithms for slow priors too (hours)")
    given = parser.parse_args()
    columns = [
        (prior, algorithm)
        for prior in given.prior
        for algorithm in given.algorithm
        if given.all or prior not in SLOW or algorithm == ALGORITHMS[0]
    ]
    if not given.all and set(SLOW) & set(given.prior):
        print(f"{', '.join(SLOW)}: only with {ALGORITHMS[0]}, at three values per dimension; --all runs all points.\n")
    for dimension in given.dimension:
        rows = [row(dimension, value, columns, given.all) for value in DIMENSIONS[dimension]]
        head = [dimension, "uniform", *(f"{prior}/{algorithm}" for prior, algorithm in columns)]
        for cells in (head, ["---"] * len(head), *rows):
            print("| " + " | ".join(cells) + " |")
        print(flush=True)


if __name__ == "__main__":
    main()
