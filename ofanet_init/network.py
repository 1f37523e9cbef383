"""OFaNet: amplifier, separator, flow net and refine net in one model; the configuration selects the variant."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from ofanet_init.amplifier import diversity, normalised
from ofanet_init.config import OFaNetConfig
from ofanet_init.flow import FlowNet
from ofanet_init.refine import Refiner
from ofanet_init.separator import Separator

LOUDER = 10.0  # factor on the residual, which is some hundredths where masks and frames span [0, 1]


class Estimates(NamedTuple):
    """Videos (N, V, B, H, W): the separator's `first`, and `refined`, which equals `first` without a refine net."""

    first: torch.Tensor
    refined: torch.Tensor


class OFaNet(nn.Module):
    """Optical-flow-aided network for dual-view video snapshot compressive imaging (Lu et al., simplified architecture).

    Parameters
    ----------
    config : OFaNetConfig

    Examples
    --------
    >>> model = OFaNet(OFaNetConfig(frames=4, refine="none"))
    >>> masks = (torch.rand(1, 2, 4, 16, 16) > 0.5).float()
    >>> model(masks.sum((1, 2)), masks).refined.shape
    torch.Size([1, 2, 4, 16, 16])
    """

    model, title = "ofanet", "OFaNet"

    def __init__(self, config: OFaNetConfig):
        super().__init__()
        self.config = config
        self.separator = Separator(config.views, config.frames, config.diversity, config.dual)
        self.flow = FlowNet().requires_grad_(config.joint) if config.uses_flow else None
        flows = {"none": 0, "forward": 1, "both": 2}[config.flow]
        if config.refine == "simplified":
            self.refiners = nn.ModuleList([Refiner(config.diversity, flows)])
        elif config.refine == "birecurrent":
            self.refiners = nn.ModuleList([Refiner(config.diversity, 1), Refiner(config.diversity, 1)])
        else:
            self.refiners = nn.ModuleList()

    def forward(
        self, y: torch.Tensor, masks: torch.Tensor, refine: bool = True, window: slice = slice(None), orders: int = 1,
        passes: int | None = None,
    ) -> Estimates:  # fmt: skip
        """Decode measurements.

        Parameters
        ----------
        y : Tensor, (N, H, W)
            In units where the video spans about [0, 1].
        masks : Tensor, (N, V, B, H, W) or (1, V, B, H, W)
            Values in [0, 1].
        refine : bool
            Whether flow and refine net follow the separator.
        window : slice
            Frames that the last pass refines, for training on some of them. The refined video holds these frames only.
        orders : int
            Number of cyclic orders of the views that the separator's video is averaged over, >= 1. With one order per
            view, the result does not depend on which view is the first.
        passes : int, optional
            Number of passes, >= 1; by default that of the configuration. Only the last pass has gradients.

        Returns
        -------
        Estimates
            Two Tensors (N, V, B, H, W).
        """
        height, width = y.shape[1:]
        if height % 2 or width % 2:
            padding = (0, width % 2, 0, height % 2)
            y = functional.pad(y[:, None], padding, "replicate")[:, 0]
            masks = functional.pad(masks.flatten(1, 2), padding, "replicate").unflatten(1, masks.shape[1:3])
        first = torch.stack([self._separated(y, masks, view) for view in range(orders)]).mean(0)
        refined = first
        if refine and self.refiners:
            images = self._images(y, masks)
            for left in reversed(range(self.config.passes if passes is None else passes)):
                part = slice(None) if left else window
                residual = normalised(y - (masks * refined).sum((1, 2)), masks)
                with torch.set_grad_enabled(torch.is_grad_enabled() and not left):
                    refined = self._refined(refined[:, :, part], through(masks[:, :, part], residual), images)
                if left:  # some versions of torch would reuse cached weights that have no gradients
                    torch.clear_autocast_cache()
        else:
            refined = refined[:, :, window]
        return Estimates(first[..., :height, :width], refined[..., :height, :width])

    def _images(self, y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """The images D (N, 2 V, H, W); (N, 0, H, W) without the amplifier."""
        return diversity(y, masks) if self.config.amplifier else y.new_zeros(len(y), 0, *y.shape[1:])

    def _separated(self, y: torch.Tensor, masks: torch.Tensor, view: int) -> torch.Tensor:
        """The separator's video (N, V, B, H, W), float32, for the cyclic order of views that begins with `view`."""
        turned = masks.roll(-view, 1)
        video = self.separator(normalised(y, turned), self._images(y, turned), turned)
        return video.float().roll(view, 1)

    def _refined(self, first: torch.Tensor, evidence: torch.Tensor, images: torch.Tensor) -> torch.Tensor:
        """Refine all views with shared weights; first: (N, V, B, H, W), evidence: (N, V, B, 2, H, W)."""
        views = first.shape[1]
        video, evidence = first.flatten(0, 1), evidence.flatten(0, 1)
        images = from_each_view(images, views)
        forward, backward = self._flows(video)
        if self.config.refine == "simplified":
            flows = {"none": [], "forward": [forward], "both": [forward, backward]}[self.config.flow]
            video = self.refiners[0](video, evidence, flows, images)
        else:
            video = self.refiners[0](video, evidence, [forward], images)
            video = self.refiners[1](video.flip(1), evidence.flip(1), [backward.flip(1)], images).flip(1)
        return video.unflatten(0, (-1, views))

    def _flows(self, video: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Flows t -> t + 1 and t + 1 -> t of a video (N, B, H, W), each (N, B - 1, 2, H, W)."""
        if self.flow is None or video.shape[1] == 1:
            nothing = video.new_zeros(len(video), video.shape[1] - 1, 2, *video.shape[2:])
            return nothing, nothing
        early, late = (part.flatten(0, 1)[:, None] for part in (video[:, :-1], video[:, 1:]))
        flows = self.flow.flow(torch.cat([early, late]), torch.cat([late, early]))
        forward, backward = flows.chunk(2)
        return forward.unflatten(0, (len(video), -1)), backward.unflatten(0, (len(video), -1))


def through(masks: torch.Tensor, residual: torch.Tensor) -> torch.Tensor:
    """For each frame its mask, and the residual (N, 1, H, W) times that mask: (N, V, B, 2, H, W)."""
    coded = masks * residual[:, None]
    return torch.stack([masks.expand_as(coded), LOUDER * coded], 3)


def from_each_view(images: torch.Tensor, views: int) -> torch.Tensor:
    """The images D (N, C, H, W) in the order of each view, (N V, C, H, W): its own image of each kind comes first.

    The views share the weights of the refine net, so the order identifies the image of the view.
    """
    kinds = images.unflatten(1, (-1, views))
    return torch.stack([kinds.roll(-v, 2) for v in range(views)], 1).flatten(2, 3).flatten(0, 1)
