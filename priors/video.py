"""A learned prior for video: what a frame lacks, its neighbours may have seen."""

from __future__ import annotations

import hashlib
from numbers import Integral
from pathlib import Path

import numpy as np

from pnp_sci.errors import InputError
from priors.ffdnet import FFDNet
from priors.motion.measure import Motion, finished, may_show_motion, measure
from priors.networks.denoiser import LIMIT, Learned

NEIGHBOURS = 3  # frames either side that help a frame
TOLERANCE = 0.85  # difference between a frame and its warped neighbour at which that counts 1/e, in units of sigma
DRIFT = 1.5  # pixels between going there and back along the flow at which a neighbour counts 1/e
# Standard deviation along time, in units of sigma, at which a pixel counts 1/e as still: see MOVES of the motion. 0.3
# gains 0.03 dB more in the mean of those clips, but two views of 6 frames then lose up to 0.6; 0.7 loses 0.7 at worst.
REST = 0.2
# Part of sigma that the image net is told where frames are to show motion: detail tells more than grain. On validation
# clips 1 is 0.06 dB worse.
SHARP = 0.7
FAINT = 1e-4  # sigma below which an average is not worth it


class VideoDenoiser(Learned):
    """Learned video denoiser, view by view: each frame is averaged with its neighbours along their motion, then mended.

    The image net cleans the frames, and the cleaned frames show the motion. Along it the frames are averaged as they
    came, so that no detail is lost: what moves by itself is left alone, and pixels that stand still take the mean of
    all frames. A network of the same size takes off the noise
    that remains, whose level differs from pixel to pixel with the number of neighbours that agreed. It takes any noise
    level (trained for standard deviations of 0 to 75 of 255). Clips of one frame, or of frames below 32 pixels a side,
    show no motion and are left to the image net.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train video``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"`` for the networks; by default the CPU, in bfloat16 where the processor multiplies
        it natively.
    renew : int
        The motion is measured in every so many-th call and serves until then; with more than 1, the next search begins
        with it: for the estimates of a solver, which change little from call to call. :meth:`reset`, or another shape
        of x, forgets it.

    Raises
    ------
    InputError
        If `renew` is not a whole number >= 1.

    References
    ----------
    K. Zhang, W. Zuo & L. Zhang, "FFDNet: toward a fast and flexible solution for CNN based image denoising", TIP 2018.
    M. Tassano, J. Delon & T. Veit, "DVDnet: a fast network for deep video denoising", ICIP 2019.

    Examples
    --------
    >>> denoise = VideoDenoiser()
    >>> denoise(np.full((1, 2, 8, 8), 0.5), sigma=0).mean()  # no noise: nothing to do, nothing loaded
    np.float64(0.5)
    """

    name = "video"

    def __init__(self, weights: str | Path | None = None, device: str | None = None, renew: int = 1):
        if not isinstance(renew, Integral) or renew < 1:
            raise InputError(f"renew is {renew!r}: a whole number >= 1 was expected")
        super().__init__(weights, device)
        self.image, self.renew = FFDNet(device=device), int(renew)
        self.reset()

    def reset(self) -> None:
        """Forget the motion: the next call starts a new video."""
        self._calls = 0
        self._fits: tuple[int, ...] | None = None
        self._motion: list[Motion] = []
        self.at_rest: list[float] = []  # part of each view that stands still, as last measured

    @property
    def restless(self) -> bool:
        """Whether a solver's estimates flicker, with the motion as measured."""
        return self._calls > 0

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights of both networks, 64 hexadecimal digits."""
        return hashlib.sha256(f"{super().sha256} {self.image.sha256}".encode()).hexdigest()

    def load(self) -> None:
        """Read the weights of both networks now; else the first call does it."""
        super().load()
        self.image.load()

    def _noise(self, x: np.ndarray, sigma: float, turn: int) -> np.ndarray:
        if self._fits != x.shape:
            self.reset()
            self._fits = x.shape
        if not may_show_motion(x.shape) or sigma < FAINT:
            return self.image._noise(x, sigma, turn)
        if self._calls % self.renew == 0 or not self._motion:
            self._motion = see(self.image, x, sigma, self._motion if self.renew > 1 else None)
            self.at_rest = [seen.at_rest for seen in self._motion]
        self._calls += 1
        mean, level = averaged(x, sigma, self._motion)
        frames = mean.reshape(-1, *x.shape[2:]), level.reshape(-1, *x.shape[2:])
        noise = x - mean + self._runner.noise(*frames, turn).reshape(x.shape)
        return np.clip(noise, -LIMIT * sigma, LIMIT * sigma)

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """The last estimate x (V, B, H, W) of a solver, averaged once more, along the motion that it shows itself.

        `sigma` is the solver's. Where calls have measured no motion, x comes back as it is.
        """
        if not self._motion:
            return x
        self._motion = []  # a further call measures it anew; until then it would take memory
        return finished(x, sigma, NEIGHBOURS, DRIFT, REST * sigma)


def see(image: FFDNet, x: np.ndarray, sigma: float, before: list[Motion] | None = None) -> list[Motion]:
    """The motion of each view of x (V, B, H, W), with noise of standard deviation `sigma`, as the image net shows it.

    The search begins with the motion `before` of earlier estimates of the views.
    """
    views = zip(image(x, SHARP * sigma), before or [None] * len(x))
    return [measure(view, NEIGHBOURS, TOLERANCE * sigma, DRIFT, REST * sigma, motion) for view, motion in views]


def averaged(x: np.ndarray, sigma: float, motion: list[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Each view of x (V, B, H, W) averaged along its motion, and the standard deviation of the noise that is left."""
    mean = np.empty_like(x)
    for view, seen, out in zip(x, motion, mean):
        seen.average(view, out)
    return mean, np.float32(sigma) * np.stack([seen.remaining for seen in motion])
