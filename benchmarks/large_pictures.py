"""A large picture of 2 x 10 frames: seconds, peak memory, and PSNR of the rows and columns where tiles meet.

The scene is the embedded one, repeated, with masks of its own for every pixel. Memory is that of the whole process.

    python benchmarks/large_pictures.py SIDE PRIOR [ITERATIONS]
"""

import resource
import sys
import time

import numpy as np

import pnp_sci
from pnp_sci.pipeline.sequence import MOST
from pnp_sci.pipeline.tiles import tiles

AROUND = 16  # pixels either side of where tiles meet


def main() -> None:
    side, prior = int(sys.argv[1]), sys.argv[2]
    iterations = int(sys.argv[3]) if len(sys.argv) > 3 else None
    scene = pnp_sci.datasets.embedded_scene()
    truth = np.tile(scene.truth, (1, 1, side // 256, side // 256))
    masks = pnp_sci.random_masks(truth.shape, seed=3)
    y = pnp_sci.simulate(truth, masks)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    begin = time.perf_counter()
    x = pnp_sci.solve(y, masks, prior, iterations=iterations).x
    seconds = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    parts = tiles(truth.shape, MOST)
    print(f"{side} x {side}, {prior}: {len(parts)} tiles, {seconds:.1f} s, {before:.2f} GiB before, {peak:.2f} at most")
    print(f"PSNR {np.mean(pnp_sci.psnr(x, truth)):.3f} dB")
    for row in sorted({tile.kept[0].start for tile in parts} - {0}):
        at, beside = (slice(row + shift - AROUND, row + shift + AROUND) for shift in (0, 256))
        dB = [np.mean(pnp_sci.psnr(x[:, :, rows], truth[:, :, rows])) for rows in (at, beside)]
        print(
            f"rows {at.start} to {at.stop}, where tiles meet: {dB[0]:.3f} dB, the same scene within a tile: {dB[1]:.3f}"
        )


if __name__ == "__main__":
    main()
