"""Configuration of the networks that the paper compares OFaNet with."""

from __future__ import annotations

from dataclasses import dataclass

from ofanet_init.config import MOST
from pnp_sci.errors import InputError


@dataclass(frozen=True)
class BaselineConfig:
    """The measurements that a network decodes.

    Parameters
    ----------
    views, frames : int
        V and B of the measurements, each from 1 to 256.

    Raises
    ------
    InputError
        If a field has another value.
    """

    views: int = 2
    frames: int = 10

    def __post_init__(self) -> None:
        for name, value in (("views", self.views), ("frames", self.frames)):
            if not isinstance(value, int) or not 1 <= value <= MOST:
                raise InputError(f"{name} is {value!r}: a whole number from 1 to {MOST} was expected")

    @property
    def planes(self) -> int:
        """Number of frames of all views, V B."""
        return self.views * self.frames
