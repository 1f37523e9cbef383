"""The recurrent refine net: frame after frame, with the motion between them and the memory of those before."""

from __future__ import annotations

import torch
from torch import nn

from ofanet_init.blocks import ResidualUnit, chain, convolution, residual_block
from ofanet_init.flow import warped

HIDDEN = 40  # channels of the memory H
EVIDENCE = 2  # planes that come with a frame: its mask, and what is left of the measurement, through that mask


class Memory(nn.Module):
    """F_H: what the memory of the frames so far says of the next one."""

    def __init__(self) -> None:
        super().__init__()
        self.blocks = nn.Sequential(residual_block(HIDDEN), residual_block(HIDDEN))
        self.out = chain(HIDDEN, ((1, 3), 20), ((3, 1), 20), ((1, 3), 10))

    def forward(self, hidden: torch.Tensor) -> torch.Tensor:
        """(N, 40, H, W) -> (N, 10, H, W)."""
        return self.out(self.blocks(hidden))


class Cell(nn.Module):
    """One step of the recurrence: ``H[t] = fuse(F_X(x[t], C[t], C[t] r), F_F(flows), F_D(D), F_H(H[t - 1]))``.

    Its frame is ``x[t] + R(H[t])``.
    """

    def __init__(self, diversity: int, flows: int):
        super().__init__()
        features = ((5, 20), (1, 20), (3, 20), (1, 20), (3, 20))
        self.f_x = chain(1 + EVIDENCE, *features)
        self.f_f = nn.ModuleList(chain(2, (5, 40), (3, 40), (1, 40)) for _ in range(flows))
        self.f_d = chain(diversity, *features) if diversity else None
        self.f_h = Memory()
        self.fuse = nn.Sequential(
            convolution(20 + 40 * flows + (20 if diversity else 0) + 10, HIDDEN, 3), ResidualUnit(HIDDEN)
        )
        self.r = chain(HIDDEN, (3, 40), (1, 30), (3, 20), (1, 20), (3, 20), (1, 1), last=False)
        for start in self.r[-1].parameters():  # it starts by adding nothing
            nn.init.zeros_(start)

    def forward(
        self, frame: torch.Tensor, evidence: torch.Tensor, flows: list[torch.Tensor], constant: list[torch.Tensor],
        hidden: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
        """Refine a frame (N, 1, H, W), given its evidence (N, 2, H, W): new memory (N, 40, H, W) and new frame."""
        motion = [net(flow / 10) for net, flow in zip(self.f_f, flows)]
        seen = self.f_x(torch.cat([frame, evidence], 1))
        hidden = self.fuse(torch.cat([seen, *motion, *constant, self.f_h(hidden)], 1))
        return hidden, frame + self.r(hidden)


class Refiner(nn.Module):
    """A recurrent pass over the frames of a video, the same for every view.

    The paper's text takes x[t] "as a good initialization" where its equation has x[t - 1]; here it is x[t], and R gives
    what is to be added, so that a net that has learned nothing returns the frame as it came. Beyond the paper, F_X also
    sees the frame's mask and, through it, the normalised residual r of the whole video: what an estimate has missed is
    in the measurement more than in the frame. Without them the net had gained nothing after 900 steps, with them
    0.36 dB on training samples after 300. Where the flow from t back to t - 1 is at hand, the memory is fetched along
    it, which the paper leaves to the net. The first frame has no predecessor: its memory and its flows are zero.

    Parameters
    ----------
    diversity : int
        Number of the images D; 0 leaves F_D out.
    flows : int
        Number of flows that come with each frame, 0 to 2.
    """

    def __init__(self, diversity: int, flows: int):
        super().__init__()
        self.cell = Cell(diversity, flows)

    def forward(
        self, x: torch.Tensor, evidence: torch.Tensor, flows: list[torch.Tensor], diversity: torch.Tensor
    ) -> torch.Tensor:
        """Refine x (N, B, H, W).

        evidence: (N, B, 2, H, W); flows, onward and then back: (N, B - 1, 2, H, W); diversity, the images D:
        (N, C, H, W).
        """
        hidden = x.new_zeros(len(x), HIDDEN, *x.shape[2:])
        still = x.new_zeros(len(x), 2, *x.shape[2:])
        constant = [self.cell.f_d(diversity)] if self.cell.f_d is not None else []
        frames = []
        for t in range(x.shape[1]):
            here = [flow[:, t - 1] if t else still for flow in flows]
            if t and len(here) == 2:
                hidden = warped(hidden, here[1])
            hidden, frame = self.cell(x[:, t : t + 1], evidence[:, t], here, constant, hidden)
            frames.append(frame)
        return torch.cat(frames, 1)
