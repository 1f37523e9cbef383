"""Two priors that find motion and likeness each in its own way, together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pnp_sci.plugins.combine import Joint
from priors.assisted import FIRST_OF_VIDEO, video
from priors.flow import Flow
from priors.motion.measure import may_show_motion

# What `flow` and `video` count. On 18 moving cases of validation clips, with few frames and many, one view and two,
# with noise and without, `video` alone has 0.06 to 0.23 dB less in the mean of a kind; in one case 0.04 more.
# Counting the same they gain 0.05 dB less; the mean of the results of two solvers gains as much. (With `flow` of two
# neighbours; with three, as it is now, `both` is as good.)
SHARES = 0.3, 0.7


class Both(Joint):
    """Means, 3 parts to 7, of what the priors `flow` and `video` make of frames that move; else `video` alone.

    They err differently: they find the motion in other pictures, and what one draws where it knows too little the other
    does not. Clips of one frame, and frames below 32 pixels a side, show no motion: there a mean is no better.

    Parameters
    ----------
    weights, device
        As for the network, :class:`priors.video.VideoDenoiser`.
    first : int
        Calls at the beginning that TV has for itself, >= 0.

    Raises
    ------
    InputError
        If `first` is not a whole number >= 0.

    Examples
    --------
    >>> denoise = Both()
    >>> denoise(np.full((1, 2, 8, 8), 0.5), sigma=0.05).shape
    (1, 2, 8, 8)
    """

    def __init__(self, weights: str | Path | None = None, device: str | None = None, first: int = FIRST_OF_VIDEO):
        self.flow, self.video = Flow(first=first), video(weights, device, first)
        super().__init__([self.flow, self.video], SHARES)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1]; arguments, result and errors are those of `video`."""
        if np.ndim(x) == 4 and may_show_motion(np.shape(x)):
            return super().__call__(x, sigma)
        self.flow.reset()  # another video begins
        return self.video(x, sigma)
