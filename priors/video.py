"""The prior "video": frames averaged along their motion, then a network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import whole
from pnp_sci.plugins.combine import begun
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.ffdnet import FFDNet
from priors.motion.measure import may_show_motion
from priors.networks.along_motion import VideoNet
from priors.session import TUNED as SESSION
from priors.session import NetworkSession
from priors.tv import TUNED as TOTAL_VARIATION
from priors.tv import TV


@dataclass(frozen=True)
class VideoNumbers(Tuned):
    """What the network is told."""

    stronger: float = 2.3  # sigma that the network is told, in units of the solver's: averages remove a part


TUNED = VideoNumbers()


@dataclass(frozen=True)
class Video(Prior):
    """Frames are averaged along their motion and denoised by a network, after a warm-up by total variation.

    Single frames, and frames below 32 pixels a side, cannot show motion: these are denoised as by
    :class:`priors.ffdnet.FFDNet`. Needs the extra ``learned``.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train video``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"`` for the networks; by default the CPU, in bfloat16 where the processor multiplies
        it natively.
    first : int
        Calls at the beginning of a video that are left to total variation, >= 0.
    renew : int
        Calls from one measurement of the motion to the next, >= 1.

    Raises
    ------
    InputError
        If `first` or `renew` is not such a whole number.

    References
    ----------
    K. Zhang, W. Zuo & L. Zhang, "FFDNet: toward a fast and flexible solution for CNN-based image denoising", IEEE TIP
    27 (2018).
    B. D. Lucas & T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI
    1981.
    M. Tassano, J. Delon & T. Veit, "DVDnet: a fast network for deep video denoising", ICIP 2019.

    Examples
    --------
    >>> import pnp_sci
    >>> pnp_sci.denoise(np.full((1, 2, 32, 32), 0.5), 0.05, Video()).shape
    (1, 2, 32, 32)
    """

    weights: str | Path | None = None
    device: str | None = None
    first: int = TOTAL_VARIATION.warmup
    renew: int = 4

    def __post_init__(self):
        whole("first", self.first, 0)
        whole("renew", self.renew, 1)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """A strong network; estimates change with the motion."""
        motion = may_show_motion(shape)
        average = shape[1] == 1 or motion
        return Traits(strong=True, network=True, warmup=(TV(), self.first), average=average, motion=motion)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session with the networks loaded, without motion."""
        return self.begin_on(shape, dtype, None)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str | None) -> Session:
        """The same, on tensors if there is a device."""
        if not may_show_motion(shape):
            return begun(FFDNet(device=self.device, first=self.first), shape, dtype, device)
        beside = begun(TV(SESSION.beside, time=0), shape, dtype, device)
        net = VideoNet(self.weights, device or self.device, self.renew)
        return NetworkSession(net, beside, TUNED.stronger, self.first)
