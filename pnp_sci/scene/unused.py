"""What a simple scene model does not use of the masks, and how it varies from pixel to pixel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.scene_model import SceneModel

SAMPLE = 128  # pixels a side of the part of the masks that tells how they correlate
NEAR = 4  # pixels up to which they correlate
ALIKE = 0.5  # correlation of successive masks, one of them shifted, from which they are one pattern that moves


@dataclass(frozen=True)
class Free:
    """Of one view, what a model does not use of its masks.

    Attributes
    ----------
    masks : ndarray, (B, H, W)
        Of mean 0, over time or over the picture.
    share : float
        What all frames of a pixel lose of the mask of each: 1 / B, or 0 if nothing is lost.
    """

    masks: np.ndarray
    share: float

    def rooted(self, residual: np.ndarray) -> np.ndarray:
        """Standard deviation of ``residual * mask`` (H, W), before the share is lost.

        If the masks are white noise under a filter h, such as coarse cells or blur, the sum of ``r * (h o noise)`` over
        a window is that of ``(h o r) * noise``.
        """
        from scipy.ndimage import correlate

        power = np.mean(self.masks**2, 0) if self.share else np.float32(np.mean(self.masks**2))
        return correlate(residual * np.sqrt(power / (1 - self.share)), self._filter, mode="constant")

    @property
    def cell(self) -> float:
        """Pixels a side of a square in which the masks are alike: 1 if all pixels are independent."""
        return float(np.abs(self._filter.sum()))

    @property
    def shift(self) -> np.ndarray:
        """Rows and columns by which a pattern moves from frame to frame; 0 and 0 if the masks are no such pattern."""
        if len(self.masks) == 1:
            return np.zeros(2, np.int64)
        along = np.fft.irfft2(np.mean(np.conj(self._spectra[:-1]) * self._spectra[1:], 0), self._sample.shape[1:])
        likest = np.unravel_index(np.argmax(along), along.shape)
        if along[likest] <= ALIKE * np.mean(np.sum(self._sample.astype(np.float64) ** 2, (1, 2))):
            return np.zeros(2, np.int64)
        return np.array([at - n if at > n // 2 else at for at, n in zip(likest, along.shape)], np.int64)

    @cached_property
    def _sample(self) -> np.ndarray:
        """Masks of the middle of the picture, for their statistics."""
        return self.masks[(..., *(slice(max(n - SAMPLE, 0) // 2, (n + SAMPLE) // 2) for n in self.masks.shape[1:]))]

    @cached_property
    def _spectra(self) -> np.ndarray:
        return np.fft.rfft2(self._sample)

    @cached_property
    def _filter(self) -> np.ndarray:
        """The root of the masks' mean power spectrum as a filter of a few pixels, of unit energy."""
        root = np.sqrt(np.mean(np.abs(self._spectra) ** 2, 0))
        root = np.fft.fftshift(np.fft.irfft2(root, self._sample.shape[1:]))
        middle = (n // 2 for n in root.shape)
        root = root[tuple(slice(max(m - NEAR, 0), m + NEAR + 1) for m in middle)]
        return (root / (np.sqrt(np.sum(root**2)) or 1.0)).astype(self.masks.dtype)


def free_masks(simple: SceneModel, op: SensingOperator) -> Iterator[Free]:
    """What the model does not use of the masks of still and of dark views.

    Of a still view it uses the mean over time. Of a dark view it uses nothing; uniform masks would show the same as
    errors of the level, so the mean over pixels is subtracted.
    """
    for masks, lit, still in zip(op.masks, simple.views, simple.still):  # type: ignore[arg-type]
        if not lit:
            yield Free(masks - masks.mean((1, 2), keepdims=True, dtype=np.float32), 0.0)
        elif still and len(masks) > 1:
            yield Free(masks - masks.mean(0, dtype=np.float32), 1 / len(masks))
