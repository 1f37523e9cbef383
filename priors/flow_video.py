"""Averages along motion, then a learned prior: each mends what the other leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import InputError

from .flow import Flow
from .video import VideoDenoiser

STRENGTH = (
    0.5  # of TV in the flow prior, as the network sees to smoothness; with 1 or 0.25 validation clips lose 0.1 dB
)
LOUDEST = 0.3  # sigma, which no network here was trained beyond: with more, the flow prior (then TV) is as good alone


class FlowVideo:
    """Averages along motion, as `flow`, and after 50 calls the learned video denoiser on top of them.

    The flow prior brings back what neighbouring frames have seen and is at a loss where motion is too fast to be
    followed; the network knows what video looks like, but smooths away fine detail that stands still. One after the
    other in each call is better than either alone, for slow scenes and for fast ones.

    Parameters
    ----------
    alone : int
        Calls of the flow prior alone at the beginning, >= 0: the network is slow, and can do little with an estimate
        far from the scene. It also stays away from a sigma above 0.3.
    weights : path, optional
        Of the network; see :class:`priors.video.VideoDenoiser`.
    device : str, optional
        Of the network.

    Raises
    ------
    InputError
        If `alone` is out of its range, x is not (V, B, H, W), or the weights do not fit.

    Examples
    --------
    >>> x = np.zeros((1, 3, 32, 32), np.float32)
    >>> FlowVideo()(x, 0.05).shape
    (1, 3, 32, 32)
    """

    def __init__(self, alone: int = 50, weights: str | Path | None = None, device: str | None = None):
        if int(alone) != alone or alone < 0:
            raise InputError(f"alone is {alone}: a whole number >= 0 was expected")
        self.alone, self._flow, self._video = int(alone), Flow(strength=STRENGTH), VideoDenoiser(weights, device)
        self.reset()

    def __repr__(self) -> str:
        return f"FlowVideo(alone={self.alone}, device={self._video.device!r})"

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights, 64 hexadecimal digits."""
        return self._video.sha256

    def reset(self) -> None:
        """Forget the flow and what TV keeps: the next call starts a new video."""
        self._calls = 0
        self._flow.reset()

    def __call__(self, x: Any, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1], with noise of standard deviation sigma in the same units."""
        self._calls += 1
        x = self._flow(x, sigma)
        return x if self._calls <= self.alone or sigma > LOUDEST else self._video(x, sigma)
