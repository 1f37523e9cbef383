"""PSNR in dB and time of the automatic scene model against the full one, on still, dark and moving scenes.

PNP_SCI_DATA=DIR python benchmarks/scene_model.py
"""

import time

import numpy as np

import pnp_sci

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")


def compare(name, truth, masks, prior):
    y = pnp_sci.simulate(truth, masks)
    psnr, seconds = {}, {}
    for scene in ("full", "auto"):
        begin = time.perf_counter()
        result = pnp_sci.solve(y, masks, prior, scene=scene)
        seconds[scene] = time.perf_counter() - begin
        lit = [bool(view.any()) for view in truth]
        psnr[scene] = np.mean(pnp_sci.psnr(result.x, truth)[lit])
    ratio = seconds["auto"] / seconds["full"]
    print(f"{name:33} {prior:5} full {psnr['full']:.2f} dB, auto {psnr['auto']:.2f} dB, {ratio:.2f} of the time")


def main():
    for pair in PAIRS:
        scene = pnp_sci.datasets.dualview(pair)
        still = np.repeat(scene.truth[:, :1], scene.truth.shape[1], axis=1)
        dark = scene.truth * np.array([1, 0], np.float32)[:, None, None, None]
        for model in ("full", pnp_sci.SceneModel((True, True), still=True)):  # compile
            pnp_sci.solve(scene.y, scene.masks, "flow", iterations=2, first=0, scene=model)
        pnp_sci.solve(scene.y, scene.masks, "auto", iterations=32)
        for prior in ("tv", "flow", "auto"):
            compare(f"{pair}, still", still, scene.masks, prior)
            compare(f"{pair}, second view dark", dark, scene.masks, prior)
            compare(f"{pair}, second view still", np.stack([scene.truth[0], still[1]]), scene.masks, prior)
            compare(f"{pair}", scene.truth, scene.masks, prior)


if __name__ == "__main__":
    main()
