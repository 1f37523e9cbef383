"""What the learned priors share. Torch is imported, and the weights are read, at the first call."""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pnp_sci.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from priors.networks.runner import Runner


LIMIT = 6.0  # no pixel moves by more standard deviations than this: white noise exceeds it once in 5e8 pixels


def checked(x: Any, sigma: float) -> np.ndarray:
    """x as an array, if the networks can take it and sigma; else InputError or InputTypeError."""
    x = np.asarray(x)
    if x.dtype not in (np.float32, np.float64):
        raise InputTypeError(f"x holds {x.dtype}, but float32 or float64 was expected")
    if x.ndim != 4 or 0 in x.shape:
        raise InputError(f"x has shape {x.shape}, but views x frames x rows x columns was expected, none of them 0")
    if not (math.isfinite(sigma) and sigma >= 0):
        raise InputError(f"sigma is {sigma}, but a finite number >= 0 was expected")
    return x


class Learned:
    """Denoiser ``x - noise(x, sigma)`` by a network of this package; see :class:`FFDNet` and :class:`VideoDenoiser`."""

    name: ClassVar[str]
    learned = True

    def __init__(self, weights: str | Path | None = None, device: str | None = None):
        self.weights = Path(weights or Path(__file__).parents[1] / "weights" / f"{self.name}.safetensors")
        self.device = device

    def __repr__(self) -> str:
        return f"{type(self).__name__}(weights={self.weights.name!r}, device={self.device!r})"

    @cached_property
    def _runner(self) -> Runner:
        try:
            from priors.networks.runner import Runner
        except ImportError as error:
            raise ImportError(
                f"the prior '{self.name}' needs torch and safetensors: pip install 'pnp-sci[learned]'"
            ) from error
        return Runner(self.weights, self.name, self.device)

    def load(self) -> None:
        """Read the weights now; else the first call does it."""
        _ = self._runner

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights, 64 hexadecimal digits."""
        return self._runner.sha256

    def __call__(self, x: np.ndarray, sigma: float, turn: int = 0) -> np.ndarray:
        """Denoise.

        Parameters
        ----------
        x : ndarray, shape (V, B, H, W)
            Views, frames, rows, columns; values about [0, 1], float32 or float64. Any sizes of at least 1.
        sigma : float
            Standard deviation of the noise in the same units, >= 0. No pixel moves by more than six times that.
        turn : int
            How the network sees the frames: after so many quarter turns, from 4 to 7 mirrored; and so on, modulo 8.

        Returns
        -------
        ndarray, shape (V, B, H, W)
            A new array of x's dtype.

        Raises
        ------
        pnp_sci.errors.InputError
            If x has not four dimensions or an empty one, or sigma is negative or not finite.
        pnp_sci.errors.InputTypeError
            If x does not hold floating-point numbers.
        """
        x = checked(x, sigma)
        if sigma == 0:
            return x.copy()
        return x - self._noise(np.ascontiguousarray(x, np.float32), float(sigma), turn)

    def _noise(self, x: np.ndarray, sigma: float, turn: int) -> np.ndarray:
        """Estimate the noise in x (V, B, H, W), float32."""
        frames = x.reshape(-1, *x.shape[2:])
        return self._runner.noise(frames, np.full_like(frames, sigma), turn).reshape(x.shape)
