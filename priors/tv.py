"""The prior "tv": piecewise smooth frames that change slowly along time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import positive_number, true_or_false, whole
from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Prior, Session
from priors.kernels.dual import ALL, NOTHING, STEP

COARSE = 0.5  # largest weight, times 1 + time**2 / 2, for a dual variable of 16 bits
ONE = {np.int16: 2**15 - 1, np.int32: 2**30}  # what stands for 1 in the dual variable


@dataclass(frozen=True)
class TVNumbers(Tuned):
    """Weights along time, and which pixels stand still; sigma where x spans [0, 1]."""

    settle: int = 40  # calls after which the estimate shows what moves, and between two looks at what is still
    warmup: int = 60  # calls with which total variation begins for a strong prior
    trusted: float = 0.12  # largest sigma at which changes along time count as motion
    around: int = 15  # pixels a side of the two box filters over space and change
    time_before: float = 0.15  # weight along time until then, and with a larger sigma
    time: float = 0.4  # weight along time where gradients in space and changes along time are alike
    power: int = 3  # power of their ratio
    time_most: float = 0.7  # largest weight along time
    rest: float = 0.02  # standard deviation along time at which a pixel counts 1/e as still, per weight and frame


TUNED = TVNumbers()


@dataclass(frozen=True)
class TV(Prior):
    """Total variation: over rows and columns of each frame and, weighted, along time; never across views.

    Solves ``min_x ||x - v||^2 / (2 w) + TV(x)`` with ``w = strength * sigma`` by Chambolle's dual projection. A session
    keeps the dual variable between calls, so that inside a solver one step a call suffices.

    Parameters
    ----------
    strength : float
        Weight per unit of noise, > 0.
    inner : int
        Dual steps per call, >= 1. A single call on a video (outside a solver) needs some hundred.
    time : float or "auto"
        Weight of differences along time against those along rows and columns, >= 0. 0 denoises each frame on its own.
        "auto" begins with 0.15. In the 40th call, if sigma is 0.12 at most then, every pixel gets its own weight: large
        where the estimate changes little along time, beside its gradients in space; near 0 where it moves.
    isotropic : bool
        Penalise the length of the gradient (True) or the sum of its absolute parts (False).
    still : bool
        With ``time="auto"``, from the 40th call on: pixels whose standard deviation along time is small become the mean
        of all frames. The limit grows with `w` and the number of frames, up to 0.04; it is lower for dark pixels.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    References
    ----------
    A. Chambolle, "An algorithm for total variation minimization and applications", JMIV 20 (2004).
    Z. Li & M. Yan, "New convergence analysis of a primal-dual algorithm with large stepsizes", Adv. Comput. Math. 47
    (2021).
    X. Yuan, "Generalized alternating projection based total variation minimization for compressive sensing", ICIP 2016.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> x = np.zeros((1, 1, 8, 8), np.float32); x[..., 4:] = 1
    >>> noisy = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape).astype(np.float32)
    >>> bool(np.std(pnp_sci.denoise(noisy, 0.1, TV(inner=100)) - x) < np.std(noisy - x))
    True
    """

    strength: float = 1.0
    inner: int = 1
    time: float | Literal["auto"] = "auto"
    isotropic: bool = True
    still: bool = True

    def __post_init__(self):
        positive_number("strength", self.strength)
        whole("inner", self.inner, 1)
        for name in ("isotropic", "still"):
            true_or_false(name, getattr(self, name))
        if self.time != "auto" and not (isinstance(self.time, Real) and 0 <= self.time < np.inf):
            raise InputError(f'time is {self.time!r}: "auto" or a number >= 0 was expected')

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> TVSession:
        """A session with a dual variable of 0."""
        return TVSession(self, shape, dtype)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Session:
        """The same on tensors."""
        from priors.on_device.tv import TVOnDevice

        return TVOnDevice(self, TUNED, shape, dtype, device)


class TVSession(Session):
    """Total variation at work on one video: the dual variable, weights along time, and what stands still."""

    def __init__(self, prior: TV, shape: tuple[int, ...], dtype: np.dtype):
        self.prior, self.calls = prior, 0
        views, frames, rows, columns = shape
        along_time = frames > 1 and prior.time != 0
        before_first = (columns, 1, rows * columns)
        sizes = [(int(np.prod(shape)) + n) * used for n, used in zip(before_first, (True, True, along_time))]
        self.dual = [np.zeros(size, np.int16) for size in sizes]
        constant = TUNED.time_before if prior.time == "auto" else prior.time
        self.largest = float(constant if along_time else 0)  # bound of the weights along time, for all views
        self.weights = np.full((views, rows, columns), self.largest, dtype)
        self.still: list[np.ndarray] = []  # of each view, how surely a pixel shows the same in all frames (H, W)

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v (V, B, H, W)."""
        from priors.kernels.still import tie
        from priors.kernels.tv import denoise

        out = np.empty_like(v) if out is None else out
        if out is not v:
            np.copyto(out, v)
        weight = min(self.prior.strength * sigma, ALL)
        if weight < NOTHING:
            return out
        steepness = 1 + self.largest**2 / 2  # |gradient|^2 <= 8 times this
        one = self._unit(np.int16 if v.dtype == np.float32 and weight * steepness <= COARSE else np.int32)
        units = (v.dtype.type(a) for a in (weight / one, STEP * one / (8 * steepness * weight), one))
        denoise(out, int(self.prior.inner), *units, self.prior.isotropic, self.weights, tuple(self.dual))
        self.calls += 1
        if self.prior.time == "auto" and v.shape[1] > 1:
            self._look(out, sigma, weight)
            for view, still in zip(out, self.still):
                tie(view, still, view)
        return out

    def facts(self) -> Mapping[str, Any]:
        """The part of each view that stands still, as last measured."""
        return {"still": [float(still.mean()) for still in self.still]}

    def _look(self, x: np.ndarray, sigma: float, weight: float) -> None:
        """What the estimate x shows of motion, once it has settled: weights along time, and which pixels are still."""
        if self.calls == TUNED.settle and sigma <= TUNED.trusted:
            self.weights, self.largest = np.stack([time_weights(view) for view in x]), TUNED.time_most
        if self.prior.still and self.calls % TUNED.settle == 0:
            from priors.kernels.still import TUNED as STILL

            rest = float(min(TUNED.rest * x.shape[0] * x.shape[1] * weight, STILL.rest))
            self.still = [at_rest(view, rest) for view in x]

    def _unit(self, kind: type[np.int16 | np.int32]) -> int:
        """Bring the dual variable to this type; returns what stands for 1 in it."""
        if self.dual[0].dtype != kind:
            change = ONE[kind] / ONE[self.dual[0].dtype.type]
            self.dual = [np.rint(p * change).astype(kind) for p in self.dual]
        return ONE[kind]


def time_weights(view: np.ndarray) -> np.ndarray:
    """Weight along time for each pixel of a view (B, H, W), from the estimate itself.

    ``0.4 * (|gradient in space| / |change along time|)**3``, both averaged over time and over some ten pixels around,
    at most 0.7.
    """
    from scipy.ndimage import uniform_filter

    from priors.kernels.tv import activity

    space, change = np.zeros_like(view[0]), np.zeros_like(view[0])
    activity(view, space, change)
    for _ in range(2):
        space, change = (uniform_filter(a, TUNED.around, mode="nearest") for a in (space, change))
    ratio = (space + 1e-4) / (change + 1e-4)
    return np.clip(TUNED.time * ratio**TUNED.power, 0, TUNED.time_most)


def at_rest(view: np.ndarray, rest: float) -> np.ndarray:
    """Probability that each pixel of a view (B, H, W) is constant in time, 0 to 1, (H, W).

    ``exp(-(s / rest)^2)`` with s the standard deviation along time, smoothed over some three pixels. The limit is lower
    for dark pixels, see :func:`priors.kernels.still.sureness`.
    """
    from scipy.ndimage import gaussian_filter

    from priors.kernels.still import mean_and_variance, sureness

    brightness, variance = np.empty((2, *view.shape[1:]), view.dtype)
    mean_and_variance(view, brightness, variance)
    brightness, variance = (gaussian_filter(a, 1.5, mode="nearest") for a in (brightness, variance))
    return sureness(variance, brightness, rest)
