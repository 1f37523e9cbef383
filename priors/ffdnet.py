"""A learned prior for single frames."""

from __future__ import annotations

from priors.networks.denoiser import Learned


class FFDNet(Learned):
    """Learned image denoiser, frame by frame.

    A network after FFDNet: it works on pixels unshuffled by two and takes a map of the noise level, so that one set of
    weights serves any noise (trained for standard deviations of 0 to 75 of 255; beyond, scale-equivariance stands in).
    Unlike FFDNet it has three scales and a third of a million parameters, which makes it several times quicker.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train ffdnet``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU, in bfloat16 where the processor multiplies it natively.

    References
    ----------
    K. Zhang, W. Zuo & L. Zhang, "FFDNet: toward a fast and flexible solution for CNN-based image denoising", IEEE TIP
    27 (2018).

    Examples
    --------
    >>> import numpy as np
    >>> denoise = FFDNet()
    >>> denoise(np.full((1, 2, 8, 8), 0.5), sigma=0).mean()  # no noise: nothing to do, nothing loaded
    np.float64(0.5)
    """

    name = "ffdnet"
