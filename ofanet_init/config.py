"""Which of the paper's systems a model is."""

from __future__ import annotations

from dataclasses import dataclass

from pnp_sci.errors import InputError

REFINES = ("none", "simplified", "birecurrent")
FLOWS = ("none", "forward", "both")


@dataclass(frozen=True)
class OFaNetConfig:
    """Architecture of OFaNet and of the variants in its ablation table.

    ==================  ==================================================
    the paper's name    configuration
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
        V and B of the measurements it decodes.
    amplifier : bool
        Whether the diversity-amplified images D go into separator and refine net.
    dual : bool
        A branch of its own for every view, or one for all of them.
    refine : "none", "simplified" or "birecurrent"
        No refine net; the recurrent network that sees both flows; or a forward network followed by a backward one.
    flow : "none", "forward" or "both"
        Which optical flows the simplified refine net sees.
    joint : bool
        Whether the flow net learns in the stages of training in which the refine net does.
    passes : int
        How often flow and refine net go over the video, each time with what is left of the measurement then; the
        paper's go over it once.

    Raises
    ------
    InputError
        If a field has none of these values.

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
            if not isinstance(value, int) or value < 1:
                raise InputError(f"{name} is {value!r}: a whole number >= 1 was expected")
        for name, value, known in (("refine", self.refine, REFINES), ("flow", self.flow, FLOWS)):
            if value not in known:
                raise InputError(f"{name} is {value!r}: one of {', '.join(known)} was expected")

    @property
    def diversity(self) -> int:
        """Number of the images D: two a view with the amplifier, else none."""
        return 2 * self.views if self.amplifier else 0

    @property
    def uses_flow(self) -> bool:
        """Whether there is a flow net."""
        return self.refine == "birecurrent" or (self.refine == "simplified" and self.flow != "none")
