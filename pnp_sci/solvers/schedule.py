"""How strongly to denoise and how far to trust the data, from the noise of the measurement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import library
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.state import Array

HALF_OPEN = 0.22  # spread over level of 20 binary masks of density 1/2
USUAL = 20  # frames of all views of the dual-view benchmark
COARSEST = 5.0  # largest sigma without noise, in units of the usual one: a larger one hides motion
NOTHING = 1e-12  # mean square of changes between masks that are rounding errors, with 1 for the largest mask
REACH = 4  # pixels: how far away neighbours are that a mask is compared with
EQUAL = 1 - 1e-6  # correlation of masks that are the same
CHANCE = 0.1  # correlation of random masks of few pixels: smaller and negative ones do not count


@dataclass(frozen=True)
class ScheduleNumbers(Tuned):
    """How strongly the prior denoises and how far the data are trusted, in units where x spans [0, 1]."""

    sigma: float = 0.05  # sigma without noise, for up to USUAL frames of all views and mask elements of one pixel
    balance: float = 12.6  # sigma * rho per variance of strong noise, times 1 + frames of all views; faint: twice that
    loud: float = 0.03  # noise in a pixel of x that is halfway between faint and strong
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


def element(op: SensingOperator) -> float:
    """Side of the elements of the masks in pixels, >= 1: for square elements as large as that, at random.

    Of the correlation c of such masks with themselves, moved by d pixels, the squares sum up to
    ``((2 w^2 + 1) / (3 w))^2`` over rows and columns, with w the side. Blurred masks have larger elements too. What the
    masks of a view have in common does not count, nor what comes back further away, as in masks that are repeated.
    Elements of more than five pixels seem smaller. Of a sequence the masks of the first measurement count, of a mosaic
    those of its planes.

    >>> masks = np.random.default_rng(0).integers(0, 2, (1, 8, 64, 64)).repeat(3, 2).repeat(3, 3)
    >>> round(element(SensingOperator(masks)), 1)
    3.0
    """
    from scipy.ndimage import label

    masks = op.parts[0].masks
    largest = float(np.abs(masks).max())
    if largest == 0:
        return 1.0
    power = np.float64(0)
    for view in masks:
        common = view.mean(0, dtype=np.float64)
        for mask in view:
            change = (mask - common) / largest
            power = power + np.abs(np.fft.rfft2(change - change.mean())) ** 2
    moved = np.fft.irfft2(power, masks.shape[2:])
    if moved[0, 0] < NOTHING:
        return 1.0
    rows, columns = (np.arange(-n, n + 1) for n in (min(REACH, (size - 1) // 2) for size in moved.shape))
    alike = moved[np.ix_(rows, columns)] / moved[0, 0]
    regions = np.zeros(alike.shape, int)
    label(alike > CHANCE, output=regions)
    around = regions == regions[len(rows) // 2, len(columns) // 2]
    side = float(np.sqrt(np.sum(alike[around] ** 2)))
    return (3 * side + float(np.sqrt(max(9 * side**2 - 8, 1.0)))) / 4


def opposition(op: SensingOperator) -> float:
    """Factor, >= 1, by which masks that are opposite need more calls of a strong prior than independent ones.

    From the negative correlations R of n masks over p pixels: ``1 + sum(R^2) / n - n w^2 / (2 p)``, in tenths, with w
    the side of their elements. Less is chance. This is 1 for independent masks, and 2 where the masks of two views add
    up to 1, as with the two arms of a micromirror device: of the sum of both views only the mean over time is measured.
    Equal masks count once, as frames that a scene model ties have them. Masks that resemble each other, as blurred ones
    that move, are not opposite. Of a sequence the masks of the first measurement count.

    >>> masks = np.random.default_rng(0).integers(0, 2, (1, 8, 64, 64))
    >>> both = (np.concatenate([masks, others]) for others in (masks[..., ::-1], 1 - masks))
    >>> [opposition(SensingOperator(pair)) for pair in both]
    [1.0, 2.0]
    """
    masks = op.parts[0].masks
    count, pixels = masks.shape[0] * masks.shape[1], masks[0, 0].size
    mean = masks.mean((2, 3), dtype=np.float64).ravel()
    with np.errstate(over="ignore", invalid="ignore"):  # such masks are left out
        rows = (row.reshape(count, -1).astype(np.float64) for row in np.moveaxis(masks, 2, 0))
        squares = sum((row @ row.T for row in rows), np.zeros((count, count))) / pixels
        covariance = squares - np.outer(mean, mean)
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0))
    changing = np.flatnonzero((spread**2 > NOTHING * np.diagonal(squares)) & np.isfinite(spread))
    correlation = covariance[np.ix_(changing, changing)] / np.outer(spread[changing], spread[changing])
    own = ~np.any(np.tril(correlation, -1) > EQUAL, 1)
    correlation = correlation[np.ix_(own, own)]
    count = len(correlation)
    if count < 2:
        return 1.0
    ratio = 1 + float(np.sum(np.minimum(correlation, 0) ** 2)) / count
    return max(1.0, round(ratio - count * element(op) ** 2 / (2 * pixels), 1))


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
    quiet : float
        `sigma` for such masks without noise.
    unseen : ndarray of bool, (H, W), or None
        Pixels of y that do not count: their rho is infinite.
    opposition : float
        Factor by which more calls are needed than with independent masks, see :func:`opposition`.
    """

    product: float | np.ndarray
    sigma: float
    settled: float = 1.0
    begins: int = 0
    ends: int = 0
    quiet: float = TUNED.sigma
    unseen: Array | None = None
    opposition: float = 1.0

    def enough(self, fast: int, most: int) -> int:
        """How many calls of a strong prior are of use: `most` without noise, those of a `fast` effort with much.

        `most` grows by the factor `opposition`. Without noise PSNR rises with every call. With noise a strong prior
        begins to turn noise into texture.
        """
        most = round(self.opposition * most)
        if not np.any(self.product):
            return most
        return min(most, round(fast + TUNED.more * (self.quiet / max(self.sigma, self.quiet)) ** 4))

    def settling(self, begins: int, ends: int) -> Schedule:
        """The schedule for a strong prior that serves from iteration `begins` to `ends`, counted from 0."""
        return replace(self, begins=ends - (ends - begins) // 3, ends=ends)

    def mean_product(self) -> float:
        """The mean of `product` over all pixels; it may be a tensor."""
        return self.product if isinstance(self.product, (int, float)) else float(self.product.mean())

    def told(self, op: SensingOperator, noise: float) -> Schedule:
        """The schedule for another noise of y: its product, and how far sigma falls; sigma begins where it did.

        Of a schedule without a given sigma.
        """
        product, loud = demanded(op, noise)
        return replace(self, product=product, settled=_settled(loud))

    def at(self, iteration: int) -> tuple[float, float | Array]:
        """sigma and rho of an iteration, counted from 0."""
        sigma = self.sigma
        if self.begins < min(iteration, self.ends):
            sigma *= self.settled ** min((iteration - self.begins) / (self.ends - self.begins), 1)
        with np.errstate(over="ignore"):  # a sigma near 0 has an infinite rho
            rho = self.product / sigma if sigma > 0 else 0.0
        return sigma, rho if self.unseen is None else library(self.unseen).where(self.unseen, np.inf, rho)


def demanded(op: SensingOperator, noise: float | np.ndarray) -> tuple[float | np.ndarray, float | np.ndarray]:
    """sigma * rho for a standard deviation `noise` of y, and how loud the noise is, 0 to 1.

    The minimum that GAP and ADMM approach depends on the product ``sigma * rho`` only; how quickly they approach it
    depends on both. The product is the variance of the noise times a balance, divided by ``1 + in_x``, as the best
    weight of total variation grows like strong noise and not like its square. The balance is the smaller, the more
    frames of all views there are, up to 20: with many frames most errors come from what is not measured, and few from
    the noise. For strong noise it is half of that for faint noise.
    """
    gram, frames = float(np.mean(op.gram)), op.parts[0].shape[0] * op.parts[0].shape[1]
    in_x = noise / np.sqrt(gram) if gram > 0 else 0.0
    loud = in_x**2 / (in_x**2 + TUNED.loud**2)
    balance = TUNED.balance * (2 - loud) / (1 + min(frames, USUAL))
    return (balance * noise**2 / (1 + in_x) if gram > 0 else 0.0), loud


def _settled(loud: float | np.ndarray) -> float:
    """The factor that sigma falls to."""
    return float(TUNED.settled ** np.mean(1 - loud))


def schedule_for(op: SensingOperator, noise: float | np.ndarray, sigma: float | None = None) -> Schedule:
    """The schedule for a standard deviation `noise` of y, and maybe a given sigma, in units where x spans [0, 1].

    For the product of sigma and rho see :func:`demanded`.

    Without noise sigma is 0.05 for up to 20 frames of all views and mask elements of one pixel. It grows with the side
    of the elements and with the root of the number of frames, up to 0.25, as the errors do that a prior is to remove:
    those of the first estimates look like the masks, and coarse noise has more power at the frequencies of a scene.
    With noise sigma is the geometric mean of 0.05 and of the sigma at which rho is 0.15 of the mean gram, if that is
    larger: a larger one would hide motion and detail, and a smaller one slow the data down.
    Where pixels differ in noise, each has its own rho, and the mean product decides on sigma.

    Without noise the limit of a strong prior, which minimises nothing, depends on sigma: the smaller, the more detail
    remains, but errors too where sigma falls before they are removed. So sigma falls in the last third of the calls, to
    0.7 of what it was; with noise it falls less. A given sigma does not fall.
    """
    product, loud = demanded(op, noise)
    mean, gram = float(np.mean(product)), float(np.mean(op.gram))
    frames = op.parts[0].shape[0] * op.parts[0].shape[1]
    quiet = TUNED.sigma * min(max(element(op) * float(np.sqrt(frames / USUAL)), 1.0), COARSEST)
    if sigma is not None:
        return Schedule(product, sigma, quiet=quiet, opposition=opposition(op))
    soft = max(TUNED.sigma, mean / (TUNED.softest * gram)) if mean > 0 else TUNED.sigma
    begins = max(quiet, float(np.sqrt(soft * TUNED.sigma)))
    return Schedule(product, begins, _settled(loud), quiet=quiet, opposition=opposition(op))
