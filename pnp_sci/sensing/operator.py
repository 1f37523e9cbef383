"""The sensing operator Phi of snapshot compressive imaging, for any number of views."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci._validate import real_array, require_finite, shaped, shown, whole
from pnp_sci.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from scipy.sparse.linalg import LinearOperator

BY_NOISE = 0.01  # of the sum of magnitudes: so much is negative by noise, of light or of masks
DIMMEST = 0.05  # root of the gram of a pixel, in units of the mean one, below which it counts as unlit


def _kernels() -> Any:
    """The compiled functions: to import the package loads no numba, which takes long."""
    from pnp_sci.sensing import kernels

    return kernels


def as_masks(masks: Any, dtype: np.dtype | None = None) -> np.ndarray:
    """Masks, or those of an operator, as a C-ordered array (V, B, H, W) of native byte order.

    bool becomes uint8, and uint8 stays. Other types become `dtype`, by default float64 for float64 and float32 else.

    Raises
    ------
    InputError
        If the array is not (V, B, H, W) or (B, H, W), is empty, or has NaN or infinite values.
    InputTypeError
        If the values are not real numbers.
    """
    if isinstance(masks, SensingOperator):
        masks = masks.masks
    array = real_array("masks", masks)
    if array.ndim == 3:
        array = array[None]
    if array.ndim != 4 or array.size == 0:
        empty = ", none of them 0" if array.size == 0 else ""
        raise InputError(f"masks has shape {np.shape(masks)}: (views, frames, rows, columns) was expected{empty}")
    if array.dtype == bool:
        return np.ascontiguousarray(array).view(np.uint8)
    if array.dtype == np.uint8:
        return np.ascontiguousarray(array)
    if dtype is None:
        dtype = np.dtype(np.float64 if array.dtype.type is np.float64 else np.float32)
    require_finite("masks", array)
    with np.errstate(over="ignore"):
        converted = np.ascontiguousarray(array, dtype)
    require_finite("masks", converted)
    return converted


def are_signed(masks: np.ndarray) -> bool:
    """Whether the sum of negative masks is more than 1 % of all magnitudes; calibrated ones have less, by noise."""
    if masks.dtype == np.uint8 or masks.min() >= 0:
        return False
    below = -np.sum(masks, where=masks < 0, dtype=np.float64)
    return bool(below > BY_NOISE * (2 * below + np.sum(masks, dtype=np.float64)))


def _same_type(dtype: Any, known: type) -> bool:
    """Whether `dtype` stands for a known one; what is no dtype does not."""
    try:
        return np.dtype(dtype) == known
    except (TypeError, ValueError):  # ValueError: the dtype of a tensor
        return False


class SensingOperator:
    """The sensing operator Phi: maps the videos of all views to one coded measurement.

    ``y = sum over views v and frames b of masks[v, b] * x[v, b]``  (Lu et al., OFaNet, Eq. 1)

    Parameters
    ----------
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
        Transmission of each mask element, any real values; 3-D masks are a single view. bool and uint8 are stored with
        one byte per element.
    dtype : float32 or float64, optional
        Type of videos and measurements. By default that of an operator, or float64 if masks are float64, else float32.

    Attributes
    ----------
    masks : ndarray, (V, B, H, W)
    gram : ndarray, (H, W)
        The diagonal of Phi Phi^T, ``sum(masks**2)`` over views and frames.
    shape : tuple
        (V, B, H, W)

    Raises
    ------
    InputError, InputTypeError
        If masks are not finite real numbers (V, B, H, W), or dtype is another one.

    Examples
    --------
    >>> import numpy as np
    >>> op = SensingOperator(np.ones((2, 3, 4, 5), bool))
    >>> float(op.forward(np.ones((2, 3, 4, 5)))[0, 0])
    6.0
    """

    def __init__(self, masks: Any, dtype: Any = None):
        if dtype is not None and not any(_same_type(dtype, known) for known in (np.float32, np.float64)):
            raise InputTypeError(f"dtype is {shown(dtype)}: float32 or float64 was expected")
        if isinstance(masks, SensingOperator):
            dtype = dtype or masks.dtype
        self.masks = as_masks(masks, None if dtype is None else np.dtype(dtype))
        if isinstance(masks, np.ndarray) and np.may_share_memory(self.masks, masks):
            self.masks = self.masks.copy()  # the caller may write to his own, which would make `gram` wrong
        self.dtype = np.dtype(dtype or (np.float64 if self.masks.dtype == np.float64 else np.float32))
        self.shape: tuple[int, int, int, int] = self.masks.shape  # type: ignore[assignment]

    def __repr__(self) -> str:
        views, frames, rows, columns = self.shape
        return f"SensingOperator({views} x {frames} masks of {rows} x {columns}, {self.masks.dtype} -> {self.dtype})"

    @property
    def parts(self) -> tuple[SensingOperator, ...]:
        """The operators of the single measurements: this one alone."""
        return (self,)

    @property
    def pictures(self) -> tuple[int, ...]:
        """Shape of y, (H, W)."""
        return self.shape[2:]

    def crop(self, where: tuple[slice, slice]) -> SensingOperator:
        """The operator of a part of the picture, rows and columns."""
        return SensingOperator(self.masks[(..., *where)], self.dtype)

    @property
    def _planes(self) -> np.ndarray:
        return self.masks.reshape(-1, self.shape[2] * self.shape[3])

    @cached_property
    def gram(self) -> np.ndarray:
        """The diagonal of Phi Phi^T, (H, W)."""
        total = np.empty(self.shape[2] * self.shape[3], self.dtype)
        _kernels().gram(self._planes, total)
        return total.reshape(self.shape[2:])

    @cached_property
    def signed(self) -> bool:
        """Whether masks are negative by more than the noise of a calibration, see :func:`are_signed`."""
        return are_signed(self.masks)

    @property
    def unlit(self) -> np.ndarray:
        """Pixels, bool like `gram`, with the root of the gram below 5 % of the mean root, as beside a stop."""
        root = np.sqrt(self.gram, dtype=np.float64)
        return root <= DIMMEST * root.mean((-2, -1), keepdims=True)

    def forward(self, x: Any, out: np.ndarray | None = None) -> np.ndarray:
        """Phi x: the measurement (H, W) of a video (V, B, H, W)."""
        x = self._array("x", x, self.shape)
        y = self._output(out, self.shape[2:])
        _kernels().forward(self._planes, x.reshape(self._planes.shape), y.reshape(-1))
        return y

    def adjoint(self, y: Any, out: np.ndarray | None = None) -> np.ndarray:
        """Phi^T y: the measurement (H, W) times each mask, (V, B, H, W)."""
        y = self._array("y", y, self.shape[2:])
        x = self._output(out, self.shape)
        _kernels().adjoint(self._planes, y.reshape(-1), x.reshape(self._planes.shape))
        return x

    def project(self, x: Any, y: Any, rho: float | np.ndarray = 0.0, out: np.ndarray | None = None) -> np.ndarray:
        """``x + Phi^T (y - Phi x) / (gram + rho)`` in one fused pass.

        With ``rho = 0`` it is the Euclidean projection of x onto the set ``{z : Phi z = y}``. With ``rho > 0`` it is
        the minimiser of ``||y - Phi z||^2 + rho ||z - x||^2``. Pixels where ``gram + rho`` is 0 keep their value.

        Parameters
        ----------
        x : array_like, (V, B, H, W)
        y : array_like, (H, W)
        rho : float or ndarray, (H, W)
            >= 0, in units of gram; one value for all pixels or one for each.
        out : ndarray, (V, B, H, W), optional
            Array for the result; may be `x`.

        Returns
        -------
        ndarray, (V, B, H, W)
            `out`, or a new array.

        Raises
        ------
        InputError, InputTypeError
            If a shape does not agree with the masks, values are not real, rho is negative, or out cannot be used.
        """
        x = self._array("x", x, self.shape)
        y = self._array("y", y, self.shape[2:])
        out = self._output(out, self.shape)
        flat = self._planes.shape
        weight = self._weight(rho)
        _kernels().project(self._planes, x.reshape(flat), y.reshape(-1), weight, out.reshape(flat), out is x)
        return out

    def multiplier(
        self,
        dual: np.ndarray,
        residual: np.ndarray,
        pace: float,
        rho: float | np.ndarray,
        saturated: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The multiplier q' of GAP and its move m, both (H, W), 0 in pixels that every mask leaves closed.

        ``q' = (q + pace r) gram / (gram + pace rho);  m = (q' - q) / pace``  for the multiplier q = `dual` and the
        residual r.

        Parameters
        ----------
        dual, residual : ndarray, (H, W)
            In the units of y.
        pace : float
            Length of the step, > 0, without unit: 1 is the step of GAP.
        rho : float or ndarray, (H, W)
            >= 0, in units of gram.
        saturated : ndarray of bool, (H, W), optional
            Pixels in which q' is 0 or more.
        """
        after, move = (np.empty(dual.shape, self.dtype) for _ in range(2))
        bounds = np.empty(0, bool) if saturated is None else saturated.reshape(-1)
        with np.errstate(over="ignore"):  # an infinite rho leaves nothing of the multiplier
            rho = np.asarray(rho, self.dtype).reshape(-1)
        given, made = ([a.reshape(-1) for a in arrays] for arrays in ((dual, residual, self.gram), (after, move)))
        _kernels().multiplier(*given, self.dtype.type(pace), rho, bounds, *made)
        return after, move

    def linear_operator(self) -> LinearOperator:
        """This operator for :mod:`scipy.sparse.linalg`; vectors are flattened (V, B, H, W) and (H, W) arrays."""
        from scipy.sparse import linalg

        make: Any = linalg.LinearOperator  # type checkers see an abstract class
        return make(
            (int(np.prod(self.pictures)), int(np.prod(self.shape))),
            matvec=lambda x: self.forward(np.reshape(x, self.shape)).ravel(),
            rmatvec=lambda y: self.adjoint(np.reshape(y, self.pictures)).ravel(),
            dtype=self.dtype,
        )

    def _weight(self, rho: Any) -> np.ndarray:
        """``1 / (gram + rho)``, flat, 0 where the sum is 0 or denormal; cached for the last scalar rho."""
        cached = self.__dict__.get("_last_weight")
        if np.ndim(rho) == 0 and cached is not None and cached[0] == float(rho):
            return cached[1]
        rho = self._array("rho", rho, self.shape[2:]) if np.ndim(rho) else float(rho)
        if not np.min(rho) >= 0:
            raise InputError(f"rho is {np.min(rho)}: a number >= 0 was expected")
        with np.errstate(over="ignore"):  # an infinite rho keeps x
            total = (self.gram + np.asarray(rho, self.dtype)).reshape(-1)
        weight = np.divide(1, total, out=np.zeros_like(total), where=total >= np.finfo(self.dtype).tiny)
        if np.ndim(rho) == 0:
            self._last_weight = rho, weight
        return weight

    def _array(self, name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
        return shaped(name, value, shape, self.dtype)

    def _output(self, out: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
        if out is None:
            return np.empty(shape, self.dtype)
        if out.shape != shape or out.dtype != self.dtype or not out.flags.c_contiguous or not out.flags.writeable:
            raise InputError(f"out is {out.dtype} {out.shape}: a writeable C-ordered {self.dtype} {shape} was expected")
        return out


def adjoint_mismatch(op: Any, seed: int = 0) -> float:
    """``|<Phi x, y> - <x, Phi^T y>|`` relative to ``||Phi x|| ||y||``, for random x and y: a test of any operator.

    Parameters
    ----------
    op : object
        Has `shape` (V, B, H, W), ``forward(x)`` and ``adjoint(y)``; `pictures`, the shape of y, if it is not (H, W).
    seed : int
        Of x and y.

    Returns
    -------
    float
        About the precision of the operator's dtype if `adjoint` is right.

    Raises
    ------
    InputTypeError
        If `op` is no such object.

    Examples
    --------
    >>> import numpy as np
    >>> adjoint_mismatch(SensingOperator(np.ones((1, 2, 3, 4)))) < 1e-12
    True
    """
    if lacking := [name for name in ("shape", "forward", "adjoint") if not hasattr(op, name)]:
        raise InputTypeError(f"op is {shown(op)}: an operator was expected, which has {', '.join(lacking)}")
    rng = np.random.default_rng(whole("seed", seed, 0))
    x, y = rng.standard_normal(op.shape), rng.standard_normal(getattr(op, "pictures", op.shape[2:]))
    measured, back = np.asarray(op.forward(x), np.float64), np.asarray(op.adjoint(y), np.float64)
    norm = np.linalg.norm(measured) * np.linalg.norm(y)
    return float(abs((measured * y).sum() - (x * back).sum()) / max(norm, np.finfo(float).tiny))
