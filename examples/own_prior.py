"""A prior of one's own: any callable ``(x, sigma)``, and any module of torch called the same way."""

import argparse

import numpy as np
from scipy.ndimage import gaussian_filter, median_filter

import pnp_sci
from pnp_sci.datasets import embedded_scene
from pnp_sci.metrics import psnr

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="64 x 64 pixels, 10 iterations")
options = arguments.parse_args()


def gaussian(x: np.ndarray, sigma: float) -> np.ndarray:
    """Blur rows and columns of x (V, B, H, W), the more the larger the noise."""
    width = 4 * sigma  # pixels
    return gaussian_filter(x, (0, 0, width, width))


class Median:
    """Median over 3 x 3 pixels, mixed in as far as it differs by no more than the noise."""

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        change = median_filter(x, (1, 1, 3, 3)) - x
        return x + np.clip(change, -2 * sigma, 2 * sigma)


priors = {"gaussian": gaussian, "median": Median(), "tv": "tv"}

try:
    import torch
except ImportError:
    print('torch is not installed: python -m pip install "pnp-sci[learned]"')
else:

    class Blur(torch.nn.Module):
        """The place for a network: pictures (..., H, W) in, pictures out."""

        def forward(self, x, sigma):
            pictures = x.reshape(-1, 1, *x.shape[-2:])
            padded = torch.nn.functional.pad(pictures, (1, 1, 1, 1), mode="replicate")
            return torch.nn.functional.avg_pool2d(padded, 3, stride=1).reshape(x.shape)

    priors["torch"] = Blur()

scene = embedded_scene(64 if options.small else 256)
for name, prior in priors.items():
    result = pnp_sci.solve(scene.y, scene.masks, prior, iterations=10 if options.small else None)
    views = " / ".join(f"{value:.2f}" for value in psnr(result.x, scene.truth))
    print(f"{name:10s} PSNR {views} dB   {result.status.value}")
