"""The decoders "unet", "admm-net" and "birnat", which also initialise the solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch.nn import functional

from ofanet_init.compared.admm_net import ADMMNet
from ofanet_init.compared.birnat import BIRNAT
from ofanet_init.compared.unet import UNet
from ofanet_init.prepared import in_units_of, projected, tensors, trained
from pnp_sci.accel.inference import running, usable
from pnp_sci.plugins.protocols import Decoder
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel


@dataclass(frozen=True)
class ComparedDecoder(Decoder):
    """A network as a decoder. Its video is projected onto the videos that measure y, as far as the noise allows.

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
        """Decode a measurement.

        Returns
        -------
        ndarray, (V, B, H, W)
            Of the operator's dtype, in the problem's units, not clipped.

        Raises
        ------
        InputError
            If there are no weights for so many views and frames, a mask is negative, or the device cannot be used.
        """
        views, frames, height, width = problem.op.shape
        place = usable(self.device)
        network = trained(self.model, views, frames, place)
        y, masks = tensors(problem, place)
        padding = (0, -width % network.multiple, 0, -height % network.multiple)
        y = functional.pad(y, padding, "replicate")
        masks = functional.pad(masks[0], padding, "replicate")[None]
        with running(place):
            video = network(y, masks)[-1]
        return projected(problem, in_units_of(problem, video[..., :height, :width]))


def unet(device: str | None = None) -> ComparedDecoder:
    """The decoder "unet": one convolutional network, :class:`ofanet_init.compared.unet.UNet`.

    Parameters
    ----------
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU.

    References
    ----------
    M. Qiao, Z. Meng, J. Ma & X. Yuan, "Deep learning for video compressive sensing", APL Photonics 5 (2020).
    """
    return ComparedDecoder(UNet.model, device)


def admm_net(device: str | None = None) -> ComparedDecoder:
    """The decoder "admm-net": unrolled ADMM with learned priors, :class:`ofanet_init.compared.admm_net.ADMMNet`.

    The argument is as for :func:`unet`.

    References
    ----------
    J. Ma, X.-Y. Liu, Z. Shou & X. Yuan, "Deep tensor ADMM-net for snapshot compressive imaging", ICCV 2019.
    """
    return ComparedDecoder(ADMMNet.model, device)


def birnat(device: str | None = None) -> ComparedDecoder:
    """The decoder "birnat": bidirectional recurrent network, :class:`ofanet_init.compared.birnat.BIRNAT`.

    The argument is as for :func:`unet`.

    References
    ----------
    Z. Cheng et al., "BIRNAT: bidirectional recurrent neural networks with adversarial training for video snapshot
    compressive imaging", ECCV 2020.
    """
    return ComparedDecoder(BIRNAT.model, device)
