"""A learned prior for video."""

from __future__ import annotations

from ._learned import Learned


class VideoDenoiser(Learned):
    """Learned video denoiser, view by view.

    A U-net of a million parameters on pixels unshuffled by two. Each frame enters with the two before and after it,
    and each residual block takes part of its channels from the neighbouring frames (temporal shift): every frame is
    computed once, yet draws on some ten frames either side. At the ends of the clip the window is reflected. Takes the
    noise level as an input (trained for standard deviations of 0 to 75 of 255; beyond, scale-equivariance stands in).

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train video``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"``; by default the CPU, in bfloat16 where the processor multiplies it natively.

    Notes
    -----
    A clip of more than 2**24 pixels is denoised in overlapping pieces, which bounds memory to some three gigabytes.

    References
    ----------
    C. Qi et al., "Real-time streaming video denoising with bidirectional buffers", ACM Multimedia (2022).

    Examples
    --------
    >>> import numpy as np
    >>> denoise = VideoDenoiser()
    >>> denoise(np.full((1, 2, 8, 8), 0.5), sigma=0).mean()  # no noise: nothing to do, nothing loaded
    np.float64(0.5)
    """

    name = "video"
