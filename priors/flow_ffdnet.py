"""Averages along motion of frames that a network has denoised: each mends what the other leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .ffdnet import FFDNet
from .flow import STRENGTH, Flow
from .tv import TV

BESIDE = 0.25  # strength of TV, against the grain that the network leaves; with none or 0.5 a little is lost
STRONGER = 1.5  # sigma of the network, in that of the solver; with 1 clips of the validation lose too, with 2 the
# benchmark loses 0.3 dB and the clips gain 0.1
MOST = 0.25  # ... but not more than that, which is a little beyond what it has seen in training
NOISY = 0.12  # sigma above which the network waits until it falls no further: it does best on frames that TV has mended


class _Frames:
    """A little total variation, then the network, frame by frame; TV alone while a large sigma is still falling."""

    def __init__(self, weights: str | Path | None, device: str | None):
        self.without, self.beside = TV(STRENGTH, time=0, inner=3), TV(BESIDE, time=0)
        self.net = FFDNet(weights, device)
        self.reset()

    def reset(self) -> None:
        self.before = np.inf
        self.without.reset()
        self.beside.reset()

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        falling, self.before = sigma < self.before, sigma
        if falling and sigma > NOISY:
            return self.without(x, sigma)
        return self.net(self.beside(x, sigma), min(STRONGER * sigma, MOST))


class FlowFFDNet(Flow):
    """The flow prior with a learned denoiser of frames in the place of most of its total variation.

    The network knows what a picture looks like and the averages along motion bring what neighbouring frames have seen;
    together they are far better than either. As :class:`priors.flow.Flow`, it begins with 30 calls of TV and stays with
    TV while sigma is above 0.35; while a sigma above 0.12 is falling, TV still does the network's part.

    Parameters
    ----------
    weights : path, optional
        Of the network; see :class:`priors.ffdnet.FFDNet`.
    device : str, optional
        Of the network.
    neighbours, tolerance, drift
        See :class:`priors.flow.Flow`.

    Raises
    ------
    InputError
        If a parameter is out of its range or x is not (V, B, H, W).
    DataUnavailableError
        If there is no such file of weights.

    Examples
    --------
    >>> x = np.zeros((1, 3, 32, 32), np.float32)
    >>> FlowFFDNet()(x, 0.05).shape
    (1, 3, 32, 32)
    """

    def __init__(
        self,
        weights: str | Path | None = None,
        device: str | None = None,
        neighbours: int = 3,
        tolerance: float = 2.2,
        drift: float = 1.5,
    ):
        self._learned = _Frames(weights, device)
        super().__init__(neighbours, tolerance, drift, self._learned)

    def __call__(self, x: Any, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1]; see :class:`priors.tv.TV` for the arguments."""
        self._learned.net.load()  # a wrong file or device is an error now, and not after 30 calls of TV
        return super().__call__(x, sigma, out)

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights, 64 hexadecimal digits."""
        return self._learned.net.sha256
