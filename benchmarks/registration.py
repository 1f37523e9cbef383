"""What masks that are off cost, and what registration recovers of it: PSNR in dB, against the true masks.

PNP_SCI_DATA=DIR python benchmarks/registration.py PRIOR [CASE ...]
"""

import sys
import time

import numpy as np

import pnp_sci
from pnp_sci.bench.held_back import held_back_score
from pnp_sci.camera.warp import warped

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
SETS = ("kobe", "runner", "traffic")
CASES = {  # how the masks are off, gain of y, offset in units of max(y)
    "InverseNet": (pnp_sci.Transform(0.5, 0.3, 0.1), 1.02, 0.002),
    "large": (pnp_sci.Transform(-2.6, 3.0, 0.5, 1.005), 1.0, 0.2),
    "right": (pnp_sci.Transform(), 1.0, 0.0),
}


def main():
    prior = sys.argv[1] if len(sys.argv) > 1 else "tv"
    scenes = [*map(pnp_sci.datasets.dualview, PAIRS), *map(pnp_sci.datasets.singleview, SETS)]
    for case in sys.argv[2:] or CASES:
        for interpolation in ("linear", "cubic") if case in CASES and case != "right" else ("linear",):
            for scene in scenes if case in CASES else ():
                print(f"{prior:5} {case:11} {interpolation:7} {simulated(scene, prior, *CASES[case], interpolation)}")
    if not sys.argv[2:] or "captures" in sys.argv[2:]:
        for capture in (*map(pnp_sci.datasets.real, ("wheel", "hand")), pnp_sci.datasets.real_dual()):
            print(f"{prior:5} {capture.name:11} {real(capture, prior)}")


def simulated(scene, prior, transform, gain, offset, interpolation):
    truth = scene.truth if scene.y.ndim == 2 or prior == "tv" else scene.truth[0]
    masks = warped(scene.masks, transform, interpolation).astype(np.float32)
    clean = gain * np.einsum("vbhw,...vbhw->...hw", masks, truth)
    y = clean + np.float32(offset * clean.max())
    found, seconds = registered(y, scene.masks)
    error = max(np.hypot(t.rows - transform.rows, t.columns - transform.columns) for t in found.transforms)
    black = abs(found.black_level / clean.max() - offset)
    attempts = (clean, masks, False), (y, scene.masks, False), (y, scene.masks, found)
    best, lost, mended = (quality(pnp_sci.solve(y, m, prior, register=r), truth) for y, m, r in attempts)
    share = f"{(mended - lost) / (best - lost):6.1%}" if best - lost > 0.05 else "     -"
    return (
        f"{scene.name:15} true masks {best:.2f}, given {lost:.2f}, registered {mended:.2f} dB: recovered {share}; "
        f"shift off by {error:.4f} px; black level off by {black:.4f}; {seconds:.1f} s"
    )


def real(scene, prior):
    found, seconds = registered(scene.y, scene.masks)
    white = np.percentile(pnp_sci.solve(scene.y, scene.masks, prior).x, 99.9)

    def score(y, masks):
        def reconstruct(y, masks):
            return pnp_sci.solve(y, masks, prior, "adjoint").x

        return held_back_score(reconstruct, y, masks, white=white)

    before, after = score(scene.y, scene.masks), score(found.correct(scene.y), found.masks)
    return f"score without truth: given {before:.2f}, registered {after:.2f} dB; {seconds:.1f} s; {found.in_words()}"


def registered(y, masks):
    pnp_sci.register(y[..., :64, :64], masks[..., :64, :64])  # imports
    begin = time.perf_counter()
    found = pnp_sci.register(y, masks)
    return found, time.perf_counter() - begin


def quality(result, truth):
    several = truth if truth.ndim == 5 else truth[None]
    return np.mean([pnp_sci.psnr(x, t) for x, t in zip(np.reshape(result.x, several.shape), several)])


if __name__ == "__main__":
    main()
