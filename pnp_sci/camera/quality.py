"""How good a calibration is, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci.camera.clipped import Clipped
from pnp_sci.masks import MaskCondition, condition

OPEN, CLOSED = 90, 10  # percentiles of an element's brightness that stand for open and closed ones


@dataclass(frozen=True)
class Quality:
    """Properties of a calibration; ``str()`` of it is a report.

    Attributes
    ----------
    contrast : tuple of float
        For each view ``(open - closed) / (open + closed)``; 1 if closed elements are black.
    noise : float or None
        Standard deviation of the averaged pictures, in parts of the lamp's brightness; None without repeats.
    drift : float
        Largest difference between the lamp's brightness in two pictures, in parts of it.
    uniformity : float
        Brightness of the darkest twentieth of the field, in parts of the brightest twentieth.
    bad : int
        Number of bad pixels.
    alike : tuple of (int, int, int)
        View, and two of its frames whose pictures are the same, counted from 1.
    missing : tuple of (int, int)
        View and frame of pictures that are dark, counted from 1.
    condition : MaskCondition
    clipped : tuple of Clipped
        Kinds of pictures, "white" or "patterns", that pile up at their largest value below full scale.
    """

    contrast: tuple[float, ...]
    noise: float | None
    drift: float
    uniformity: float
    bad: int
    alike: tuple[tuple[int, int, int], ...]
    missing: tuple[tuple[int, int], ...]
    condition: MaskCondition
    clipped: tuple[Clipped, ...] = ()

    @property
    def advice(self) -> list[str]:
        """What to do better, a sentence each."""
        told = list(map(str, self.clipped))
        told += [
            f"view {v}: the pictures of frames {a} and {b} are alike: was one taken twice?" for v, a, b in self.alike
        ]
        told += [f"view {v}: the picture of frame {b} is dark: is it missing?" for v, b in self.missing]
        for view, contrast in enumerate(self.contrast, 1):
            if contrast < 0.5:
                told.append(f"view {view}: the contrast is {contrast:.2f}: focus the masks, and keep stray light out")
        if self.noise is not None and self.noise > 0.02:
            told.append(f"the masks have {self.noise:.1%} of noise: take more pictures of each pattern")
        if self.drift > 0.05:
            told.append(f"the lamp drifts by {self.drift:.0%}: let it warm up")
        if self.uniformity < 0.3:
            told.append(f"the corners have {self.uniformity:.0%} of the light: crop, or light the target evenly")
        if self.bad > 0.01 * np.prod(self.condition.shape[2:]):
            told.append(f"{self.bad} pixels are bad: is the exposure too long?")
        return told

    def __str__(self) -> str:
        noise = "not known without repeats" if self.noise is None else f"{self.noise:.2%} of the lamp's brightness"
        lines = [
            f"contrast     {', '.join(f'{c:.2f}' for c in self.contrast)}",
            f"noise        {noise}",
            f"drift        {self.drift:.1%}",
            f"uniformity   {self.uniformity:.0%}",
            f"bad pixels   {self.bad}",
            *(f"advice       {sentence}" for sentence in self.advice),
            "",
            str(self.condition),
        ]
        return "\n".join(lines)


def lamp_gains(light: np.ndarray, response: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """The lamp's brightness (V, B) during each picture of light (V, B, H, W), in units of that of its view's median.

    Open elements show it, whatever the pattern: a high percentile of the light over the response (V, H, W) to white.
    """
    usable = ~bad & (response > 0).all(0)
    pairs = zip(light, response)
    shares = [[np.percentile(picture[usable] / full[usable], OPEN) for picture in view] for view, full in pairs]
    gains = np.array(shares)
    typical = np.median(gains, 1, keepdims=True)
    return np.where(gains > 0.5 * typical, gains / typical, 1.0)  # a picture that is missing has no gain


def measure_quality(
    masks: np.ndarray,
    shading: np.ndarray,
    pictures: np.ndarray,
    black: np.ndarray,
    bad: np.ndarray,
    gains: np.ndarray,
    piles: tuple[Clipped, ...],
) -> Quality:
    """The quality of masks (V, B, H, W), from pictures (V, B, N, H, W) and the shading (V, H, W)."""
    seen = ~bad if (~bad).any() else np.ones_like(bad)
    share = masks[:, :, seen] / np.maximum(shading[:, None, seen], 1e-3)
    opened, closed = (np.percentile(share, level, axis=(1, 2)) for level in (OPEN, CLOSED))
    contrast = (opened - closed) / np.maximum(np.abs(opened) + np.abs(closed), 1e-12)
    repeats = pictures.shape[2]
    noise = None
    if repeats > 1:
        lamp = np.median(np.abs((pictures.mean(2) - black)[:, :, seen]).max(1)) or 1.0
        noise = float(np.median(pictures[..., seen].std(2, ddof=1)) / np.sqrt(repeats) / lamp)
    levels = masks[:, :, seen].mean(2)
    missing = levels < 0.1 * np.median(levels, 1, keepdims=True)
    low, high = np.percentile(shading[:, seen], [5, 95], axis=1)
    return Quality(
        tuple(map(float, contrast)),
        noise,
        float(np.ptp(gains, 1).max()),
        float(np.min(low / np.maximum(high, 1e-12))),
        int(bad.sum()),
        tuple(_alike(masks, seen)),
        tuple((int(v) + 1, int(b) + 1) for v, b in np.argwhere(missing)),
        condition(masks),
        piles,
    )


def _alike(masks: np.ndarray, seen: np.ndarray) -> list[tuple[int, int, int]]:
    """Frames of a view that differ by no more than noise: their correlation is that of a picture with itself."""
    found = []
    for view, frames in enumerate(masks[:, :, seen], 1):
        if len(frames) < 2:
            continue
        with np.errstate(invalid="ignore"):
            equal = np.corrcoef(frames.astype(np.float64)) > 0.9
        found += [(view, int(a) + 1, int(b) + 1) for a, b in np.argwhere(np.triu(equal, 1))]
    return found
