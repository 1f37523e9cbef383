"""Whether the light of a measurement that follows no mask is a constant, or a part of the light everywhere."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.code import Code
from pnp_sci.camera.straight_line import straight_line

CHANCE = 3.0  # standard errors


def light_line(code: Code, y: np.ndarray) -> tuple[bool, bool]:
    """Whether a constant is missing in the light that follows the code in y (H, W), and whether a part of it is.

    The light of blocks that follows the code is a straight line of their mean. After a black level its slope is 1, and
    it meets 0 at that level. A gamma ``y = light ** g`` scales detail by the local slope, so that the line goes through
    the origin with the slope g. So it does, with another slope, where some masks are wrong.
    """
    pixels = code.in_blocks(code.used)[code.blocks]
    mean = code.in_blocks(y * code.used)[code.blocks] / pixels
    light = code.coded(code.products((y - code.mean(y)) * code.used)) / pixels
    (start, slope), covariance = straight_line(mean, light, pixels)
    errors = CHANCE * np.sqrt(np.diagonal(covariance))
    return bool(start + errors[0] < 0), bool(slope + errors[1] < 1)
