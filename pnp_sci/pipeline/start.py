"""The solver's first estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._validate import real_array, require_finite, shaped
from pnp_sci.errors import FormatError, InputError
from pnp_sci.pipeline.auto import NETWORK
from pnp_sci.plugins.resolve import decoder_for
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.solvers.state import length, missing
from pnp_sci.solvers.stopping import EXPLODED


@dataclass(frozen=True, eq=False)
class Start:
    """A first estimate.

    Attributes
    ----------
    name : str
        As `init` had it, or the type of the object that it was.
    x : ndarray, (V, B, H, W)
        In the problem's units.
    decoded : bool
        Whether an installed decoder has made it: then it counts in the result of a noisy measurement.
    """

    name: str
    x: np.ndarray
    decoded: bool = False


def first_estimate(
    init: Any, problem: Problem, scene: SceneModel, network: bool = False, device: str | None = None
) -> Start:
    """The start that an `init` argument of :func:`pnp_sci.solve` stands for.

    Beside a prior that is a `network`, "auto" is the quickest decoder, where it is installed and has weights for such
    masks. A decoder that takes a `device` runs there.
    """
    if isinstance(init, str) and init == "auto":
        try:
            return first_estimate(NETWORK if network else "adjoint", problem, scene, device=device)
        except FormatError:  # weights that are damaged
            raise
        except InputError:
            return first_estimate("adjoint", problem, scene)
    if isinstance(init, str) and init == "adjoint":
        return Start(init, level(problem.op, problem.y))
    if isinstance(init, str):
        return Start(init, _checked(decoder_for("init", init, {}, device)(problem, scene), problem), decoded=True)
    if callable(init):
        x = decoder_for("init", init, {})(problem, scene)
    else:
        with np.errstate(all="ignore"):  # what the type cannot hold is told below
            x = real_array("init", init) / np.float64(problem.unit)
    x = _checked(x, problem)
    residual = length(missing(problem.y - problem.op.forward(x), problem.saturated)) / (length(problem.y) or 1.0)
    if problem.y.any() and residual > EXPLODED:
        raise InputError(f"init leaves {residual:.3g} times y as residual: an estimate in the units of y was expected")
    return Start(type(init).__name__, x)


def _checked(x: Any, problem: Problem) -> np.ndarray:
    x = shaped("init", x, problem.op.shape, problem.op.dtype)
    require_finite("init", x)
    return x
