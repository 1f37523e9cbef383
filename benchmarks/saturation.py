"""PSNR in dB with a model of the camera (saturation and photon noise) against noise="auto".

PNP_SCI_DATA=DIR python benchmarks/saturation.py
"""

import numpy as np

import pnp_sci

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
CAMERAS = {  # full scale of max(y), electrons at max(y), read noise in electrons, bits
    "saturates at 0.6 of the brightest, 10 bits": (0.6, 1e9, 0, 10),
    "saturates at 0.8 of the brightest, 8 bits": (0.8, 1e9, 0, 8),
    "300 electrons in the brightest, 3 read noise, 10 bits": (1.0, 300, 3, 10),
    "the same, saturates at 0.7": (0.7, 300, 3, 10),
    "30 electrons in the brightest, 1 read noise, 10 bits": (1.0, 30, 1, 10),
}


def main():
    for prior in ("tv", "flow"):
        for name, (share, electrons, read, bits) in CAMERAS.items():
            quality, lost = [], []
            for pair in PAIRS:
                scene = pnp_sci.datasets.dualview(pair)
                highest = float(pnp_sci.simulate(scene.truth, scene.masks).max())
                gain = highest / electrons
                camera = pnp_sci.Sensor(read * gain, gain, share * highest, bits)
                y = pnp_sci.simulate(scene.truth, scene.masks, camera)
                results = [pnp_sci.solve(y, scene.masks, prior, noise=noise) for noise in ("auto", camera)]
                quality.append([np.mean(pnp_sci.psnr(result.x, scene.truth)) for result in results])
                lost.append(results[1].scene["saturated"] / y.size)
            before, after = np.mean(quality, 0)
            print(
                f'{prior:5} {name:54} {np.mean(lost):5.1%} saturated: noise="auto" {before:.2f}, Sensor {after:.2f} dB'
            )


if __name__ == "__main__":
    main()
