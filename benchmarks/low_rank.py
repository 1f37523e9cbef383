"""Options of `desci`: change of PSNR in dB, mean (worst), and ratio of processor seconds, on validation clips.

    PNP_SCI_DATA=DIR python benchmarks/low_rank.py [OPTION ...]  # all options that are numbers, or some

The cases are those of benchmarks/calibrate.py that move and have no noise. The three benchmark pairs are not used.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from multiprocessing import get_context

import numpy as np
from calibrate import CASES, _cell, alternatives, as_text, measure, prepare

from priors.desci import DeSCI

MOVING = [case for case in CASES if case.kind == "moving"]
NUMBERS = [field.name for field in fields(DeSCI) if not isinstance(field.default, bool)]


def main(names=()):
    options = {name: getattr(DeSCI, name) for name in names or NUMBERS}
    tries = [(None, None), *((name, v) for name in options for v in alternatives(name, options[name]).values())]
    prepare()
    measure(None, None, "desci", "fast", MOVING[0])  # compiles once, before the workers start
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=prepare) as pool:
        waiting = {
            (name, value): [
                pool.submit(measure, name and f"priors.desci.DeSCI.{name}", value, "desci", "balanced", case)
                for case in MOVING
            ]
            for name, value in tries
        }
        base = np.array([future.result() for future in waiting[None, None]])
        print(f"defaults: {base[:, 0].mean():.2f} dB, {base[:, 1].mean():.1f} s of the processor\n")
        print("| option | value | half | double |\n| --- | --- | --- | --- |")
        for name, value in options.items():
            cells = []
            for other in alternatives(name, value).values():
                found = np.array([future.result() for future in waiting[name, other]])
                gain, ratio = found[:, 0] - base[:, 0], found[:, 1] / base[:, 1]
                cells.append(_cell((other, float(gain.mean()), float(gain.min()), float(np.median(ratio)))))
            print(f"| `{name}` | {as_text(value)} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
