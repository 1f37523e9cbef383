"""OFaNet: amplifier, separator, flow and refine net in one model, every variant by its configuration."""

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

LOUDER = 10.0  # times: so that the residual is seen beside masks and frames, in whose units it is some hundredths


class Estimates(NamedTuple):
    """Videos (N, V, B, H, W): the separator's, and the refined one (the same without refine net)."""

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
            False stops behind the separator.
        window : slice
            The frames that the last pass refines, for training on a part of them: those are the refined video.
        orders : int
            The separator's video is the mean of so many: each view comes first in one of them. With as many as views,
            it does not matter which view is the first.
        passes : int, optional
            Instead of the configuration's, >= 1. Gradients come from the last only.
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
                if left:  # else some versions of torch use weights again that were made without gradients
                    torch.clear_autocast_cache()
        else:
            refined = refined[:, :, window]
        return Estimates(first[..., :height, :width], refined[..., :height, :width])

    def _images(self, y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """The images D (N, 2 V, H, W), or none of them without the amplifier."""
        return diversity(y, masks) if self.config.amplifier else y.new_zeros(len(y), 0, *y.shape[1:])

    def _separated(self, y: torch.Tensor, masks: torch.Tensor, view: int) -> torch.Tensor:
        """The separator's video (N, V, B, H, W), float32, when the masks come to it with those of `view` first."""
        turned = masks.roll(-view, 1)
        video = self.separator(normalised(y, turned), self._images(y, turned), turned)
        return video.float().roll(view, 1)

    def _refined(self, first: torch.Tensor, evidence: torch.Tensor, images: torch.Tensor) -> torch.Tensor:
        """All views at once, with the same weights; evidence: (N, V, B, 2, H, W)."""
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
    """For each frame its mask, and the residual (N, 1, H, W) through it: (N, V, B, 2, H, W)."""
    coded = masks * residual[:, None]
    return torch.stack([masks.expand_as(coded), LOUDER * coded], 3)


def from_each_view(images: torch.Tensor, views: int) -> torch.Tensor:
    """The images D (N, C, H, W) for each view (N V, C, H, W): of either kind its own comes first.

    The refine net is the same for all views, and could not tell otherwise which of the images is whose.
    """
    kinds = images.unflatten(1, (-1, views))
    return torch.stack([kinds.roll(-v, 2) for v in range(views)], 1).flatten(2, 3).flatten(0, 1)
