"""The Muon optimiser for convolutions: the step is the orthogonalised momentum of each kernel."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

import torch

from pnp_sci.accel.inference import half_precision

NEWTON_SCHULZ = (3.4445, -4.7750, 2.0315)  # coefficients of Jordan et al. (2024): singular values of about 0.7 to 1.2
ROUNDS = 5  # Newton-Schulz iterations
MOMENTUM = 0.95
ADAM = 0.2  # root mean square of Adam's steps, in learning rates (Liu et al. 2025): both have one rate


class Muon(torch.optim.Optimizer):
    """Muon (Jordan et al. 2024) for kernels (outputs, inputs, h, w), flattened to matrices of `outputs` rows.

    Kernels of the same shape are processed as one batch, which takes half the time of one matrix after the other.

    Parameters
    ----------
    kernels : iterable of Tensor
    lr, weight_decay : float
    """

    def __init__(self, kernels: Iterable[torch.Tensor], lr: float, weight_decay: float):
        super().__init__(kernels, {"lr": lr, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure=None):
        """Update the kernels that have a gradient."""
        for group in self.param_groups:
            alike = defaultdict(list)
            for kernel in group["params"]:
                if kernel.grad is not None:
                    alike[kernel.shape].append((kernel, kernel.grad))
            for shape, pairs in alike.items():
                kernels, gradients = (list(part) for part in zip(*pairs))
                moves = orthogonal(torch.stack(self._momenta(kernels, gradients)).flatten(2))
                rate = group["lr"] * ADAM * math.sqrt(max(moves.shape[1:]))
                torch._foreach_mul_(kernels, 1 - group["lr"] * group["weight_decay"])  # type: ignore[attr-defined]
                torch._foreach_sub_(kernels, moves.view(-1, *shape).unbind(), alpha=rate)  # type: ignore[attr-defined]

    def _momenta(self, kernels: list[torch.Tensor], gradients: list[torch.Tensor]) -> list[torch.Tensor]:
        """Update the momenta; return the gradients with Nesterov momentum."""
        for kernel in kernels:
            if not self.state[kernel]:
                self.state[kernel]["momentum"] = torch.zeros_like(kernel)
        means = [self.state[kernel]["momentum"] for kernel in kernels]
        torch._foreach_lerp_(means, gradients, 1 - MOMENTUM)  # type: ignore[attr-defined]
        return list(torch._foreach_lerp(gradients, means, MOMENTUM))  # type: ignore[attr-defined]


def orthogonal(matrices: torch.Tensor) -> torch.Tensor:
    """Approximation of U V^T for matrices U S V^T (N, rows, columns) by Newton-Schulz iterations.

    Computed in bfloat16 where the device has native instructions for it; returns float32.
    """
    x = matrices.bfloat16() if half_precision(matrices.device) else matrices.float()
    tall = x.shape[1] > x.shape[2]
    x = x.mT if tall else x
    x = x / x.norm(dim=(1, 2), keepdim=True).clamp(min=1e-7)
    a, b, c = NEWTON_SCHULZ
    for _ in range(ROUNDS):
        gram = x @ x.mT
        x = a * x + (b * gram + c * (gram @ gram)) @ x
    return (x.mT if tall else x).float()
