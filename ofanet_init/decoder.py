"""OFaNet as the decoders "ofanet" and "ofanet-fast", which also initialise the solvers."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
import torch

from ofanet_init.network import OFaNet
from ofanet_init.prepared import in_units_of, network_for, projected, tensors
from pnp_sci.accel.inference import running, usable
from pnp_sci.pipeline.blend import TUNED as BLEND
from pnp_sci.plugins.protocols import Decoder
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel

ROWS = 512  # rows that the separator decodes at a time, which bounds its memory
MARGIN = 64  # rows added on either side: the receptive field of the separator

_log = logging.getLogger("pnp_sci")


@dataclass(frozen=True)
class OFaNetDecoder(Decoder):
    """OFaNet as a decoder: separator, optical flow and recurrent refine net.

    The network's video is projected onto the videos that measure y, as far as the noise allows. Where the scene model
    says that nothing moves, the frames of the separator are averaged instead. With strong noise, flow and refine net
    make one pass over the video.

    Parameters
    ----------
    refine : bool
        Whether flow and refine net follow the separator. Where the weights hold none, a warning is logged.
    device : str, optional
        Such as "cuda"; by default the CPU.

    References
    ----------
    R. Lu et al., "Dual-view snapshot compressive imaging via optical flow aided recurrent neural network", IJCV (2021).
    The weights are our own, see the model card beside them.
    """

    refine: bool = True
    device: str | None = None

    @property
    def needs_scene(self) -> bool:
        """The separator alone makes no use of a scene model."""
        return self.refine

    def __call__(self, problem: Problem, scene: SceneModel) -> np.ndarray:
        """Decode a measurement; the video has the operator's dtype."""
        op = problem.op
        place = usable(self.device)
        network = network_for(OFaNet.model, problem, place)
        refine = self.refine and not scene.nothing_moves
        if refine and not network.refiners:
            _log.warning("OFaNet has no refine net for %d x %d frames: its separator decodes alone", *op.shape[:2])
        video = _decoded(network, problem, place, refine)
        if self.refine and scene.nothing_moves:
            return np.broadcast_to(video.mean(1, keepdims=True), op.shape).copy()
        return video


def ofanet(device: str | None = None) -> OFaNetDecoder:
    """The decoder "ofanet": separator, optical flow and recurrent refine net.

    Parameters
    ----------
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU.

    References
    ----------
    R. Lu, B. Chen, G. Liu, Z. Cheng, M. Qiao & X. Yuan, "Dual-view snapshot compressive imaging via optical flow aided
    recurrent neural network", International Journal of Computer Vision 129 (2021).

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.decode(scene.y, scene.masks, model="ofanet").x.shape
    (2, 10, 64, 64)
    """
    return OFaNetDecoder(True, device)


def ofanet_fast(device: str | None = None) -> OFaNetDecoder:
    """The decoder "ofanet-fast": diversity amplifier and separator, without refine net; arguments as :func:`ofanet`.

    References
    ----------
    Those of :func:`ofanet_init.decoder.ofanet`.
    """
    return OFaNetDecoder(False, device)


def _decoded(network: OFaNet, problem: Problem, place: torch.device, refine: bool) -> np.ndarray:
    op = problem.op
    # one pass where the noise of a pixel exceeds the network's errors
    passes = 1 if problem.typical_noise > BLEND.loud * np.sqrt(op.gram.mean()) else None

    def estimate(rows: slice) -> np.ndarray:
        with running(place):
            y, masks = tensors(problem, network, place, rows)
            video = network(y, masks, refine, orders=masks.shape[1], passes=passes).refined
        return in_units_of(problem, video)

    if refine and network.refiners:  # optical flow needs whole frames
        return projected(problem, estimate(slice(None)))
    x = np.empty(op.shape, op.dtype)
    for top in range(0, op.shape[2], ROWS):
        before = min(top, MARGIN)
        part = estimate(slice(top - before, top + ROWS + MARGIN))[:, :, before:]
        x[:, :, top : top + ROWS] = part[:, :, :ROWS]
    return projected(problem, x)
