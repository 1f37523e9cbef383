"""Measurements whose type was too narrow for the sum of the frames: values that have wrapped around."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.explained import BLOCK, WIDTH
from pnp_sci.camera.fit import Finding

SHORTEST = 2**8  # the narrowest type of which anybody stores measurements
LONGEST = 2**32  # largest period: of the widest type that cameras store
REACHED = 0.97  # of the period: values that wrap around come from all parts of it
PHASES = 8  # steps of that number in a period, in the pixel of the largest weight
BETTER = 0.1  # of a perfect fit: more light is taken if it fits better by that
PASSES = 4
OPEN = 3.5  # times the largest mask is the largest weight, at least: sums of few frames look like many others
FEWEST = 16  # pixels that have wrapped, which tell it
UNLIKE = 0.12  # what is left of their residual, times how far they are from uniform: wrong masks leave twice as much
TWICE = 2.0  # times as many pixels as at the values below are at the largest one: a camera that is saturated
BELOW = 8  # such values


def wrapped(y: np.ndarray, masks: np.ndarray, weight: np.ndarray, usable: np.ndarray) -> int | None:
    """The period at which y (H, W) has wrapped around, for masks (V, B, H, W) >= 0 of the sum `weight`; None if not.

    It is a power of two, and y has whole numbers from about 0 to it. The light that passes a pixel is its weight times
    what the pixels around have; where that is more than a period, a measurement that has not wrapped around ends at its
    largest value. If it has, multiples of the period explain it: adding them brings most of these pixels to the light
    around. That light is unknown itself. It is first looked for in blocks, by the phase of y, which does not depend on
    the number of periods. The more often y has wrapped, the worse the light is known, but the more uniform is y there,
    as no scene is through masks: the product of both tells.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> weight, good = scene.masks.sum((0, 1)).astype(float), np.ones((64, 64), bool)
    >>> y = 40 * scene.y
    >>> wrapped(y.astype(np.uint8), scene.masks, weight, good), wrapped(y.astype(np.uint16), scene.masks, weight, good)
    (256, None)
    """
    period = _period(y[usable])
    if period is None or weight.max() < OPEN * masks.max():
        return None
    y, usable = np.where(usable, y, 0).astype(np.float32), usable & (weight > 0)
    light = _light_in_blocks(y, weight, usable, period, float(masks.max()))
    turns = np.zeros_like(y)
    for _ in range(PASSES):
        turns = np.maximum(np.round((weight * light - y) / period), 0) * usable
        light = _around(y + period * turns, weight, usable)
    beyond: np.ndarray = turns > 0
    if beyond.sum() < FEWEST or np.unique(y[beyond]).size < FEWEST / 2:
        return None
    plain = (y - weight * _around(y, weight, usable))[beyond]
    left = (y + period * turns - weight * light)[beyond]
    uneven = _from_uniform(y[usable & (weight * light > period)] / period)
    return period if np.linalg.norm(left) * uneven < UNLIKE * np.linalg.norm(plain) else None


def wrapped_at(period: int) -> Finding:
    """The finding of a measurement that has wrapped around at this value."""
    hint = "add up the frames in a wider type, such as float32, and store that"
    return Finding("wrapped", f"y seems to have wrapped around at {period}, where its type ends", hint)


def _period(y: np.ndarray) -> int | None:
    """The power of two that values y (N,) may have wrapped at: whole numbers from 0 to it, no more at the top."""
    low, top = (float(end) for end in (y.min(initial=0), y.max(initial=0)))
    period = max(2 ** int(top).bit_length(), SHORTEST)
    if (
        period > LONGEST
        or low < 0
        or low > (1 - REACHED) * period
        or not REACHED * period <= top < period
        or (y != np.round(y)).any()
    ):
        return None
    at_top, below = np.sum(y == top), np.sum(y >= top - BELOW) - np.sum(y == top)
    return None if at_top > max(TWICE * below / BELOW, FEWEST) else period


def _light_in_blocks(y, weight, usable, period, largest) -> np.ndarray:
    """The light (H, W) for each unit of weight, one number a block: that whose phase fits best.

    A frame has less light than a period, behind a mask of the `largest` value.
    """
    step, count = period / (PHASES * float(weight.max())), int(PHASES * weight.max() / largest)
    phase = usable * np.exp(2j * np.pi / period * y).astype(np.complex64)
    turn = np.exp(-2j * np.pi / period * step * weight).astype(np.complex64)
    tops = [np.arange(0, n, BLOCK) for n in y.shape]
    best = np.full([top.size for top in tops], -np.inf, np.float32)
    light = np.zeros_like(best)
    for k in range(count):
        fits = np.add.reduceat(np.add.reduceat(phase.real, tops[0], 0), tops[1], 1)
        better = fits > best + BETTER * BLOCK**2
        light[better], best[better] = k * step, fits[better]
        phase *= turn
    return light.repeat(BLOCK, 0)[: y.shape[0]].repeat(BLOCK, 1)[:, : y.shape[1]]


def _around(y: np.ndarray, weight: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """The light (H, W) for each unit of weight around each pixel."""
    from scipy.ndimage import gaussian_filter

    light, below = (gaussian_filter(a * usable, WIDTH, mode="nearest") for a in (y, weight))
    return np.divide(light, below, out=np.zeros_like(light), where=below > 0)


def _from_uniform(y: np.ndarray) -> float:
    """The largest distance of the distribution of values y (N,) from the uniform one over [0, 1]."""
    if y.size < FEWEST:
        return 1.0
    return float(np.abs(np.sort(y) - np.arange(y.size) / y.size).max())
