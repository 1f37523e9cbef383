"""What more calls gain where the masks of two views add up to 1, as with the two arms of a micromirror device.

PSNR in dB of `video` and `flow` without them and with them, on the cases of parts.py with two views.

PNP_SCI_DATA=DIR python benchmarks/opposite_masks.py
"""

from unittest import mock

import numpy as np
import parts

import pnp_sci
from pnp_sci.solvers import schedule

PRIORS = ("video", "flow")
NOISES = (0.0, 0.0, 0.003, 0.01)  # of max(y)


def main():
    print("| noise | cases | " + " | ".join(f"`{p}` without (dB) | with (dB)" for p in PRIORS) + " |")
    print("|---" * (2 + 2 * len(PRIORS)) + "|")
    rows = {}
    for n, (truth, masks, _) in enumerate(parts.cases(parts.validation_clips(), parts.QUIET)):
        if len(truth) != 2:
            continue
        noise, masks = NOISES[n % len(NOISES)], np.stack([masks[0], 1 - masks[0]])
        y = pnp_sci.simulate(truth, masks, noise, seed=n)
        row = []
        for prior in PRIORS:
            with mock.patch.object(schedule, "opposition", return_value=1.0):
                row.append(pnp_sci.solve(y, masks, prior))
            row.append(pnp_sci.solve(y, masks, prior))
        rows.setdefault(noise, []).append([pnp_sci.psnr(result.x, truth).mean() for result in row])
    for noise, values in rows.items():
        print(f"| {noise:g} | {len(values)} | " + " | ".join(f"{value:.2f}" for value in np.mean(values, 0)) + " |")


if __name__ == "__main__":
    main()
