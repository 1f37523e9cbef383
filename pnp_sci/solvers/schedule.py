"""How strongly to denoise and how far to trust the data, from the noise of the measurement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator

HALF_OPEN = 0.22  # spread over level of 20 binary masks of density 1/2
USUAL = 20  # frames of all views of the dual-view benchmark


@dataclass(frozen=True)
class ScheduleNumbers(Tuned):
    """How strongly the prior denoises and how far the data are trusted, in units where x spans [0, 1]."""

    sigma: float = 0.05  # sigma without noise
    balance: float = 0.6  # sigma * rho per variance of the noise, for faint noise or USUAL frames of all views
    loud: float = 0.03  # noise in a pixel of x at which fewer frames have half of their larger balance
    softest: float = 0.15  # largest rho in units of the mean gram, if sigma were to follow the noise
    more: int = 60  # calls of a strong prior that weak noise leaves of use, beyond those of the fast effort
    settled: float = 0.7  # sigma in the last call of a strong prior without noise, in units of its first


TUNED = ScheduleNumbers()


def contrast(op: SensingOperator) -> float:
    """How strongly the masks modulate y: 1 for up to 20 binary masks of density 1/2, less for dense or many masks.

    The spread of the masks over views and frames, ``sqrt(sum(gram - S^2 / n) / sum(S^2))`` with S their sum and n their
    number, in units of 0.22, and 1 at most. Of a sequence, that of the first measurement.
    """
    first = op.parts[0]
    total = first.masks.sum((0, 1), dtype=np.float64)
    level = float(np.sum(total**2))
    spread = float(np.sum(first.gram, dtype=np.float64)) - level / (first.shape[0] * first.shape[1])
    if level == 0 or spread <= 0:  # masks that cancel each other, or a single frame
        return 1.0
    return min(1.0, float(np.sqrt(spread / level)) / HALF_OPEN)


@dataclass(frozen=True)
class Schedule:
    """sigma of the denoiser and rho of the projection, iteration by iteration.

    Attributes
    ----------
    product : float or ndarray, (H, W)
        sigma * rho; 0 without noise.
    sigma : float
        At the beginning, in units where x spans [0, 1].
    settled : float
        Factor that sigma falls to in the last third of the calls of a strong prior.
    begins, ends : int
        Iterations in which that fall begins and ends, counted from 0; sigma stays as it is unless begins < ends.
    """

    product: float | np.ndarray
    sigma: float
    settled: float = 1.0
    begins: int = 0
    ends: int = 0

    def enough(self, fast: int, most: int) -> int:
        """How many of `most` calls of a strong prior are of use: all without noise, those of a `fast` effort with much.

        Without noise PSNR rises with every call. With noise a strong prior begins to turn noise into texture.
        """
        if not np.any(self.product):
            return most
        return min(most, round(fast + TUNED.more * (TUNED.sigma / max(self.sigma, TUNED.sigma)) ** 4))

    def settling(self, begins: int, ends: int) -> Schedule:
        """The schedule for a strong prior that serves from iteration `begins` to `ends`, counted from 0."""
        return replace(self, begins=ends - (ends - begins) // 3, ends=ends)

    def at(self, iteration: int) -> tuple[float, float | np.ndarray]:
        """sigma and rho of an iteration, counted from 0."""
        sigma = self.sigma
        if self.begins < min(iteration, self.ends):
            sigma *= self.settled ** min((iteration - self.begins) / (self.ends - self.begins), 1)
        return sigma, self.product / sigma if sigma > 0 else 0.0


def schedule_for(op: SensingOperator, noise: float | np.ndarray, sigma: float | None = None) -> Schedule:
    """The schedule for a standard deviation `noise` of y, and maybe a given sigma, in units where x spans [0, 1].

    The minimum that GAP and ADMM approach depends on the product ``sigma * rho`` only; how quickly they approach it
    depends on both. The product is the variance of the noise times a balance: 0.6 for faint noise, since an estimate of
    it is mostly texture then, and for 20 frames of all views or more; up to 6.3 for one frame. It is smaller for strong
    noise, since the best weight of total variation then grows like the noise and not like its square.

    Without noise sigma is 0.05. With noise it is the geometric mean of that and of the sigma at which rho is 0.15 of
    the mean gram, if that is larger: a larger one would hide motion and detail, and a smaller one slow the data down.
    Where pixels differ in noise, each has its own rho, and the mean product decides on sigma.

    Without noise the limit of a strong prior, which minimises nothing, depends on sigma: the smaller, the more detail
    remains, but errors too where sigma falls before they are removed. So sigma falls in the last third of the calls, to
    0.7 of what it was; with noise it falls less. A given sigma does not fall.
    """
    gram, frames = float(np.mean(op.gram)), op.parts[0].shape[0] * op.parts[0].shape[1]
    in_x = noise / np.sqrt(gram) if gram > 0 else 0.0
    loud = in_x**2 / (in_x**2 + TUNED.loud**2)
    balance = TUNED.balance * (1 + max((1 + USUAL) / (1 + frames) - 1, 0) * loud)
    product = balance * noise**2 / (1 + in_x) if gram > 0 else 0.0
    mean = float(np.mean(product))
    if sigma is not None:
        return Schedule(product, sigma)
    soft = max(TUNED.sigma, mean / (TUNED.softest * gram)) if mean > 0 else TUNED.sigma
    return Schedule(product, float(np.sqrt(soft * TUNED.sigma)), TUNED.settled ** float(np.mean(1 - loud)))
