"""The network for video: it removes the residual noise of averages along the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import single
from priors.motion.measure import TUNED as MOTION
from priors.motion.measure import may_show_motion
from priors.motion.videos import VideoMotion, finished, seen
from priors.networks import LIMIT
from priors.networks.image import ImageNet, runner

FAINT = 1e-4  # sigma below which frames are not averaged


@dataclass(frozen=True)
class VideoNetNumbers(Tuned):
    """Parameters of the averages along the motion, in units of sigma where no unit is given."""

    tolerance: float = 0.85  # difference between a frame and a warped neighbour at which the weight is 1/e
    rest: float = 0.2  # standard deviation along time at which a pixel counts 1/e as still
    sharp: float = 0.7  # noise level of the image net whose output the motion is estimated from


TUNED = VideoNetNumbers()


class VideoNet:
    """Denoiser for video: averages of neighbouring frames along their motion, then a network, view by view.

    The motion is estimated from frames that the image net has denoised. The noisy frames are averaged along it, which
    keeps their detail. A network of the same size removes the residual noise. Its level varies between pixels with the
    weights of the neighbours. Single frames, and frames too small for optical flow, are denoised by the image net.

    Parameters
    ----------
    weights : path, optional
        Safetensors file written by ``python -m priors.train video``; by default the weights of this package.
    device : str, optional
        Torch device such as ``"cuda"`` for the networks; by default the CPU.
    renew : int
        Number of calls from one motion estimate to the next, >= 1. If it is more than 1, each search starts from the
        last motion, which suits the slowly changing estimates of a solver.

    References
    ----------
    M. Tassano, J. Delon & T. Veit, "DVDnet: a fast network for deep video denoising", ICIP 2019.
    """

    def __init__(self, weights: str | Path | None = None, device: str | None = None, renew: int = 1):
        self.runner, self.image, self.renew = runner("video", weights, device), ImageNet(device=device), renew
        self.calls = 0
        self.motion: VideoMotion | None = None
        self.still: list[float] = []  # fraction of still pixels of each view, of the last motion

    @property
    def hashes(self) -> list[str]:
        """SHA-256 of the weights of each network."""
        return [self.runner.sha256, *self.image.hashes]

    def __call__(self, x: Any, sigma: float, turn: int = 0) -> Any:
        """Denoise x (V, B, H, W), of the same shape in all calls; arguments and result as for :class:`ImageNet`."""
        if not may_show_motion(x.shape) or sigma < FAINT:
            return self.image(x, sigma, turn)
        frames = single(x)
        if self.calls % self.renew == 0 or self.motion is None:
            self.motion = see(self.image, frames, sigma, self.motion if self.renew > 1 else None)
            self.still = self.motion.at_rest
        self.calls += 1
        return x - noise(frames, sigma, self.motion, partial(self.runner.noise, turn=turn))

    def finish(self, x: Any, sigma: float) -> Any:
        """Average a solver's last estimate x (V, B, H, W) along the motion estimated from x; sigma is the last one."""
        if self.motion is None:
            return x
        self.motion = None  # frees its memory
        return finished(x, sigma, MOTION.neighbours, MOTION.drift, TUNED.rest * sigma)


def see(image: ImageNet, x: Any, sigma: float, before: VideoMotion | None = None) -> VideoMotion:
    """Motion of each view of x (V, B, H, W), with noise of standard deviation `sigma`, after the image net.

    The search starts from the motion `before` of earlier estimates of the views.
    """
    seeing = MOTION.neighbours, TUNED.tolerance * sigma, MOTION.drift, TUNED.rest * sigma
    return seen(image(x, TUNED.sharp * sigma), *seeing, before)


def averaged(x: Any, sigma: float, motion: VideoMotion) -> tuple[Any, Any]:
    """Averages of x (V, B, H, W) along the motion of each view, and the standard deviation of their noise."""
    return motion.average(x), motion.remaining * sigma


def noise(x: Any, sigma: float, motion: VideoMotion, network: Callable[[Any, Any], Any]) -> Any:
    """Noise of x (V, B, H, W): what averages along the motion remove, and what the network finds in the averages."""
    mean, level = averaged(x, sigma, motion)
    flat = (-1, *x.shape[2:])
    total = x - mean + network(mean.reshape(flat), level.reshape(flat)).reshape(x.shape)
    return total.clip(-LIMIT * sigma, LIMIT * sigma)
