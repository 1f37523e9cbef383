"""What the values of a measurement say, without the code of the masks."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.fit import Finding
from pnp_sci.camera.outliers import expected, lost_lines
from pnp_sci.camera.rise import rise
from pnp_sci.camera.verdict import HALF
from pnp_sci.sensing.operator import BY_NOISE
from pnp_sci.sensing.sensor import Sensor

KNOWN = 0.9  # of the pixels of a pile: if so many are known to be saturated, the full scale is right
BEYOND = 1.5  # of the full scale: values that are larger have other units
HARMFUL = {"hot": 1e-3, "dead": 1.5e-3}  # of the energy of y: outliers of that much cost some tenths of a dB
LIGHTS = 1e-2  # of the energy of y: as much is worth a warning even if points of light may look so
FEWEST = 25  # values: fewer do not tell how much y varies
LOUD = 3.0  # standard deviations of y: noise above that is impossible, also where y is clipped at 0
BELOW = 0.5  # standard deviations of y: so far below 0 no mean of noise is
CENTRED = 0.1  # of the pixels: of masks about 0, more have a negative sum
SIGNED = {"uint8": 2**7, "uint16": 2**15}  # values from which on unsigned data are negative if they are read as signed
REACHED = 0.97  # of the largest signed value: unsigned data above it reach that
WRAPPED = 0.9  # of the largest unsigned value: what has wrapped below 0 is above that
OFTEN = 0.01  # of the pixels: hot ones are fewer

LEAVE = 'bad="auto" leaves them out, or bad= a picture of the bad pixels'


def unlike(y, weight, hot, dead, good) -> list[Finding]:
    """The findings of hot and dead pixels, if they are more than a certain part of the energy of y."""
    if not (hot.any() or dead.any()):
        return []
    others = good & ~hot & ~dead
    excess = y - expected(y, weight, others)
    light = float(np.sum(np.square(y), where=others))
    limits = {"hot": _limit_of_hot(excess[hot], weight[hot]), "dead": HARMFUL["dead"]}
    hints = {"hot": f"{LEAVE}; points of light of one or two pixels look alike, and are lost by that", "dead": LEAVE}
    found = []
    for kind, where, how in (("hot", hot, "much brighter"), ("dead", dead, "much darker")):
        if float(np.sum(np.square(excess), where=where)) > limits[kind] * light:
            count = int(where.sum())
            text = f"{count} pixel{'s are' if count > 1 else ' is'} {how} than masks and neighbours allow"
            lines = lost_lines(y, weight, good, dead) if kind == "dead" else []
            found.append(_lost(lines) if lines else Finding(kind, text, hints[kind]))
    return found


def _lost(lines: list[tuple[int, slice]]) -> Finding:
    """The finding of whole rows or columns of y that are 0, at most three ranges of which are named."""
    named = [f"y[..., {r.start}:{r.stop}{', :' * (axis == 0)}]" for axis, r in lines[:3]] + ["..."] * (len(lines) > 3)
    hint = "the readout or file is incomplete, or the scene is black there; if not black, bad= a picture of them"
    return Finding("dead", f"all pixels of {', '.join(named)} are 0", hint)


def _limit_of_hot(excess: np.ndarray, weight: np.ndarray) -> float:
    """The part of the energy of y from which on hot pixels are worth a warning, by what they add to y, both (N,).

    Points of light are told from hot pixels as what they add rises with the weight, the sum of the masks.
    """
    slope, error = rise(excess, weight)
    if slope + error < HALF:
        return HARMFUL["hot"]
    return LIGHTS if slope - error < HALF else np.inf


def stuck_at(y: np.ndarray) -> Finding:
    """The finding of values y (N,) of columns or rows that are stuck."""
    value = f"{y.min():.7g}" if np.ptp(y) == 0 else f"values from {y.min():.7g} to {y.max():.7g}"
    return Finding("stuck", f"{y.size} pixels of columns or rows are stuck at {value}, whatever the masks", LEAVE)


def beyond(top: float, sensor: Sensor) -> list[Finding]:
    """The finding of values far above the full scale; a dark frame that was subtracted may leave them a bit above."""
    if sensor.full_scale is None or top <= BEYOND * sensor.full_scale:
        return []
    hint = "give full_scale in the units of y"
    return [Finding("saturation", f"y reaches {top:.7g}, but the full scale is {sensor.full_scale:.7g}", hint)]


def saturation(y, low, top, sensor, saturated) -> list[Finding]:
    """The finding of a pile from `low` to `top` that the sensor does not take for saturated."""
    there = y >= low
    if saturated.any() and np.count_nonzero(saturated & there) >= KNOWN * np.count_nonzero(there):
        return []
    where = (
        f"at exactly its largest value, {top:.7g}"
        if low == top
        else f"near its largest value, from {low:.7g} to {top:.7g}"
    )
    stated = "" if sensor.full_scale is None else f", not {sensor.full_scale:.7g}"
    use = f"use noise=pnp_sci.Sensor(full_scale={low:.7g}){stated}"
    hint = f"give hot pixels as bad=; if the camera was saturated there, {use}"
    return [Finding("saturation", f"y has many pixels {where}", hint)]


def loud(y: np.ndarray, sensor: Sensor) -> list[Finding]:
    """The finding of noise that is far more than values y (N,) vary."""
    if sensor.read_noise == "auto" or y.size < FEWEST:
        return []
    noise = float(np.hypot(sensor.read_noise, np.sqrt(sensor.gain * max(float(y.mean()), 0.0))))
    spread = float(y.std(dtype=np.float64))
    if noise <= LOUD * spread:
        return []
    text = f"noise is {noise:.3g}, but y has a standard deviation of {spread:.3g} only"
    return [Finding("noise", text, 'give noise in the units of y, or "auto"')]


def sign(y: np.ndarray, light: np.ndarray) -> list[Finding]:
    """The finding of negative values y (N,) for masks that have none; `light` are those that are no outliers.

    Unsigned numbers below 0 have wrapped: they are next to the largest number, and no other values are near them.
    """
    low, top, part = float(y.min(initial=0)), float(y.max(initial=0)), np.mean(y < 0) if y.size else 0.0
    text = f"y is negative in {part:.1%} of the pixels, but no mask is"
    for name, end in SIGNED.items():
        if REACHED * end < top < end and -end <= low < -REACHED * end and np.unique(y[y < 0]).size > 2:
            return [Finding("sign", text, f"{name} data seem to be read as int{name[4:]}; read them as {name}")]
    for name, end in SIGNED.items():
        high = y[y >= end]
        if (
            top == 2 * end - 1
            and high.size > OFTEN * y.size
            and high.min() > 2 * WRAPPED * end
            and np.unique(high).size > 2
        ):
            text = f"{high.size} pixels have values from {high.min():.7g} to {top:.7g}, and none from {end} to these"
            hint = f"a difference of {name} numbers seems to have wrapped below 0: subtract after y.astype(float)"
            return [Finding("sign", text, hint)]
    if light.size == 0 or light.mean() >= -BELOW * light.std(dtype=np.float64):
        return []
    hint = "too much may be subtracted from y, its sign may be wrong, or unsigned data may be read as signed"
    return [Finding("sign", text, hint)]


def centred(y: np.ndarray, negative: float) -> list[Finding]:
    """The finding of values y (N,) that are light although masks are about 0: such a part of their sums is negative."""
    below = np.maximum(-y, 0).sum()
    if negative <= CENTRED or below > BY_NOISE * np.abs(y).sum() or np.sum(y > 0) <= CENTRED * y.size:
        return []
    text = f"the sum of masks is negative in {negative:.0%} of the pixels, but y is nowhere"
    return [Finding("sign", text, "masks seem to be centred about 0; give transmissions, which are 0 or more")]
