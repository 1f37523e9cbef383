"""The prior "flow": averages along motion, then block matching."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import positive_number, true_or_false, whole
from pnp_sci.plugins.combine import begun
from pnp_sci.plugins.protocols import Prior, Session, Traits
from priors.bm3d import BM3D
from priors.kernels.still import TUNED as STILL
from priors.motion.measure import TUNED as MOTION
from priors.motion.measure import may_show_motion
from priors.motion.videos import VideoMotion, finished, seen
from priors.tv import TUNED as TOTAL_VARIATION
from priors.tv import TV

FAINT = 1e-4  # tolerance, where x spans [0, 1], below which v is returned as it is


@dataclass(frozen=True)
class FlowNumbers(Tuned):
    """Averages along motion, in units of the solver's sigma where nothing else is said."""

    strength: float = 0.25  # strength of TV beside the averages
    loud: float = 0.35  # sigma above which noise hides the motion, where x spans [0, 1]
    grain: float = 1.6  # noise that BM3D is told, in units of what the averages leave


TUNED = FlowNumbers()


@dataclass(frozen=True)
class Flow(Prior):
    """Each frame of a view averaged with its neighbours along their motion, on top of total variation.

    Total variation serves the first 60 calls, and goes on while sigma is above 0.35. After a decoder's estimate, or
    with `first` 0, there is no such warm-up. In every third call after it optical flow is estimated from each frame
    directly to its neighbours; chains of flows would drift. In each pixel the flow is replaced by a steady motion if
    frames match better along that, or by the flow of its surroundings if they match about as well. A neighbour weighs
    little where forward and backward flow do not cancel, or where the warped neighbour differs from the frame. As a
    whole it counts less if it differs more than adjacent frames do. Pixels that stand still are averaged over all
    frames.

    Each call denoises the frames by a light total variation, and averages each with its warped neighbours by these
    weights. :class:`priors.bm3d.BM3D` filters the result; it is told 1.6 times the noise that the average leaves in
    each pixel. Single frames are left to BM3D, frames below 32 pixels a side to total variation.

    Parameters
    ----------
    neighbours : int
        Frames either side that help a frame, >= 1.
    tolerance : float
        Difference between a frame and its warped neighbour, both averaged once, at which the weight falls to 1/e, > 0,
        in units of sigma.
    drift : float
        Distance in pixels between going there and back along the flow at which the weight falls to 1/e, > 0.
    first : int
        Calls at the beginning of a video that are left to TV, >= 0.
    still : bool
        Whether pixels that stand still are averaged over all frames.
    renew : int
        Calls from one measurement of the motion to the next, >= 1.
    displace : bool
        Whether the solver displaces frames before each call where the data say so.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    References
    ----------
    B. D. Lucas & T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI
    1981.
    T. Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016.
    A. Buades, J.-L. Lisani & M. Miladinovic, "Patch-based video denoising with optical flow estimation", TIP 2016.
    Those of :class:`priors.bm3d.BM3D` and :class:`priors.tv.TV`.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> pnp_sci.denoise(np.zeros((1, 3, 32, 32)), 0.05, Flow()).shape
    (1, 3, 32, 32)
    """

    neighbours: int = MOTION.neighbours
    tolerance: float = 2.6
    drift: float = MOTION.drift
    first: int = TOTAL_VARIATION.warmup
    still: bool = True
    renew: int = 3
    displace: bool = True

    def __post_init__(self):
        whole("neighbours", self.neighbours, 1)
        whole("first", self.first, 0)
        whole("renew", self.renew, 1)
        for name in ("tolerance", "drift"):
            positive_number(name, getattr(self, name))
        for name in ("still", "displace"):
            true_or_false(name, getattr(self, name))

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Strong after total variation; estimates change with the motion and the groups."""
        if shape[1] > 1 and not may_show_motion(shape):
            return Traits()
        first = TV(still=self.still), self.first
        motion = self.displace and shape[1] > 1
        return Traits(strong=True, warmup=first, serves_below=TUNED.loud, average=True, motion=motion)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session without motion; of BM3D for single frames, of total variation for small ones."""
        return self.begin_on(shape, dtype, None)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str | None) -> Session:
        """The same, on tensors if there is a device, but for BM3D, which runs on the CPU."""
        if shape[1] > 1 and not may_show_motion(shape):
            return begun(TV(still=self.still), shape, dtype, device)
        patches = begun(BM3D(), shape, dtype, device)
        if shape[1] == 1:
            return patches
        return FlowSession(self, begun(TV(TUNED.strength, time=0), shape, dtype, device), patches)


class FlowSession(Session):
    """Averages along the motion of one video, then BM3D."""

    def __init__(self, prior: Flow, frames: Session, patches: Session):
        self.prior, self.calls = prior, 0
        self.frames, self.patches = frames, patches
        self.motion: VideoMotion | None = None
        self.still: list[float] = []
        self.left: Any = None  # of each pixel, what BM3D is told, in units of sigma

    def __call__(self, v: Any, sigma: float, out: Any = None) -> Any:
        """Denoise v (V, B, H, W)."""
        if self.prior.tolerance * sigma < FAINT:
            return v
        self.calls += 1
        mean = self._averaged(self.frames(v, sigma), sigma)
        return self.patches(mean, sigma * self.left)

    def _averaged(self, v: Any, sigma: float) -> Any:
        """Each frame of v (V, B, H, W) averaged with its neighbours along their motion."""
        if (self.calls - 1) % self.prior.renew == 0 or self.motion is None:
            seeing = self.prior.neighbours, self.prior.tolerance * sigma, self.prior.drift, self._rest(sigma)
            self.motion = seen(v, *seeing, self.motion)
            self.still = self.motion.at_rest
            self.left = TUNED.grain * self.motion.remaining
        return self.motion.average(v)

    def finish(self, x: Any, sigma: float) -> Any:
        """The last estimate x (V, B, H, W), averaged once more, along the motion that it shows itself."""
        if self.motion is None:
            return x
        self.motion, self.left = None, None  # their memory is needed no more
        return finished(x, sigma, self.prior.neighbours, self.prior.drift, self._rest(sigma))

    def facts(self) -> Mapping[str, Any]:
        """The part of each view that stands still, as last measured."""
        return {"still": self.still}

    def _rest(self, sigma: float) -> float:
        """Standard deviation along time at which a pixel counts 1/e as still; 0 where none may."""
        return min(STILL.rest, sigma) if self.prior.still else 0.0
