"""The network for video: it removes what averages along the motion leave of the noise."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from priors.motion.measure import Motion, finished, may_show_motion, measure
from priors.networks import LIMIT
from priors.networks.image import ImageNet, runner

NEIGHBOURS = 3  # frames either side that help a frame
TOLERANCE = 0.85  # difference between a frame and its warped neighbour at which that counts 1/e, in units of sigma
DRIFT = 1.5  # pixels between going there and back along the flow at which a neighbour counts 1/e
REST = 0.2  # standard deviation along time, in units of sigma, at which a pixel counts 1/e as still
SHARP = 0.7  # part of sigma that the image net is told where frames are to show motion
FAINT = 1e-4  # sigma below which frames are not averaged


class VideoNet:
    """Denoises view by view: each frame is averaged with its neighbours along their motion, then a network serves.

    The image net cleans the frames, and the cleaned frames show the motion. Along it the frames are averaged as they
    came, so that no detail is lost. A network of the same size removes the noise that remains, whose level differs from
    pixel to pixel with the number of neighbours that agreed. Frames that cannot show motion are left to the image net.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train video``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"`` for the networks; by default the CPU.
    renew : int
        The motion is measured in every so many-th call and serves until then; with more than 1, the next search begins
        with it, for the estimates of a solver, which change little from call to call.

    References
    ----------
    M. Tassano, J. Delon & T. Veit, "DVDnet: a fast network for deep video denoising", ICIP 2019.
    """

    def __init__(self, weights: str | Path | None = None, device: str | None = None, renew: int = 1):
        self.runner, self.image, self.renew = runner("video", weights, device), ImageNet(device=device), renew
        self.calls = 0
        self.motion: list[Motion] = []
        self.still: list[float] = []  # part of each view that stands still, as last measured

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights of both networks, 64 hexadecimal digits."""
        return hashlib.sha256(f"{self.runner.sha256} {self.image.sha256}".encode()).hexdigest()

    def __call__(self, x: np.ndarray, sigma: float, turn: int = 0) -> np.ndarray:
        """Denoise x (V, B, H, W), all calls the same shape; arguments and result as those of :class:`ImageNet`."""
        if not may_show_motion(x.shape) or sigma < FAINT:
            return self.image(x, sigma, turn)
        frames = np.ascontiguousarray(x, np.float32)
        if self.calls % self.renew == 0 or not self.motion:
            self.motion = see(self.image, frames, sigma, self.motion if self.renew > 1 else None)
            self.still = [seen.at_rest for seen in self.motion]
        self.calls += 1
        mean, level = averaged(frames, sigma, self.motion)
        flat = (-1, *x.shape[2:])
        noise = frames - mean + self.runner.noise(mean.reshape(flat), level.reshape(flat), turn).reshape(x.shape)
        return x - np.clip(noise, -LIMIT * sigma, LIMIT * sigma)

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """A solver's last estimate x (V, B, H, W), averaged along the motion that it shows itself; sigma is its own."""
        if not self.motion:
            return x
        self.motion = []  # its memory is needed no more
        return finished(x, sigma, NEIGHBOURS, DRIFT, REST * sigma)


def see(image: ImageNet, x: np.ndarray, sigma: float, before: list[Motion] | None = None) -> list[Motion]:
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
