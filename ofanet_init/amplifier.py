"""Energy normalisation and diversity amplifier: what the network is shown of a measurement."""

from __future__ import annotations

import torch
from torch.nn import functional

BLUR = 2.0  # standard deviation in pixels of the smoothing G; the paper says "e.g. a Gaussian filter", no width
RADIUS = 6  # of its kernel
DARKEST = 0.5  # of one open mask: less in all frames together tells next to nothing, and would amplify noise


def normalised(y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
    """The energy-normalised measurement, divided by the number of frames: y over the sum of all masks.

    The paper's is ``Y / (sum of C / (2 B))``, about the sum of all frames; divided by 2 B it is their mean, in the
    units of the video, and any first layer takes the one as well as the other. Sums below 1/2 count as 1/2.

    y: (N, H, W); masks: (N, V, B, H, W), >= 0. Returns (N, 1, H, W).
    """
    return (y / masks.sum((1, 2)).clamp(min=DARKEST))[:, None]


def diversity(y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
    """The diversity-amplified images, D_1 to D_4 for two views, in the units of :func:`normalised`.

    ``D_v = Y / (sum over b of C_v^b / B)`` for each view, then ``D_v - G(D_v)`` for each, G a Gaussian; the factor here
    is ``1 / (V B)``. Where a view's masks sum to less than 1/2, being closed in all frames or nearly, that view tells
    nothing: D_v is the normalised measurement there.

    y: (N, H, W); masks: (N, V, B, H, W), >= 0. Returns (N, 2 V, H, W).
    """
    own = masks.sum(2)
    seen = y[:, None] / (masks.shape[1] * own.clamp(min=DARKEST))
    seen = torch.where(own < DARKEST, normalised(y, masks), seen)
    return torch.cat([seen, seen - blurred(seen)], 1)


def blurred(images: torch.Tensor) -> torch.Tensor:
    """G: each image (N, C, H, W) smoothed by a Gaussian, reflected at its edges."""
    offsets = torch.arange(-RADIUS, RADIUS + 1, device=images.device, dtype=images.dtype)
    kernel = torch.exp(-0.5 * (offsets / BLUR) ** 2)
    kernel = kernel / kernel.sum()
    planes = images.reshape(-1, 1, *images.shape[2:])
    planes = functional.conv2d(_reflected(planes, (0, 0, RADIUS, RADIUS)), kernel[None, None, :, None])
    planes = functional.conv2d(_reflected(planes, (RADIUS, RADIUS, 0, 0)), kernel[None, None, None, :])
    return planes.reshape(images.shape)


def _reflected(planes: torch.Tensor, padding: tuple[int, int, int, int]) -> torch.Tensor:
    """Padded by reflection where the planes are large enough, else by their edge."""
    large = planes.shape[-1] > padding[0] and planes.shape[-2] > padding[2]
    return functional.pad(planes, padding, "reflect" if large else "replicate")
