"""What is found of how a measurement and its masks fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes
    ----------
    kind : str
        "shift", "arrangement", "inverted", "no code", "black level", "sharpness", "contrast", "saturation", "sign",
        "noise", "hot", "dead", "stuck", "coarse", "wrapped", "missing", "empty", "static", "views",
        "repeated" or "frame order".
    text : str
        What is seen.
    hint : str
        What to do about it.
    """

    kind: str
    text: str
    hint: str

    def __str__(self) -> str:
        return f"{self.text}: {self.hint}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """How a measurement and its masks fit, from :func:`pnp_sci.check_fit`; ``str()`` of it is a report.

    Attributes
    ----------
    follows : float or None
        Light that follows the code of the masks over the mean light. 1 if they fit, 0 if they have nothing to do with
        y, less than 0 if they are inverted; None if y does not tell.
    error : float or None
        Standard error of `follows`.
    share : float
        Part of the variance of the fine detail of y that the sums of masks explain; noise and texture are the rest.
    findings : tuple of Finding
        What is wrong; empty if nothing is found.
    unknown : str
        Why y does not tell whether the masks fit; empty if it does.
    shift : tuple of float or None
        Pixels by which the masks must be moved, rows and columns, if they are shifted.
    black_level : float or None
        Offset of y that the masks do not explain, in the units of y, if there is one.
    full_scale : float or None
        Smallest value of a pile at the upper end of y, if there is one.
    hot, dead : ndarray of bool, (H, W)
        Pixels that do not follow the light, `bad` ones left out.
    stuck : ndarray of bool, (H, W)
        Pixels of columns and rows that are stuck at one value, `bad` ones left out.
    frame_order : str
        "forward", "reversed" or "unknown"; "not checked" unless asked for.
    """

    follows: float | None = None
    error: float | None = None
    share: float = 0.0
    hot: np.ndarray
    dead: np.ndarray
    stuck: np.ndarray
    findings: tuple[Finding, ...] = ()
    unknown: str = ""
    shift: tuple[float, float] | None = None
    black_level: float | None = None
    full_scale: float | None = None
    frame_order: str = "not checked"

    @property
    def ok(self) -> bool:
        """Whether nothing wrong was found."""
        return not self.findings

    @property
    def bad(self) -> np.ndarray:
        """Hot, dead and stuck pixels, bool (H, W)."""
        return self.hot | self.dead | self.stuck

    @property
    def warnings(self) -> tuple[str, ...]:
        """Each finding with what to do about it, one sentence each."""
        return tuple(map(str, self.findings))

    def describe(self) -> dict[str, Any]:
        """All of it as JSON can hold it, pixels by their number."""
        return {
            "follows": self.follows,
            "error": self.error,
            "share": self.share,
            "unknown": self.unknown,
            "shift": None if self.shift is None else list(self.shift),
            "black_level": self.black_level,
            "full_scale": self.full_scale,
            "hot": int(self.hot.sum()),
            "dead": int(self.dead.sum()),
            "stuck": int(self.stuck.sum()),
            "frame_order": self.frame_order,
            "findings": [{"kind": f.kind, "text": f.text, "hint": f.hint} for f in self.findings],
        }

    def __str__(self) -> str:
        told = f"cannot be told: {self.unknown}" if self.unknown else "something is wrong" if self.findings else "good"
        lines = [f"Fit of masks and measurement: {told}"]
        if self.follows is not None:
            lines.append(
                f"Light that follows the masks: {self.follows:.2f} of the mean, standard error {self.error:.2f}"
            )
        lines.append(f"Fine detail that they explain: {self.share:.0%}")
        if self.hot.any() or self.dead.any():
            lines.append(f"Pixels unlike their neighbours: {self.hot.sum()} bright, {self.dead.sum()} dark")
        if self.stuck.any():
            lines.append(f"Pixels of columns or rows that are stuck: {self.stuck.sum()}")
        if self.frame_order != "not checked":
            lines.append(f"Order of the frames: {self.frame_order}")
        return "\n".join(lines + [f"Warning: {warning}" for warning in self.warnings])
