"""Networks as priors of a solver: total variation finds the scene first, then helps them."""

from __future__ import annotations

from numbers import Integral
from pathlib import Path

import numpy as np

from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import reset
from priors.ffdnet import FFDNet
from priors.motion.measure import may_show_motion
from priors.networks.denoiser import Learned, checked
from priors.tv import TV
from priors.video import VideoDenoiser

# Sigma of the networks, in that of the solver. Image net: with 1 clips of the validation lose too, with 2 the benchmark
# loses 0.3 dB and the clips gain 0.1. With one frame a view, for still scenes, 1.5 is as good as the best of 1 to 2.3,
# but for one view without noise, where less is better; 2.3 is 0.7 dB worse with two views, 3 with one. Video net, which
# knows what the averages have taken off: on 19 cases of validation clips, of all numbers of views and frames, 2.0 is
# 0.06 dB worse in the mean, 2.6 as good, and 0.1 dB worse with one view.
IMAGE, VIDEO = 1.5, 2.3
MOST = 0.25  # ... but not more than that, which is beyond most of what it has seen in training
# Sigma above which the network waits until it falls no further: it does best on frames that TV has mended. This, MOST
# and IMAGE were chosen by looking at clips of the validation and at three pairs of the benchmark.
NOISY = 0.12
# Calls of the video net between two estimates of the motion, each of which takes as long as three calls. On validation
# clips 3 and 4 are up to 0.1 and 0.05 dB better, 6 0.1 dB worse.
RENEW = 5
FIRST = 30  # calls of TV before the network sees anything: estimates before that are too poor to hold detail
# ... and before the video net does. On validation clips, 128 x 128, and with 30 calls after them, 60 gain 0.2 dB in the
# place of 30 from the adjoint and up to 0.1 from `ofanet-fast`; only with one view of 16 frames they lose 0.05 dB.
FIRST_OF_VIDEO = 60
# Strength of TV before the networks, against the grain that they leave; it also keeps 500 iterations stable: with 0.25
# before the video net they fall by 0.7 dB on a crop of 64 x 64; with 0.4, 19 cases of validation clips lose 0.05 dB.
# Where the network is told MOST, TV grows with the rest: with noise of 0.1 and 0.2 of max(y) that gains 0.2 and 0.5 dB.
BESIDE_IMAGE, BESIDE_VIDEO = 0.4, 0.3
# Root mean square, in sigmas, of what a view may bring anew, after FIRST calls. What a network does not believe the
# solver demands ever more loudly, until it is drawn all the same, where the scene is simple: there a pair of clips of
# 34 dB loses 1.3 dB in 20 iterations. Scenes in which much is left to mend stay below 2.6.
DEMAND = 2.8


class Assisted:
    """A network with a little total variation before it; TV alone at first, and while a large sigma is still falling.

    A sigma above 0.12 counts as falling in the first call, and then if it is smaller than in the call before. The
    network sees the frames turned or mirrored otherwise in every call, so that what it prefers of a direction averages
    out. After 30 calls what x brings of a view beside the last result may have 2.8 sigma, root mean square; more is
    scaled down to that: call :meth:`reset` before another video of the same shape.

    Parameters
    ----------
    net : Learned
    without : TV
        What denoises while the network does not.
    beside : TV
        What x passes through before the network sees it, told more than sigma where the network cannot be told enough.
    stronger : float
        Sigma that the network is told, in units of the solver's, > 0.
    first : int
        Calls at the beginning of a video that are left to `without`, >= 0; another shape of x begins a new one.
    motionless : Assisted, optional
        What serves in the place of this where frames cannot show motion: one of a view, or below 32 pixels a side.

    Raises
    ------
    InputError
        If `first` is not a whole number >= 0.

    Examples
    --------
    >>> denoise = ffdnet()
    >>> denoise(np.full((1, 2, 8, 8), 0.5), sigma=0.05).shape
    (1, 2, 8, 8)
    """

    learned = True

    def __init__(
        self, net: Learned, without: TV, beside: TV, stronger: float, first: int = 0, motionless: Assisted | None = None
    ):
        if not isinstance(first, Integral) or first < 0:
            raise InputError(f"first is {first!r}: a whole number >= 0 was expected")
        self.net, self.without, self.beside = net, without, beside
        self.stronger, self.first, self.motionless = stronger, int(first), motionless
        if isinstance(net, VideoDenoiser):
            self.finish = net.finish
        self.reset()

    def __repr__(self) -> str:
        return f"Assisted({self.net}, {self.without}, {self.beside}, {self.stronger}, first={self.first})"

    def reset(self) -> None:
        """Forget what TV keeps, the motion and the last result: the next call starts a new video."""
        self._calls, self._before = 0, np.inf
        self._fits: tuple[tuple[int, ...], np.dtype] | None = None
        self._last: np.ndarray | None = None  # what the network's last call has returned
        for denoiser in (self.net, self.without, self.beside, self.motionless):
            reset(denoiser)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W), values about [0, 1]; arguments, result and errors are those of the network."""
        x = checked(x, sigma)
        self.net.load()  # a wrong file or device is an error now, and not after calls of TV
        if self._fits != (x.shape, x.dtype):
            self.reset()
            self._fits = x.shape, x.dtype
        if self.motionless is not None and not may_show_motion(x.shape):
            return self.motionless(x, sigma)
        falling, self._before = sigma < self._before, sigma
        self._calls += 1
        if self._calls <= self.first or (falling and sigma > NOISY):
            self._last = None
            return self.without(x, sigma)
        if sigma > 0 and self._last is not None and self._calls > FIRST:
            x = within(DEMAND * sigma, x, self._last)
        told = self.stronger * sigma
        x = self.beside(x, max(1.0, told / MOST) * sigma)  # TV takes what the network is not told
        self._last = self.net(x, min(told, MOST), self._calls)
        return self._last.copy()

    @property
    def restless(self) -> bool:
        """Whether a solver's estimates flicker: with the motion, or from turn to turn where each view is one frame.

        Those of an image net in moving scenes do, too, but rise for longer.
        """
        if self.motionless is not None and self.motionless.restless:
            return True
        return self._last is not None and (getattr(self.net, "restless", False) or self._last.shape[1] == 1)

    @property
    def at_rest(self) -> list[float]:
        """The part of each view that stands still, as the network or TV has measured last; empty if neither has."""
        return getattr(self.net, "at_rest", []) or self.without.at_rest

    @property
    def sha256(self) -> str:
        """Hash of the values of the weights, 64 hexadecimal digits."""
        return self.net.sha256


def within(reach: float, x: np.ndarray, last: np.ndarray) -> np.ndarray:
    """x, each view of it no further from `last`, both (V, B, H, W), than `reach` (> 0) root mean square."""
    out = x.copy()
    for view, before in zip(out, last):
        step = view - before
        distance = float(np.sqrt(np.mean(step**2)))
        if distance > reach:
            view[:] = before + step * x.dtype.type(reach / distance)
    return out


def ffdnet(weights: str | Path | None = None, device: str | None = None, first: int = FIRST) -> Assisted:
    """A small network on each frame, after some calls of TV and with a little TV before it.

    Parameters
    ----------
    weights, device
        As for the network, :class:`priors.ffdnet.FFDNet`.
    first : int
        Calls at the beginning that TV has for itself, >= 0.
    """
    return Assisted(FFDNet(weights, device), TV(), TV(BESIDE_IMAGE, still=False), IMAGE, first)


def video(weights: str | Path | None = None, device: str | None = None, first: int = FIRST_OF_VIDEO) -> Assisted:
    """A network on frames averaged along their motion, after some calls of TV and with a little TV before it.

    One frame of a view, and frames below 32 pixels a side, cannot show motion: these it denoises as :func:`ffdnet`
    does, but for `first`.

    Parameters
    ----------
    weights, device
        As for the network, :class:`priors.video.VideoDenoiser`.
    first : int
        Calls at the beginning that TV has for itself, >= 0.
    """
    net = VideoDenoiser(weights, device, RENEW)
    motionless = Assisted(net.image, TV(), TV(BESIDE_IMAGE, still=False), IMAGE, first)
    return Assisted(net, TV(), TV(BESIDE_VIDEO, time=0), VIDEO, first, motionless)
