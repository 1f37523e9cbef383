"""The prior "ffdnet": a small network knows what pictures look like."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import whole
from pnp_sci.plugins.combine import begun
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.networks.image import ImageNet
from priors.session import TUNED as SESSION
from priors.session import NetworkSession
from priors.tv import TUNED as TOTAL_VARIATION
from priors.tv import TV


@dataclass(frozen=True)
class FFDNetNumbers(Tuned):
    """What the network is told, and what serves beside it."""

    stronger: float = 1.5  # sigma that the network is told, in units of the solver's


TUNED = FFDNetNumbers()


@dataclass(frozen=True)
class FFDNet(Prior):
    """A network denoises each frame, after a warm-up by total variation and with a little of it before each call.

    A network after FFDNet: it works on pixels unshuffled by two and takes a map of the noise level, so that one set of
    weights serves any noise (trained for standard deviations of 0 to 75 of 255). Unlike FFDNet it has three scales and
    a third of a million parameters, which makes it several times quicker. Needs the extra ``learned``.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train ffdnet``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU, in bfloat16 where the processor multiplies it natively.
    first : int
        Calls at the beginning of a video that are left to total variation, >= 0.

    Raises
    ------
    InputError
        If `first` is not a whole number >= 0.

    References
    ----------
    K. Zhang, W. Zuo & L. Zhang, "FFDNet: toward a fast and flexible solution for CNN-based image denoising", IEEE TIP
    27 (2018).

    Examples
    --------
    >>> import pnp_sci
    >>> pnp_sci.denoise(np.full((1, 2, 8, 8), 0.5), 0.05, FFDNet()).shape
    (1, 2, 8, 8)
    """

    weights: str | Path | None = None
    device: str | None = None
    first: int = TOTAL_VARIATION.warmup

    def __post_init__(self):
        whole("first", self.first, 0)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """A strong network; estimates of single frames change from turn to turn."""
        return Traits(strong=True, network=True, warmup=(TV(), self.first), average=shape[1] == 1)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session with the network loaded."""
        return self.begin_on(shape, dtype, None)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str | None) -> Session:
        """The same, on tensors if there is a device."""
        beside = begun(TV(SESSION.beside, still=False), shape, dtype, device)
        return NetworkSession(ImageNet(self.weights, device or self.device), beside, TUNED.stronger, self.first)
