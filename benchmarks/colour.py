"""Mosaics of colour sensors: PSNR in colour of solve(..., mosaic=), of each colour by itself, and as if they were grey.

Two views each, from colour pictures of scikit-image that move, turn and change their size. All three are demosaiced
in the same way at the end.

    python benchmarks/colour.py [PRIORS] [SIZE] [FRAMES]
"""

import sys
import time
from collections.abc import Callable

import cv2
import numpy as np
from skimage import data

import pnp_sci
from pnp_sci.sensing.mosaic import CELL, Mosaic, planes

SCENES = (("astronaut", "coffee"), ("chelsea", "rocket"), ("immunohistochemistry", "retina"))
PATTERN = "RGGB"
MOVES = ((1.5, -1.0, 0.5, 1.003), (-1.0, 1.2, -0.6, 0.996))  # rows, columns, degrees and scale from frame to frame


def clip(name: str, frames: int, size: int, move: tuple[float, ...]) -> np.ndarray:
    """A colour video (B, H, W, 3) in [0, 1], of a picture shrunk to half or to the size, which hides its own mosaic."""
    picture = getattr(data, name)().astype(np.float32) / 255
    scale = max(1.15 * size / min(picture.shape[:2]), 0.5)
    picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    middle = np.array(picture.shape[1::-1]) / 2
    film = []
    for t in np.arange(frames) - (frames - 1) / 2:
        matrix = cv2.getRotationMatrix2D(middle.tolist(), move[2] * t, move[3] ** t)
        matrix[:, 2] += size / 2 - middle + np.array(move[1::-1]) * t
        film.append(cv2.warpAffine(picture, matrix, (size, size), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))
    return np.clip(np.stack(film), 0, 1)


def colour(y: np.ndarray, masks: np.ndarray, prior: str) -> np.ndarray:
    return pnp_sci.solve(y, masks, prior, mosaic=PATTERN).x


def plane_by_plane(y: np.ndarray, masks: np.ndarray, prior: str) -> np.ndarray:
    video = np.empty(masks.shape, np.float32)
    for i, j in CELL:
        own = np.ascontiguousarray(masks[..., i::2, j::2])
        video[..., i::2, j::2] = pnp_sci.solve(y[i::2, j::2], own, prior).x
    return Mosaic(PATTERN).demosaic(planes(video))


def grey(y: np.ndarray, masks: np.ndarray, prior: str) -> np.ndarray:
    return Mosaic(PATTERN).demosaic(planes(pnp_sci.solve(y, masks, prior).x))


def measured(method: Callable, prior: str, size: int, frames: int) -> tuple[list[float], float]:
    """PSNR of each scene, mean of its views, and seconds for one measurement."""
    scores, seconds = [], 0.0
    for scene in SCENES:
        truth = np.stack([clip(name, frames, size, move) for name, move in zip(scene, MOVES)])
        masks = pnp_sci.moving_masks(truth.shape[:4], seed=0)
        y = pnp_sci.simulate(truth, masks, mosaic=PATTERN)
        begin = time.perf_counter()
        x = method(y, masks, prior)
        seconds += time.perf_counter() - begin
        scores.append(float(np.mean(pnp_sci.psnr(x, truth))))
    return scores, seconds / len(SCENES)


def main() -> None:
    priors = sys.argv[1].split(",") if len(sys.argv) > 1 else ["tv", "flow", "video"]
    size, frames = (int(sys.argv[k]) if len(sys.argv) > k else usual for k, usual in ((2, 256), (3, 8)))
    names = [" and ".join(scene) for scene in SCENES]
    print("| prior | method |", " | ".join(names), "| mean (dB) | seconds |")
    print("| --- | --- |", " --- |" * (len(names) + 2))
    for prior in priors:
        for method in (colour, plane_by_plane, grey):
            measured(method, prior, 64, frames)  # compiles
            scores, seconds = measured(method, prior, size, frames)
            cells = " | ".join(f"{score:.2f}" for score in (*scores, np.mean(scores)))
            print(f"| {prior} | {method.__name__.replace('_', ' ')} | {cells} | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
