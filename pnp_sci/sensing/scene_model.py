"""The scene model: which views are dark, and which are still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from numbers import Integral
from typing import Any

import numpy as np

from pnp_sci._validate import shown
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.sequence import SequenceOperator


@dataclass(frozen=True)
class SceneModel:
    """Which parts of a video are variables of the reconstruction.

    Attributes
    ----------
    views : tuple of bool
        Whether each view is modelled; the others are dark, and their result is 0.
    still : bool or tuple of bool
        Whether all frames of a view are equal; one value for all views, or one for each. Stored as a tuple.
    reason : str
        Why this model was chosen.

    Raises
    ------
    InputError, InputTypeError
        If `views` or `still` are neither bool nor 0 and 1, or differ in length.

    Examples
    --------
    >>> SceneModel((True, True), still=(True, False)).nothing_moves
    False
    """

    views: tuple[bool, ...]
    still: bool | tuple[bool, ...] = False
    reason: str = "as asked for"

    def __post_init__(self):
        views = _bools("views", self.views, "a tuple of bool")  # 0 and 1 would be indices
        still = self.still
        still = (
            (bool(still),) * len(views)
            if isinstance(still, (bool, np.bool_))
            else _bools("still", still, "True, False or a tuple of bool")
        )
        if len(still) != len(views):
            raise InputError(f"still has {len(still)} values: {len(views)} were expected, one for each view")
        object.__setattr__(self, "views", views)
        object.__setattr__(self, "still", still)

    @property
    def complete(self) -> bool:
        """Whether all frames of all views are modelled."""
        return all(self.views) and not self._still_of_lit.any()

    @property
    def nothing_moves(self) -> bool:
        """Whether all modelled views are still."""
        return bool(self._still_of_lit.all())

    @property
    def _still_of_lit(self) -> np.ndarray:
        """Whether each of the modelled views is still."""
        return np.array(self.still)[np.array(self.views)]

    def reduce(self, op: SensingOperator) -> SensingOperator:
        """The operator of the modelled part: masks of the modelled views, summed over time if nothing moves.

        If other views move, a still view has the mean of its masks for each of its frames, which keeps them equal.
        """
        if self.complete:
            return op
        if len(op.parts) > 1:
            parts = {id(part): self.reduce(part) for part in op.parts}
            return SequenceOperator([parts[id(part)] for part in op.parts])
        masks = op.masks[np.array(self.views)]
        if self.nothing_moves:
            masks = masks.sum(1, keepdims=True, dtype=op.dtype)
        elif self._still_of_lit.any():
            masks = masks.astype(op.dtype)
            masks[self._still_of_lit] = masks[self._still_of_lit].mean(1, keepdims=True)
        return SensingOperator(masks, op.dtype)

    def restrict(self, x: np.ndarray) -> np.ndarray:
        """The modelled part of a video x (V, B, H, W), for :meth:`reduce`'s operator."""
        if self.complete:
            return x
        kept = x[np.array(self.views)]
        kept[self._still_of_lit] = kept[self._still_of_lit].mean(1, keepdims=True)
        return kept[:, :1] if self.nothing_moves else kept

    def expand(self, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """The video of `shape` (V, B, H, W) from its modelled part x; the inverse of :meth:`restrict`."""
        if self.complete:
            return x
        full = np.zeros(shape, x.dtype)
        full[np.array(self.views)] = x
        if not self.nothing_moves:
            still = np.array(self.still) & np.array(self.views)
            full[still] = full[still].mean(1, keepdims=True)
        return full

    def at_rest(self, parts: Sequence[float]) -> list[float | None]:
        """Fraction of still pixels of each view, from `parts` of the modelled views; None for dark and still views."""
        known = dict(zip(np.flatnonzero(self.views).tolist(), parts))
        moving = [lit and not still for lit, still in zip(self.views, self.still)]  # type: ignore[arg-type]
        return [round(float(known[v]), 3) if moves and v in known else None for v, moves in enumerate(moving)]

    def describe(self, op: SensingOperator) -> dict[str, Any]:
        """The entries of `Result.scene`, values for JSON."""
        views, frames = op.shape[:2]
        modelled = sum(1 if still else frames for still in self._still_of_lit)
        alike = self.nothing_moves or not self._still_of_lit.any()
        still = self.nothing_moves if alike else self.still
        remarks = [] if self.complete else [f"scene: {self.reason}"]
        return asdict(self) | {
            "still": still, "frames_modelled": modelled, "frames": views * frames, "remarks": remarks
        }  # fmt: skip


def _bools(name: str, values: Any, expected: str) -> tuple[bool, ...]:
    several = np.ndim(values) == 1
    given = tuple(np.asarray(values)) if several else (values,)
    known = all(isinstance(value, (Integral, np.bool_)) and value in (0, 1) for value in given)
    if not several or not known:
        raise InputTypeError(f"{name} is {shown(values)}: {expected} was expected")
    return tuple(map(bool, given))


def full(op: SensingOperator, reason: str = "as asked for") -> SceneModel:
    """The model in which all frames of all views are variables."""
    return SceneModel((True,) * op.shape[0], False, reason)
