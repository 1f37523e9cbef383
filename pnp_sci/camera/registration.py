"""What a registration found: where the masks are, and the black level of the measurement."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci import io
from pnp_sci.camera.warp import Transform, known, warped
from pnp_sci.formats.arrays import CONTAINERS
from pnp_sci.formats.plain import finite


@dataclass(frozen=True, eq=False, repr=False)
class Registration:
    """Masks moved to where a measurement has them, and its black level, by :func:`pnp_sci.register`.

    Attributes
    ----------
    given : ndarray, (V, B, H, W)
        The masks as they were given.
    transforms : tuple of Transform
        Of each view: how the given masks move over the picture.
    errors : tuple of Transform
        Standard errors of the fields of the transforms, for each view.
    black_level : float
        What y has without light, in its units; 0 if the estimate is within three standard errors of 0, or if y does
        not tell it.
    black_error : float
        Its standard error; infinite if y does not tell it.
    interpolation : "linear" or "cubic"
        Which explains y better: see :func:`pnp_sci.register`.
    before, after : float
        Share of the fine detail of y that the sums of the views' masks explain: of those given, and of those moved.
    trusted : bool
        Whether `after` is more than chance; if not, the masks are left as they are.
    """

    given: np.ndarray = field(repr=False)
    transforms: tuple[Transform, ...]
    errors: tuple[Transform, ...]
    black_level: float
    black_error: float
    interpolation: str
    before: float
    after: float
    trusted: bool

    @property
    def identity(self) -> bool:
        """Whether the masks are left as they are."""
        return all(transform == Transform() for transform in self.transforms)

    @property
    def known(self) -> np.ndarray:
        """Pixels (H, W) in which no mask element has come in from outside the given masks."""
        return np.logical_and.reduce([known(transform, self.given.shape) for transform in self.transforms])

    @cached_property
    def masks(self) -> np.ndarray:
        """The moved masks (V, B, H, W), float32 or float64; those given if nothing moves.

        Pixels that are not `known` are closed, 0 in all masks: nothing is measured there.
        """
        if self.identity:
            return self.given
        inside = self.known
        masks = np.empty(self.given.shape, np.float64 if self.given.dtype == np.float64 else np.float32)
        for view, transform, moved in zip(self.given, self.transforms, masks):
            for frame, out in zip(view, moved):
                np.multiply(warped(frame, transform, self.interpolation), inside, out=out, casting="same_kind")
        return masks

    def correct(self, y: Any) -> np.ndarray:
        """y (..., H, W) less the black level, 0 in pixels that are not `known`; y itself if there is nothing to do."""
        y = np.asarray(y)
        if self.identity and self.black_level == 0:
            return y
        y = y.astype(np.float64 if y.dtype == np.float64 else np.float32)
        return np.where(self.known, y - y.dtype.type(self.black_level), y.dtype.type(0))

    def describe(self) -> dict[str, Any]:
        """The registration as JSON can hold it."""
        names = ("black_level", "black_error", "interpolation", "before", "after", "trusted")
        fields: dict[str, Any] = {name: getattr(self, name) for name in names}
        fields["transforms"] = [asdict(transform) for transform in self.transforms]
        return finite(fields | {"errors": [asdict(error) for error in self.errors]})

    def save(self, path: str | Path) -> None:
        """Write the moved masks and the transforms to NPZ, HDF5 or MAT; to another format of :func:`pnp_sci.io.write`
        the masks alone."""
        rows = [[t.rows, t.columns, t.rotation, t.scale, t.blur] for t in self.transforms]
        arrays = {"masks": self.masks, "transforms": np.array(rows), "black_level": np.array([[self.black_level]])}
        io.write(path, arrays if Path(path).suffix.lower() in CONTAINERS else self.masks)

    def __repr__(self) -> str:
        return f"Registration({self.in_words()})"

    def in_words(self) -> str:
        """What was found, in a line."""
        if not self.trusted:
            explained = f"they explain {self.after:.2f} of the fine detail of y"
            return f"no shift, rotation or scale makes the masks fit, others are not tried: {explained}"
        one = len(set(self.transforms)) == 1
        moves = [_in_words(t) for t in (self.transforms[:1] if one else self.transforms)]
        moved = "masks fit as they are" if self.identity else "masks moved by " + "; ".join(moves)
        black = f", black level {self.black_level:.3g}" if self.black_level else ""
        return f"{moved}{black}; explained {self.before:.2f}, then {self.after:.2f} of the fine detail of y"


def _in_words(t: Transform) -> str:
    moved = f"({t.rows:+.2f}, {t.columns:+.2f}) pixels, {t.rotation:+.3f} degrees, scale {t.scale:.4f}"
    return moved + (f", blurred by {t.blur**0.5:.2f} pixels" if t.blur > 0 else "")
