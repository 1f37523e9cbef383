"""The network for single frames. Construction imports torch and reads the weights."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pnp_sci._optional import needed_for
from pnp_sci.accel.arrays import copied, library, single

if TYPE_CHECKING:
    from priors.networks.runner import Runner

WEIGHTS = Path(__file__).parents[1] / "weights"


def runner(name: str, weights: str | Path | None = None, device: str | None = None) -> Runner:
    """The network `name` on its device, with the weights of a file or of this package.

    Raises
    ------
    ImportError
        If PyTorch or safetensors is not installed.
    DataUnavailableError, FormatError, InputError
        If the file does not exist or cannot be read, or the device cannot be used.
    """
    with needed_for(f"the prior {name!r}", "learned"):
        from priors.networks.runner import opened
    return opened(Path(weights or WEIGHTS / f"{name}.safetensors"), name, device)


class ImageNet:
    """Denoiser for single frames: ``x - noise(x, sigma)``.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train ffdnet``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU, in bfloat16 where it has native instructions for it.

    Examples
    --------
    >>> import numpy as np
    >>> denoise = ImageNet()
    >>> float(denoise(np.full((1, 2, 8, 8), 0.5), sigma=0).mean())
    0.5
    """

    def __init__(self, weights: str | Path | None = None, device: str | None = None):
        self.runner = runner("ffdnet", weights, device)
        self.still: list[float] = []  # still pixels cannot be detected in single frames

    @property
    def hashes(self) -> list[str]:
        """SHA-256 of the weights, 64 hexadecimal digits."""
        return [self.runner.sha256]

    def __call__(self, x: Any, sigma: float, turn: int = 0) -> Any:
        """Denoise.

        Parameters
        ----------
        x : ndarray or Tensor, (V, B, H, W)
            Values about [0, 1], float32 or float64.
        sigma : float
            Standard deviation of the noise in the same units, >= 0. No pixel changes by more than 6 sigma.
        turn : int
            Orientation of the frames at the network's input, modulo 8: number of quarter turns; mirrored from 4 to 7.

        Returns
        -------
        ndarray or Tensor, (V, B, H, W)
            A new one of x's dtype.
        """
        if sigma == 0:
            return copied(x)
        frames = single(x.reshape(-1, *x.shape[2:]))
        return x - self.runner.noise(frames, library(x).full_like(frames, sigma), turn).reshape(x.shape)

    def finish(self, x: Any, sigma: float) -> Any:
        """Return x, a solver's last estimate, unchanged: this network does not use motion."""
        return x
