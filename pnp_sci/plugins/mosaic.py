"""Any prior for the mosaics of colour sensors: it denoises their luma and their chroma."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pnp_sci._validate import needed
from pnp_sci.plugins.combine import Stages
from pnp_sci.plugins.protocols import Decoder, Prior, Session, Traits
from pnp_sci.sensing.mosaic import Mosaic, quarters
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel

GREY = 0.5  # added to chroma, which is 0 for grey: priors are made for values about [0, 1]


@dataclass(frozen=True)
class Mosaicked(Prior):
    """A prior of grey videos as one of mosaics, which lie in planes, see :mod:`pnp_sci.sensing.mosaic`.

    It denoises luma at the full and chroma at half the resolution, each in a session of its own.

    Parameters
    ----------
    prior : Prior
    mosaic : Mosaic

    Raises
    ------
    InputTypeError
        If they are anything else.

    References
    ----------
    Those of :class:`pnp_sci.sensing.mosaic.Mosaic`.

    Examples
    --------
    >>> import pnp_sci
    >>> prior = Mosaicked(pnp_sci.as_prior("tv"), pnp_sci.Mosaic("RGGB"))
    >>> pnp_sci.denoise(np.full((1, 2, 8, 8), 0.5), 0.05, prior).shape
    (1, 2, 8, 8)
    """

    prior: Prior
    mosaic: Mosaic

    def __post_init__(self):
        needed("prior", self.prior, Prior)
        needed("mosaic", self.mosaic, Mosaic)

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """Those of the prior, as is its warm-up; but frames in planes, which have seams, are not displaced."""
        traits = replace(self.prior.traits(shape), motion=False)
        if traits.warmup is None:
            return traits
        first, calls = traits.warmup
        return replace(traits, warmup=(Mosaicked(first, self.mosaic), calls))

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session for luma, and one for chroma."""
        views, frames, rows, columns = shape
        chroma = self.prior.begin((2 * views, frames, rows // 2, columns // 2), dtype)
        return _MosaickedSession(self.mosaic, self.prior.begin(shape, dtype), chroma)


class _MosaickedSession(Session):
    def __init__(self, mosaic: Mosaic, luma: Session, chroma: Session):
        self.mosaic, self.luma, self.chroma = mosaic, luma, chroma

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        luma, chroma = self.mosaic.split(v)
        return self.mosaic.join(self.luma(luma, sigma), self.chroma(chroma + GREY, sigma) - GREY)

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        luma, chroma = self.mosaic.split(x)
        return self.mosaic.join(self.luma.finish(luma, sigma), self.chroma.finish(chroma + GREY, sigma) - GREY)

    def facts(self) -> Mapping[str, Any]:
        return self.luma.facts()


def mosaicked(prior: Prior, mosaic: Mosaic) -> Prior:
    """The prior for mosaics; of stages, each."""
    if isinstance(prior, Stages):
        return Stages([(mosaicked(stage, mosaic), calls) for stage, calls in prior.stages])
    return Mosaicked(prior, mosaic)


def decoded(decoder: Decoder, problem: Problem, scene: SceneModel) -> np.ndarray:
    """The video (V, B, H, W) that a decoder makes of a problem; of a mosaic, plane by plane.

    Decoders are trained in steady light, with masks as they are given, and with pictures that have no seams.
    """
    steady = problem.steady()
    if steady is not problem:
        return decoded(decoder, steady, scene) * np.asarray(problem.light, problem.op.dtype)
    if problem.balance is None:
        return decoder(problem, scene)
    as_given, out = problem.unbalanced(), np.empty(problem.op.shape, problem.op.dtype)
    for where in quarters(problem.op.shape):
        out[(..., *where)] = decoder(as_given.crop(where), scene)
    return out
