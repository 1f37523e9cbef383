"""Configuration of OFaNet and of the variants in the paper's ablation study."""

from __future__ import annotations

from dataclasses import dataclass

from pnp_sci.errors import InputError

REFINES = ("none", "simplified", "birecurrent")
FLOWS = ("none", "forward", "both")
MOST = 256  # views, frames or passes: more are a damaged file


@dataclass(frozen=True)
class OFaNetConfig:
    """Architecture of OFaNet and of the variants in the paper's ablation table (Table 3).

    ==================  ==================================================
    name in the paper   configuration
    ==================  ==================================================
    OFaNet              ``OFaNetConfig()``
    W/o DA              ``OFaNetConfig(amplifier=False)``
    W/o DNS             ``OFaNetConfig(dual=False)``
    W/o RN (DA&DNS)     ``OFaNetConfig(refine="none")``
    W/o OF              ``OFaNetConfig(flow="none")``
    W/o Br              ``OFaNetConfig(flow="forward")``
    W/o JT              ``OFaNetConfig(joint=False)``
    DA&DNS&BRRN         ``OFaNetConfig(refine="birecurrent")``
    single view         ``OFaNetConfig(views=1)``
    ==================  ==================================================

    Parameters
    ----------
    views, frames : int
        V and B of the measurements, each >= 1.
    amplifier : bool
        Whether the diversity-amplified images D are inputs of separator and refine net.
    dual : bool
        Whether the separator has a branch for each view, or one branch for all views.
    refine : "none", "simplified" or "birecurrent"
        No refine net; one recurrent network with both flows as inputs; or a forward network and a backward one.
    flow : "none", "forward" or "both"
        The optical flows that the simplified refine net has as inputs.
    joint : bool
        Whether the flow net is trained together with the refine net.
    passes : int
        Number of passes of flow and refine net over the video, >= 1. Each pass uses the residual of the pass before it.
        The paper has one pass.

    Raises
    ------
    InputError
        If a field has another value.

    Examples
    --------
    >>> OFaNetConfig(frames=6, refine="none")
    OFaNetConfig(views=2, frames=6, amplifier=True, dual=True, refine='none', flow='both', joint=True, passes=1)
    """

    views: int = 2
    frames: int = 10
    amplifier: bool = True
    dual: bool = True
    refine: str = "simplified"
    flow: str = "both"
    joint: bool = True
    passes: int = 1

    def __post_init__(self) -> None:
        for name, value in (("views", self.views), ("frames", self.frames), ("passes", self.passes)):
            if not isinstance(value, int) or not 1 <= value <= MOST:
                raise InputError(f"{name} is {value!r}: a whole number from 1 to {MOST} was expected")
        for name, value, known in (("refine", self.refine, REFINES), ("flow", self.flow, FLOWS)):
            if value not in known:
                raise InputError(f"{name} is {value!r}: one of {', '.join(known)} was expected")

    @property
    def diversity(self) -> int:
        """Number of the images D: two per view with the amplifier, else 0."""
        return 2 * self.views if self.amplifier else 0

    @property
    def uses_flow(self) -> bool:
        """Whether the model has a flow net."""
        return self.refine == "birecurrent" or (self.refine == "simplified" and self.flow != "none")
