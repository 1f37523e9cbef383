"""Stability of learned priors in 500 iterations at one sigma, from `adjoint`, on 20 cases of validation clips.

PNP_SCI_DATA=DIR python benchmarks/long_runs.py [PRIOR ...] [--weights FILE] [--seed 40]

The cases are the central 64 x 64 pixels of those of `parts.py`, without noise. The output is a table: means of the best
PSNR and of that at the end in dB, the largest decrease at the end, and the number of cases that are not stable: those
that lose more than 0.7 dB or fail.
"""

import click
import numpy as np
from parts import cases, validation_clips

import pnp_sci

CENTRE = (..., slice(32, 96), slice(32, 96))
SIGMAS = 5, 10  # of 255
ITERATIONS = 500
STABLE = 0.7  # dB


def runs(prior, sigma, seed, options):
    """The best PSNR in dB, that at the end, and whether the status is good, of each case."""
    for truth, masks, _ in cases(validation_clips(), (0.0,), seed):
        truth, masks = truth[CENTRE], masks[CENTRE]
        result = pnp_sci.solve(
            pnp_sci.simulate(truth, masks), masks, prior, "adjoint", scene="full", noise=0, sigma=sigma / 255,
            iterations=ITERATIONS, tol=0, reference=truth, **options,
        )  # fmt: skip
        psnr = result.history["psnr"]
        yield psnr.max(), psnr[-1], result.status.ok


@click.command()
@click.argument("names", metavar="[PRIOR]...", nargs=-1)
@click.option("--weights", help="Weights of the network; by default those of the package.")
@click.option("--seed", default=40, show_default=True, help="Of the first case.")
def main(names, weights, seed):
    if weights and len(names) != 1:
        raise click.UsageError("--weights is for one PRIOR")
    options = {"weights": weights} if weights else {}
    print(
        "| prior | sigma (of 255) | best (dB) | at the end | worst decrease | not stable |\n|---|---|---|---|---|---|"
    )
    for name in names or ("ffdnet", "video", "tv+ffdnet"):
        for sigma in SIGMAS:
            best, end, good = np.array(list(runs(name, sigma, seed, options))).T
            lost = best - end
            unstable = np.sum((lost > STABLE) | (good == 0))
            cells = f"{best.mean():.2f}", f"{end.mean():.2f}", f"{lost.max():.2f}", f"{unstable} of {len(lost)}"
            print(f"| `{name}` | {sigma} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
