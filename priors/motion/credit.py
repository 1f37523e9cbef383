"""How much a pair of frames counts in averages along the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import library

HOPELESS = 80.0  # exponent at which no weight is left; exp of more would underflow in float32


@dataclass(frozen=True)
class CreditNumbers(Tuned):
    """How fast the credit of a pair falls."""

    doubt: float = 0.5  # credit is exp(-doubt e); e: squared difference beyond that of adjacent frames, in tolerances


TUNED = CreditNumbers()


def credit(mean: Any, beside: list[list[int]], close: float) -> Any:
    """How much each pair counts, (..., P), 0 to 1: ``exp(-doubt e)``.

    Flow to a distant frame is often wrong where the flow to the next frame is still right. The frames then differ more.
    The excess e is what the `mean` squared difference (..., P) of frames b and n is above that of b and the frames
    `beside` it, in units of ``close^2``. A mean over the frame is less likely to match by chance than single pixels.
    What leaves the frame counts too: in a pan distant pairs lose some of their credit.

    >>> import numpy as np
    >>> credit(np.array([0.1, 0.5]), [[0, 0], [0, 0]], close=1.0).round(2).tolist()
    [1.0, 0.82]
    """
    excess = (mean - (mean[..., beside[0]] + mean[..., beside[1]]) / 2) / close / close  # close^2 may be 0 or infinite
    return library(mean).exp(-(TUNED.doubt * excess).clip(0, HOPELESS))
