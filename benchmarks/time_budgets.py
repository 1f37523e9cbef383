"""Seconds over time budgets, and what more time brings: ``python benchmarks/time_budgets.py``, on a quiet machine.

For each prior, size and budget: seconds of `solve` over the budget, median and largest of some runs after a warm one,
and PSNR. The table ends with the largest ratio, and with the most that a larger budget loses against a smaller one.
"""

import time

import click
import numpy as np

import pnp_sci

PRIORS = ("tv", "wavelet", "bm3d", "flow", "ffdnet", "video", "auto")
DECODERS = ("ofanet-fast", "ofanet")  # as the first estimate of "video"
BUDGETS = (0.3, 0.6, 1.0, 2.0, 3.0, 5.0)


@click.command()
@click.option("--side", "sides", type=int, multiple=True, default=(256, 512), show_default=True)
@click.option("--budget", "budgets", type=float, multiple=True, default=BUDGETS, show_default=True)
@click.option("--prior", "priors", multiple=True, default=PRIORS, show_default=True)
@click.option("--runs", type=int, default=3, show_default=True)
def main(sides, budgets, priors, runs):
    methods = [(prior, "auto") for prior in priors] + [("video", init) for init in DECODERS if "video" in priors]
    click.echo(f"{'side':>5} {'prior':8} {'init':12} {'budget':>7} {'ratio':>6} {'worst':>6} {'PSNR':>6}  taken")
    worst, loss = 0.0, 0.0
    for side in sides:
        scene = pnp_sci.datasets.embedded_scene(side)
        for prior, init in methods:
            best = -np.inf
            for _ in range(2):  # loads and compiles
                pnp_sci.solve(scene.y, scene.masks, prior, init=init, time_budget=max(budgets))
            for budget in sorted(budgets):
                ratios, result = [], None
                for _ in range(runs):
                    begin = time.perf_counter()
                    result = pnp_sci.solve(scene.y, scene.masks, prior, init=init, time_budget=budget)
                    ratios.append((time.perf_counter() - begin) / budget)
                psnr = float(pnp_sci.psnr(result.x, scene.truth).mean())
                worst, loss, best = max(worst, np.median(ratios)), max(loss, best - psnr), max(best, psnr)
                taken = f"{result.settings['init']}, {result.history[-1].iteration} iterations"
                click.echo(
                    f"{side:5} {prior:8} {init:12} {budget:7.2f} {np.median(ratios):6.2f} {max(ratios):6.2f} "
                    f"{psnr:6.2f}  {taken}"
                )
    click.echo(f"largest median ratio {worst:.2f}; more time loses {loss:.2f} dB at most")


if __name__ == "__main__":
    main()
