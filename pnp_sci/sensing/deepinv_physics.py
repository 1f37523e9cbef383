"""The sensing operator as a physics of deepinv, for its algorithms, losses and unrolled networks.

This module imports deepinv; no other module of :mod:`pnp_sci` imports it.
"""

from __future__ import annotations

from typing import Any

import torch
from deepinv.physics import LinearPhysics

from pnp_sci.errors import InputError
from pnp_sci.sensing.torch_operator import TorchSensingOperator


class SensingPhysics(LinearPhysics):
    """Phi as a ``deepinv.physics.LinearPhysics``: videos (N, V, B, H, W) to measurements (N, 1, H, W).

    The views are deepinv's channels, and the frames its time axis. As Phi Phi^T is diagonal, the pseudo-inverse and the
    proximal map of the data term have closed forms.

    Parameters
    ----------
    masks : array_like, Tensor, (V, B, H, W) or (B, H, W), or SensingOperator
        As for :class:`~pnp_sci.TorchSensingOperator`.
    device : torch.device or str, optional
        By default that of masks if they are a tensor, else the CPU.
    **options
        Arguments of ``LinearPhysics``, such as ``noise_model=deepinv.physics.GaussianNoise(0.01)``.

    Attributes
    ----------
    op : TorchSensingOperator
    img_size : tuple
        (V, B, H, W)

    Raises
    ------
    ImportError
        If deepinv is not installed.
    InputError, InputTypeError
        As :class:`~pnp_sci.TorchSensingOperator` does.

    References
    ----------
    J. Tachella et al., "DeepInverse: a Python package for solving imaging inverse problems with deep learning",
    JOSS 2025.

    Examples
    --------
    >>> physics = SensingPhysics(torch.ones(2, 3, 4, 5))  # doctest: +SKIP
    >>> physics(torch.ones(7, 2, 3, 4, 5)).shape  # doctest: +SKIP
    torch.Size([7, 1, 4, 5])
    """

    def __init__(self, masks: Any, device: torch.device | str | None = None, **options: Any):
        op = TorchSensingOperator(masks, device=device)
        super().__init__(img_size=op.shape, device=op.gram.device, **options)
        self.op = op

    def A(self, x: torch.Tensor, **_: Any) -> torch.Tensor:
        """Phi x: (N, 1, H, W) from (N, V, B, H, W)."""
        if x.ndim != 5:
            raise InputError(f"x has shape {tuple(x.shape)}: (N, V, B, H, W) was expected")
        return self.op(x)[:, None]

    def A_adjoint(self, y: torch.Tensor, **_: Any) -> torch.Tensor:
        """Phi^T y: (N, V, B, H, W) from (N, 1, H, W)."""
        return self.op.adjoint(_picture(y))

    def A_dagger(self, y: torch.Tensor, **_: Any) -> torch.Tensor:
        """Pseudo-inverse of Phi: ``Phi^T (y / gram)``, 0 where gram is 0; (N, V, B, H, W) from (N, 1, H, W)."""
        return self.op.project(self.A_adjoint(torch.zeros_like(y)), _picture(y))

    def prox_l2(self, z: torch.Tensor | float | None, y: torch.Tensor, gamma: Any, **_: Any) -> torch.Tensor:
        """Minimiser of ``gamma / 2 ||Phi x - y||^2 + 1 / 2 ||x - z||^2``; gamma > 0, one value or N values."""
        if not isinstance(z, torch.Tensor):
            z = torch.full_like(self.A_adjoint(y), z or 0.0)
        rho = 1 / torch.as_tensor(gamma, dtype=z.dtype, device=z.device)
        return self.op.project(z, _picture(y), rho.reshape(-1, 1, 1))


def _picture(y: torch.Tensor) -> torch.Tensor:
    """Measurements (N, H, W) from (N, 1, H, W)."""
    if y.ndim != 4 or y.shape[1] != 1:
        raise InputError(f"y has shape {tuple(y.shape)}: (N, 1, H, W) was expected")
    return y[:, 0]
