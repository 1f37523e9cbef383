"""Blending with a decoder's estimate of a noisy scene: its errors differ from those of the solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import all_finite, library
from pnp_sci.sensing.problem import Problem


@dataclass(frozen=True)
class BlendNumbers(Tuned):
    """How much a decoder's estimate counts."""

    alike: float = 1.5e-3  # mean squared difference at which the share is largest, where x spans [0, 1]
    loud: float = 0.1  # noise in a pixel of x, ``noise / sqrt(gram)``, that equals a decoder's error


TUNED = BlendNumbers()


def blended(problem: Problem, x: Any, other: Any) -> tuple[Any, list[float]]:
    """``x + s (other - x)`` of the solver's estimate x and a decoder's, both (V, B, H, W), arrays or tensors, and s
    for each view.

    ``s = q / (1 + q^2) n^4 / (n^4 + 0.1^4)``, with ``q = d / 0.0015``, d the mean squared difference of the two and n
    the noise of y, as known or estimated, in a pixel of x, ``noise / sqrt(gram)``, by all masks also where fewer frames
    are modelled. It is 1/2 at most, the mean of two equally good estimates. Far apart the decoder is mostly wrong;
    close together the scene is easy, and a strong prior mostly better. What is not finite stays as it is.

    Examples
    --------
    >>> from pnp_sci import SensingOperator
    >>> problem = Problem(SensingOperator(np.ones((1, 2, 8, 8))), np.ones((8, 8)), unit=1.0, noise=1.0)
    >>> x, shares = blended(problem, np.zeros((1, 2, 8, 8)), np.full((1, 2, 8, 8), 0.1))
    >>> round(shares[0], 3), round(float(x.max()), 3)
    (0.147, 0.015)
    """
    gram = float(np.mean(problem.op.gram, dtype=np.float64))
    if gram == 0 or problem.typical_noise == 0 or not all_finite(x):
        return x, [0.0] * len(x)
    loud = (problem.typical_noise / (TUNED.loud * np.sqrt(gram))) ** 4
    out, shares = library(x).empty_like(x), []
    for view, second, mean in zip(x, other, out):
        step = second - view
        apart = float((step**2).mean()) / TUNED.alike
        shares.append(float(loud / (1 + loud) / (apart + 1 / apart)) if apart > 0 else 0.0)
        mean[...] = view + step * shares[-1]
    return out, shares
