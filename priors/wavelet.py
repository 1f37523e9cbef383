"""The prior "wavelet": frames have few large wavelet coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pywt

from pnp_sci._validate import positive_number, whole
from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Prior, Session, Traits

_HAAR = 0.5**0.5


@dataclass(frozen=True)
class Wavelet(Prior):
    """Soft thresholds on wavelet coefficients, cycle-spun: every call takes another shift of the grid.

    Neighbouring frames are first split into mean and difference (Haar along time), then each of the two into wavelet
    bands. A band of variance ``sx^2 + sigma^2`` gets the threshold ``sigma^2 / sx`` (BayesShrink): without signal it
    vanishes. Inside a solver the shifts average out; a single call on a video wants ``shifts=8``.

    Parameters
    ----------
    strength : float
        Noise assumed per unit of `sigma`, > 0. 1 suits noise of that standard deviation best; with 2 a solver comes
        about as far in fewer iterations.
    wavelet : str
        An orthogonal or biorthogonal discrete wavelet of PyWavelets, such as "haar", "db2", "sym4" or "bior4.4".
    levels : int
        Dyadic scales in rows and columns, >= 1; fewer where a frame is smaller than 2**levels.
    time : int
        Dyadic scales along time, >= 0. 0 denoises each frame on its own.
    shifts : int
        Shifts a call, whose results are averaged, >= 1.
    seed : int
        Of the shifts, >= 0; each session begins with the first of them.

    Raises
    ------
    InputError
        If a parameter is out of its range.

    References
    ----------
    S. G. Chang, B. Yu & M. Vetterli, "Adaptive wavelet thresholding for image denoising and compression", IEEE TIP 9
    (2000).
    R. R. Coifman & D. L. Donoho, "Translation-invariant de-noising", Wavelets and Statistics (1995).

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> x = np.zeros((1, 4, 32, 32), np.float32); x[..., 16:] = 1
    >>> noisy = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape).astype(np.float32)
    >>> bool(np.std(pnp_sci.denoise(noisy, 0.1, Wavelet(strength=1, shifts=8)) - x) < 0.5 * np.std(noisy - x))
    True
    """

    strength: float = 2.0
    wavelet: str = "sym4"
    levels: int = 3
    time: int = 1
    shifts: int = 1
    seed: int = 0

    def __post_init__(self):
        positive_number("strength", self.strength)
        if self.wavelet not in pywt.wavelist(kind="discrete"):  # type: ignore[attr-defined]
            raise InputError(
                f'wavelet is {self.wavelet!r}: a discrete wavelet such as "haar", "db2" or "sym4" was expected'
            )
        for name, least in (("levels", 1), ("time", 0), ("shifts", 1), ("seed", 0)):
            whole(name, getattr(self, name), least)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """The shifts move the estimates: the solver returns their mean."""
        return Traits(average=True)

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session that begins with the first shift."""
        return _WaveletSession(self)


class _WaveletSession(Session):
    def __init__(self, prior: Wavelet):
        self.prior, self.random = prior, np.random.default_rng(prior.seed)

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        if sigma == 0:
            return v
        shifts = self.prior.shifts
        total = self._shifted(v, self.prior.strength * sigma)
        for _ in range(shifts - 1):
            total += self._shifted(v, self.prior.strength * sigma)
        return total / shifts if shifts > 1 else total

    def _shifted(self, v: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise v behind margins that move the grid of all views and frames alike."""
        _, frames, rows, columns = v.shape
        time = min(self.prior.time, frames.bit_length() - 1)
        levels = min(self.prior.levels, max(rows, columns).bit_length() - 1)
        k, i, j = (int(n) for n in self.random.integers(0, (2**time, 2**levels, 2**levels)))
        out = np.empty_like(v)
        for view, clean in zip(v, out):  # one by one, because their bands fit the cache
            padded = np.pad(view, ((0, 0), (i, 0), (j, 0)), mode="symmetric")
            # reflected, because a frame paired with its own copy would keep its noise
            padded = np.pad(padded, ((k, -(k + frames) % 2**time), (0, 0), (0, 0)), mode="reflect")
            clean[:] = self._along_time(padded, sigma, time, levels)[k : k + frames, i:, j:]
        return out

    def _along_time(self, v: np.ndarray, sigma: float, time: int, levels: int) -> np.ndarray:
        """Shrink the bands of v (B, H, W) in space, after `time` Haar scales along time."""
        if time == 0:
            return self._in_space(v, sigma, levels)
        mean = self._along_time(_HAAR * (v[::2] + v[1::2]), sigma, time - 1, levels)
        difference = self._in_space(_HAAR * (v[::2] - v[1::2]), sigma, levels, coarse=True)
        out = np.empty_like(v)
        np.multiply(_HAAR, mean + difference, out=out[::2])
        np.multiply(_HAAR, mean - difference, out=out[1::2])
        return out

    def _in_space(self, v: np.ndarray, sigma: float, levels: int, coarse: bool = False) -> np.ndarray:
        """Shrink the bands of v in rows and columns; the coarsest one, its mean, only if `coarse`."""
        if levels == 0:
            return shrink(v, sigma) if coarse else v
        mean, details = pywt.dwt2(v, self.prior.wavelet, axes=(1, 2))
        mean = self._in_space(mean, sigma, levels - 1, coarse)
        bands = mean, tuple(shrink(band, sigma) for band in details)
        return pywt.idwt2(bands, self.prior.wavelet, axes=(1, 2))[:, : v.shape[1], : v.shape[2]]


def shrink(band: np.ndarray, sigma: float) -> np.ndarray:
    """Soft threshold ``sigma^2 / sqrt(max(mean(band^2) - sigma^2, 0))`` for each frame of a band (B, H, W)."""
    variance = sigma * sigma  # with ** an OverflowError where it is too large
    signal = np.mean(band * band, axis=(1, 2), keepdims=True).astype(np.float64) - variance
    threshold = np.full_like(signal, np.inf)
    np.divide(variance, np.sqrt(np.maximum(signal, 0)), out=threshold, where=signal > 0)
    threshold = threshold.astype(band.dtype)
    return band - np.clip(band, -threshold, threshold)
