"""The recurrent refine net: it processes one frame after the other, with optical flow and a hidden state."""

from __future__ import annotations

import torch
from torch import nn

from ofanet_init.blocks import ResidualUnit, chain, convolution, residual_block, zero_initialised
from ofanet_init.flow import warped

HIDDEN = 40  # channels of the hidden state H
EVIDENCE = 2  # planes beside a frame: its mask, and the residual of the measurement times that mask


class Memory(nn.Module):
    """The subnetwork F_H: features of the hidden state for the next frame."""

    def __init__(self) -> None:
        super().__init__()
        self.blocks = nn.Sequential(residual_block(HIDDEN), residual_block(HIDDEN))
        self.out = chain(HIDDEN, ((1, 3), 20), ((3, 1), 20), ((1, 3), 10))

    def forward(self, hidden: torch.Tensor) -> torch.Tensor:
        """(N, 40, H, W) -> (N, 10, H, W)."""
        return self.out(self.blocks(hidden))


class Cell(nn.Module):
    """One step of the recurrence: ``H[t] = fuse(F_X(x[t], C[t], C[t] r), F_F(flows), F_D(D), F_H(H[t - 1]))``.

    The refined frame is ``x[t] + R(H[t])``.
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
        self.r = zero_initialised(chain(HIDDEN, (3, 40), (1, 30), (3, 20), (1, 20), (3, 20), (1, 1), last=False))

    def forward(
        self, frame: torch.Tensor, evidence: torch.Tensor, flows: list[torch.Tensor], constant: list[torch.Tensor],
        hidden: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
        """Refine a frame (N, 1, H, W) with its evidence (N, 2, H, W); return hidden state (N, 40, H, W) and frame."""
        motion = [net(flow / 10) for net, flow in zip(self.f_f, flows)]
        seen = self.f_x(torch.cat([frame, evidence], 1))
        hidden = self.fuse(torch.cat([seen, *motion, *constant, self.f_h(hidden)], 1))
        return hidden, frame + self.r(hidden)


class Refiner(nn.Module):
    """A recurrent pass over the frames of a video, with weights shared by the views.

    It differs from the paper in three points. The input of F_X is x[t], as in the paper's text, where its equation has
    x[t - 1]; R is a correction to x[t]. F_X also has the frame's mask and the normalised residual r as inputs. With
    both flows, the hidden state is warped along the flow from t to t - 1. The first frame has hidden state and flows 0.

    Parameters
    ----------
    diversity : int
        Number of the images D; with 0 there is no F_D.
    flows : int
        Number of flows per frame, 0 to 2.
    """

    def __init__(self, diversity: int, flows: int):
        super().__init__()
        self.cell = Cell(diversity, flows)

    def forward(
        self, x: torch.Tensor, evidence: torch.Tensor, flows: list[torch.Tensor], diversity: torch.Tensor
    ) -> torch.Tensor:
        """Refine x (N, B, H, W); returns the same shape.

        evidence: (N, B, 2, H, W); flows: forward, then backward, (N, B - 1, 2, H, W) each; diversity: the images D,
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
