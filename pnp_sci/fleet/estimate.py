"""What a run will take, from what its first chunk took."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from pnp_sci.errors import InputError

UNITS = (3600, "hours"), (60, "minutes")
SIZES = (1e12, "TB"), (1e9, "GB"), (1e6, "MB")


@dataclass(frozen=True)
class Estimate:
    """What is still to be done.

    Attributes
    ----------
    measurements : int
    workers : int
    seconds : float
        Until the end.
    memory : float
        Bytes that all workers on this computer need together, or one where they are elsewhere.
    disk, free : float
        Bytes to be written, and bytes that the disk has left.

    Examples
    --------
    >>> print(Estimate(100, 2, 75, 5e8, 2e9, 4e10))
    100 measurements on 2 workers: about 1.2 minutes, 500.0 MB of memory, 2.0 GB on disk (40.0 GB free)
    """

    measurements: int
    workers: int
    seconds: float
    memory: float
    disk: float
    free: float

    def __str__(self) -> str:
        unit, name = next((pair for pair in UNITS if self.seconds > pair[0]), (1, "seconds"))
        return (
            f"{self.measurements} measurements on {self.workers} worker{'s' * (self.workers != 1)}: "
            f"about {self.seconds / unit:.1f} {name}, {size(self.memory)} of memory, "
            f"{size(self.disk)} on disk ({size(self.free)} free)"
        )

    def check(self, out: Path) -> None:
        """Raise an InputError if the disk has no room."""
        if self.disk > self.free:
            raise InputError(
                f"out is {out}, whose disk has {size(self.free)} left: {size(self.disk)} were expected "
                f"for {self.measurements} measurements. What is done stays, the same call goes on with it"
            )


def size(count: float) -> str:
    """So many bytes, in a unit that suits.

    >>> size(4e10), size(3e4)
    ('40.0 GB', '30.0 kB')
    """
    unit, name = next((pair for pair in SIZES if count >= pair[0]), (1e3, "kB"))
    return f"{count / unit:.1f} {name}"


def free_bytes(out: Path) -> int:
    """Bytes that the disk has left."""
    return shutil.disk_usage(out).free
