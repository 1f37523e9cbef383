"""The sensing operator as a ``torch.nn.Module`` with autograd, for networks and unrolled solvers; CPU and CUDA.

This module imports torch; :mod:`pnp_sci` imports it on first use only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from pnp_sci._validate import shown
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.operator import SensingOperator, as_masks
from pnp_sci.sensing.sequence import SequenceOperator, split

_FLOATING = (torch.float32, torch.float64)


def _place(device: torch.device | str | None) -> torch.device | None:
    """The device of this name."""
    try:
        return None if device is None else torch.zeros(1, device=device).device
    except (RuntimeError, AssertionError, TypeError) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"device is {shown(device)}, which cannot be used here: {why}") from error


class TorchSensingOperator(torch.nn.Module):
    """Phi of :class:`~pnp_sci.sensing.operator.SensingOperator` on tensors, differentiable, with any batch dimensions.

    ``y = sum over views v and frames b of masks[v, b] * x[v, b]``. Masks and gram are buffers: ``.to(device)`` and
    ``.double()`` apply to them, and the ``state_dict`` contains them.

    Parameters
    ----------
    masks : array_like, Tensor, (V, B, H, W) or (B, H, W), or SensingOperator
        Any real values; 3-D masks are a single view. bool and uint8 are stored with one byte per element.
    dtype : torch.float32 or torch.float64, optional
        Type of videos and measurements. By default float64 if masks are float64, else float32.
    device : torch.device or str, optional
        By default that of masks if they are a tensor, else the CPU.

    Attributes
    ----------
    masks : Tensor, (V, B, H, W)
    gram : Tensor, (H, W)
        The diagonal of Phi Phi^T, ``sum(masks**2)`` over views and frames.
    shape : tuple
        (V, B, H, W)

    Raises
    ------
    InputError, InputTypeError
        If masks are not finite real numbers (V, B, H, W), dtype is another one, or the device cannot be used.

    Examples
    --------
    >>> op = TorchSensingOperator(torch.ones(2, 3, 4, 5))
    >>> x = torch.ones(7, 2, 3, 4, 5, requires_grad=True)  # a batch of 7
    >>> y = op(x)
    >>> y.shape, y[0, 0, 0].item()
    (torch.Size([7, 4, 5]), 6.0)
    >>> y.sum().backward()
    >>> float(x.grad.sum())
    840.0
    """

    masks: torch.Tensor
    gram: torch.Tensor

    def __init__(self, masks: Any, dtype: torch.dtype | None = None, device: torch.device | str | None = None):
        super().__init__()
        if dtype is not None and not (isinstance(dtype, torch.dtype) and dtype in _FLOATING):
            raise InputTypeError(f"dtype is {shown(dtype)}: torch.float32 or torch.float64 was expected")
        if isinstance(masks, SensingOperator):
            dtype = dtype or getattr(torch, masks.dtype.name)
        elif isinstance(masks, torch.Tensor):
            device = device or masks.device
            masks = masks.detach().cpu().numpy()
        device = _place(device)
        array = as_masks(masks, np.dtype(np.float64) if dtype == torch.float64 else None)
        dtype = dtype or (torch.float64 if array.dtype == np.float64 else torch.float32)
        # a copy, as the array may be the caller's
        tensor = torch.tensor(array, dtype=torch.uint8 if array.dtype == np.uint8 else dtype, device=device)
        self.register_buffer("masks", tensor)
        self.register_buffer("gram", tensor.to(dtype).square().sum((0, 1)))

    def extra_repr(self) -> str:
        """Text of ``repr`` between the parentheses."""
        views, frames, rows, columns = self.shape
        return f"{views} x {frames} masks of {rows} x {columns}, {self.masks.dtype} -> {self.dtype}"

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(V, B, H, W)."""
        return tuple(self.masks.shape)  # type: ignore[return-value]

    @property
    def dtype(self) -> torch.dtype:
        """Type of videos and measurements."""
        return self.gram.dtype

    def forward(self, x: Any) -> torch.Tensor:
        """Phi x: measurements (..., H, W) of videos (..., V, B, H, W)."""
        return (self.masks * self._tensor("x", x, self.shape)).sum((-4, -3))

    def adjoint(self, y: Any) -> torch.Tensor:
        """Phi^T y: measurements (..., H, W) times each mask, (..., V, B, H, W)."""
        return self.masks * self._tensor("y", y, self.shape[2:])[..., None, None, :, :]

    def project(self, x: Any, y: Any, rho: float | torch.Tensor = 0.0) -> torch.Tensor:
        """``x + Phi^T (y - Phi x) / (gram + rho)``, see :meth:`pnp_sci.SensingOperator.project`; differentiable.

        Pixels where ``gram + rho`` is 0 keep their value.

        Parameters
        ----------
        x : Tensor or array_like, (..., V, B, H, W)
        y : Tensor or array_like, (..., H, W)
            Its batch dimensions broadcast against those of x.
        rho : float or Tensor
            >= 0, in units of gram: one value, one for each measurement (...), or one for each pixel (..., H, W). A
            tensor may require gradients.

        Returns
        -------
        Tensor, (..., V, B, H, W)

        Raises
        ------
        InputError, InputTypeError
            If the last dimensions differ from those of the masks, values are not real, or rho is negative.
        """
        smallest = float(rho.detach().min() if isinstance(rho, torch.Tensor) else rho)
        if not smallest >= 0:
            raise InputError(f"rho is {smallest}: a number >= 0 was expected")
        x, y = self._tensor("x", x, self.shape), self._tensor("y", y, self.shape[2:])
        batch = torch.broadcast_shapes(x.shape[:-4], y.shape[:-2])
        if isinstance(rho, torch.Tensor):
            rho = rho.to(self.gram)
            rho = rho[..., None, None] if rho.ndim and rho.shape == batch else rho
        total = self.gram + rho
        alive = total > 0
        weight = alive / torch.where(alive, total, 1)
        return x + self.adjoint((y - self.forward(x)) * weight)

    def multiplier(
        self,
        dual: torch.Tensor,
        residual: torch.Tensor,
        pace: float,
        rho: float | torch.Tensor,
        saturated: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The multiplier of GAP and its move, as :meth:`pnp_sci.SensingOperator.multiplier`, (..., H, W)."""
        rho = rho.to(self.gram) if isinstance(rho, torch.Tensor) else rho
        alive = self.gram > 0
        total = torch.where(alive, self.gram + pace * rho, 1)  # never 0, which would make gradients NaN
        after = (dual + pace * residual) * torch.where(alive, self.gram / total, 0)
        if saturated is not None:
            after = torch.where(saturated & (after < 0), 0, after)
        return after, (after - dual) / pace

    def _tensor(self, name: str, value: Any, shape: tuple[int, ...]) -> torch.Tensor:
        if not isinstance(value, torch.Tensor):
            array = np.asarray(value)
            if array.dtype.kind not in "biuf":
                raise InputTypeError(f"{name} has dtype {array.dtype}: real numbers were expected")
            value = torch.tensor(np.ascontiguousarray(array, np.float64), dtype=self.dtype)
        if value.is_complex():
            raise InputTypeError(f"{name} has dtype {value.dtype}: real numbers were expected")
        if tuple(value.shape[-len(shape) :]) != shape:
            expected = ", ".join(map(str, shape))
            raise InputError(
                f"{name} has shape {tuple(value.shape)}: (..., {expected}) was expected, as the masks have it"
            )
        return value.to(self.gram)


class TorchSequenceOperator:
    """:class:`pnp_sci.SequenceOperator` on tensors: parts of consecutive measurements, each seeing its own frames.

    Parameters
    ----------
    op : SequenceOperator
    device : str, optional
    """

    def __init__(self, op: SequenceOperator, device: str | None = None):
        parts = {id(part): TorchSensingOperator(part, device=device) for part in op.parts}
        self.parts = [parts[id(part)] for part in op.parts]
        self.shape, self.gram = op.shape, torch.stack([part.gram for part in self.parts])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Phi x: the measurements (N, H, W) of a video (V, N * B, H, W)."""
        return torch.stack([part(video) for part, video in zip(self.parts, split(x, len(self.parts)))])

    def project(self, x: torch.Tensor, y: torch.Tensor, rho: float | torch.Tensor = 0.0) -> torch.Tensor:
        """As :meth:`pnp_sci.SequenceOperator.project`."""
        rhos = rho if isinstance(rho, torch.Tensor) and rho.ndim else [rho] * len(self.parts)
        videos = zip(self.parts, split(x, len(self.parts)), y, rhos)
        return torch.cat([part.project(video, picture, weight) for part, video, picture, weight in videos], 1)

    multiplier = TorchSensingOperator.multiplier  # of (N, H, W): it needs no more than gram
