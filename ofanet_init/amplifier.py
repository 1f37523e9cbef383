"""Energy normalisation and diversity amplifier: the network's inputs made from a measurement."""

from __future__ import annotations

import torch
from torch.nn import functional

BLUR = 2.0  # pixels: standard deviation of the Gaussian G; the paper gives no width
RADIUS = 6  # pixels: half width of the kernel of G
DARKEST = 0.5  # open masks: lower bound on a sum of masks in a denominator, limits the amplification of noise


def normalised(y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
    """Energy-normalised measurement: y divided by the sum of all masks.

    The paper uses ``Y / (sum of C / (2 B))``, which approximates the sum of all frames. The result here is that value
    divided by 2 B: the mean of all frames, in the units of the video. Sums below 1/2 are replaced by 1/2.

    y: (N, H, W); masks: (N, V, B, H, W), >= 0. Returns (N, 1, H, W).
    """
    return (y / masks.sum((1, 2)).clamp(min=DARKEST))[:, None]


def diversity(y: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
    """Diversity-amplified images, D_1 to D_4 for two views, in the units of :func:`normalised`.

    First ``D_v = Y / (sum over b of C_v^b / B)`` for each view v, then ``D_v - G(D_v)`` with a Gaussian filter G.
    All are scaled by ``1 / (V B)``. Where the masks of a view sum to less than 1/2, D_v is the normalised measurement.

    y: (N, H, W); masks: (N, V, B, H, W), >= 0. Returns (N, 2 V, H, W).
    """
    own = masks.sum(2)
    seen = y[:, None] / (masks.shape[1] * own.clamp(min=DARKEST))
    seen = torch.where(own < DARKEST, normalised(y, masks), seen)
    return torch.cat([seen, seen - blurred(seen)], 1)


def blurred(images: torch.Tensor) -> torch.Tensor:
    """The filter G: each image (N, C, H, W) convolved with a Gaussian, with reflection at the edges."""
    offsets = torch.arange(-RADIUS, RADIUS + 1, device=images.device, dtype=images.dtype)
    kernel = torch.exp(-0.5 * (offsets / BLUR) ** 2)
    kernel = kernel / kernel.sum()
    planes = images.reshape(-1, 1, *images.shape[2:])
    planes = functional.conv2d(_reflected(planes, (0, 0, RADIUS, RADIUS)), kernel[None, None, :, None])
    planes = functional.conv2d(_reflected(planes, (RADIUS, RADIUS, 0, 0)), kernel[None, None, None, :])
    return planes.reshape(images.shape)


def _reflected(planes: torch.Tensor, padding: tuple[int, int, int, int]) -> torch.Tensor:
    """Planes padded by reflection, or by replication where they are smaller than the padding."""
    large = planes.shape[-1] > padding[0] and planes.shape[-2] > padding[2]
    return functional.pad(planes, padding, "reflect" if large else "replicate")
