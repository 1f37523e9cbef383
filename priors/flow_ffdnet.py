"""Averages along motion of frames that a network has denoised: each mends what the other leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .assisted import BESIDE, Assisted
from .ffdnet import FFDNet
from .flow import STRENGTH, Flow
from .tv import TV


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

    learned = True

    def __init__(
        self,
        weights: str | Path | None = None,
        device: str | None = None,
        neighbours: int = 3,
        tolerance: float = 2.2,
        drift: float = 1.5,
    ):
        self._learned = Assisted(FFDNet(weights, device), TV(STRENGTH, time=0, inner=3), TV(BESIDE, time=0))
        super().__init__(neighbours, tolerance, drift, self._learned)

    def __call__(self, x: Any, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1]; see :class:`priors.tv.TV` for the arguments."""
        self._learned.net.load()  # a wrong file or device is an error now, and not after 30 calls of TV
        return super().__call__(x, sigma, out)

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights, 64 hexadecimal digits."""
        return self._learned.sha256
