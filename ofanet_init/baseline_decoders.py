"""The decoders "unet", "admm-net" and "birnat", which also initialise the solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from ofanet_init.baselines.admm_net import ADMMNet
from ofanet_init.baselines.birnat import BIRNAT
from ofanet_init.baselines.unet import UNet
from ofanet_init.prepared import in_units_of, network_for, projected, tensors
from pnp_sci.accel.inference import running, usable
from pnp_sci.plugins.protocols import Decoder
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel


@dataclass(frozen=True)
class BaselineDecoder(Decoder):
    """A network as a decoder.

    It runs once with each view as the first one, and the videos are averaged: the order of the views does not matter.
    The mean is projected onto the videos that measure y, as far as the noise allows.

    Parameters
    ----------
    model : "unet", "admm-net" or "birnat"
    device : str, optional
        Such as "cuda"; by default the CPU.
    """

    model: str
    device: str | None = None
    needs_scene = False

    def __call__(self, problem: Problem, scene: SceneModel) -> np.ndarray:
        """Decode a measurement; the video has the operator's dtype."""
        height, width = problem.op.shape[2:]
        place = usable(self.device)
        network = network_for(self.model, problem, place)
        y, masks = tensors(problem, network, place)
        padding = (0, -width % network.multiple, 0, -height % network.multiple)
        y = functional.pad(y, padding, "replicate")
        masks = functional.pad(masks[0], padding, "replicate")[None]
        with running(place):
            orders = [network(y, masks.roll(-v, 1))[-1].roll(v, 1) for v in range(masks.shape[1])]
            video = torch.stack(orders).mean(0)[..., :height, :width]
        return projected(problem, in_units_of(problem, video))


def unet(device: str | None = None) -> BaselineDecoder:
    """The decoder "unet": one convolutional network, :class:`ofanet_init.baselines.unet.UNet`.

    Parameters
    ----------
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU.

    References
    ----------
    M. Qiao, Z. Meng, J. Ma & X. Yuan, "Deep learning for video compressive sensing", APL Photonics 5 (2020).

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.decode(scene.y, scene.masks, model="unet").x.shape
    (2, 10, 64, 64)
    """
    return BaselineDecoder(UNet.model, device)


def admm_net(device: str | None = None) -> BaselineDecoder:
    """The decoder "admm-net": unrolled ADMM with learned priors, :class:`ofanet_init.baselines.admm_net.ADMMNet`.

    The argument is as for :func:`unet`.

    References
    ----------
    J. Ma, X.-Y. Liu, Z. Shou & X. Yuan, "Deep tensor ADMM-net for snapshot compressive imaging", ICCV 2019.
    """
    return BaselineDecoder(ADMMNet.model, device)


def birnat(device: str | None = None) -> BaselineDecoder:
    """The decoder "birnat": bidirectional recurrent network, :class:`ofanet_init.baselines.birnat.BIRNAT`.

    The argument is as for :func:`unet`.

    References
    ----------
    Z. Cheng et al., "BIRNAT: bidirectional recurrent neural networks with adversarial training for video snapshot
    compressive imaging", ECCV 2020.
    """
    return BaselineDecoder(BIRNAT.model, device)
