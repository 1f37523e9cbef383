"""Checks of what every prior and every operator promises, for yours as for those of this package."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from pnp_sci.plugins.protocols import Prior, Session, Traits
from pnp_sci.plugins.resolve import as_prior
from pnp_sci.sensing.operator import adjoint_mismatch

SHAPES = (1, 1, 9, 11), (2, 3, 34, 33), (1, 4, 12, 40)  # V, B, H, W: odd sizes, single frames, small frames
SIGMA = 0.1
CALLS = 3  # of a session: one that remembers shows it


class ContractError(AssertionError):
    """A promise that is not kept; the message says which, and where."""


def check_prior(prior: Any, shapes: Iterable[Sequence[int]] = SHAPES, **options: Any) -> None:
    """Check that a prior keeps its promises, see :class:`pnp_sci.Prior` and :class:`pnp_sci.Session`.

    Shapes come back, the input stays as it is, the result is finite, views are not mixed, sessions do not
    know of each other, in threads neither, a result may be written in place, and what a session tells is JSON.

    Parameters
    ----------
    prior, **options
        As for :func:`pnp_sci.as_prior`.
    shapes : iterable of (V, B, H, W)
        Of the videos to check it with.

    Raises
    ------
    ContractError
        At the first promise that is not kept.

    Examples
    --------
    >>> from pnp_sci.testing import check_prior
    >>> check_prior("tv")
    >>> check_prior(lambda x, sigma: x[:1], shapes=[(2, 3, 8, 8)])
    Traceback (most recent call last):
    pnp_sci.testing.ContractError: shape (2, 3, 8, 8), float32: (1, 3, 8, 8) is returned
    """
    made = as_prior(prior, **options)
    for shape in map(tuple, shapes):
        _require(isinstance(made.traits(shape), Traits), f"traits({shape}) is {made.traits(shape)!r}")
        for dtype in (np.dtype(np.float32), np.dtype(np.float64)):
            where = f"shape {shape}, {dtype}"
            _check_calls(made, shape, dtype, where)
            _check_sessions(made, shape, dtype, where)
            if shape[0] > 1:
                _check_views(made, shape, dtype, where)


def _check_calls(prior: Prior, shape: tuple[int, ...], dtype: np.dtype, where: str) -> None:
    session, v = prior.begin(shape, dtype), _video(shape, dtype)
    before = v.copy()
    _require(isinstance(session, Session), f"begin returns {session!r}: a Session was expected")
    for sigma in (SIGMA, 1.0, 0.0):
        x = np.asarray(session(v, sigma))
        _require(x.shape == shape, f"{where}: {x.shape} is returned")
        _require(bool(np.isfinite(x).all()), f"{where}, sigma {sigma}: a value is not finite")
        _require(np.array_equal(v, before), f"{where}, sigma {sigma}: the input has changed")
    finished = np.asarray(session.finish(v, SIGMA))
    _require(finished.shape == shape, f"{where}: finish returns another shape")
    _require(bool(np.isfinite(finished).all()), f"{where}: finish returns a value that is not finite")
    _require(np.array_equal(v, before), f"{where}: finish changes its input")
    try:
        json.dumps(dict(session.facts()))
    except (TypeError, ValueError) as error:
        raise ContractError(f"{where}: facts are no JSON: {error}") from error


def _check_sessions(prior: Prior, shape: tuple[int, ...], dtype: np.dtype, where: str) -> None:
    v, alone = _video(shape, dtype), _course(prior, shape, dtype)
    one, other, in_place = (prior.begin(shape, dtype) for _ in range(3))
    for expected in alone:
        x = np.array(one(v, SIGMA))
        other(0.5 * v, 2 * SIGMA)
        _require(np.array_equal(x, expected), f"{where}: another session at work changes the result")
        w = v.copy()
        _require(np.array_equal(in_place(w, SIGMA, out=w), expected), f"{where}: in place the result is another")
    with ThreadPoolExecutor(2) as pool:
        for course in pool.map(lambda _: _course(prior, shape, dtype), range(2)):
            same = all(np.allclose(a, b, atol=1e-5) for a, b in zip(course, alone))
            _require(same, f"{where}: in two threads the result is another")


def _check_views(prior: Prior, shape: tuple[int, ...], dtype: np.dtype, where: str) -> None:
    changed = _video(shape, dtype)
    changed[-1] = 3 * changed[-1, ::-1]
    for x, other in zip(_course(prior, shape, dtype), _course(prior, shape, dtype, changed)):
        same = np.allclose(x[:-1], other[:-1], atol=1e-5)
        _require(same, f"{where}: another last view changes the first: views are mixed")


def check_operator(op: Any, seed: int = 0) -> None:
    """Check that an operator keeps its promises, see :class:`pnp_sci.SensingOperator`.

    ``<Phi x, y> = <x, Phi^T y>``; gram is the diagonal of Phi Phi^T; the projection measures y wherever a mask is open,
    moves no other pixel, and with ``rho`` minimises ``||y - Phi z||^2 + rho ||z - x||^2``.

    Parameters
    ----------
    op : SensingOperator or alike
        With ``shape`` (V, B, H, W), ``gram`` of the shape of y, ``forward``, ``adjoint`` and ``project``.
    seed : int
        Of the random videos and measurements.

    Raises
    ------
    ContractError
        At the first promise that is not kept.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> from pnp_sci.testing import check_operator
    >>> check_operator(pnp_sci.SensingOperator(np.ones((2, 3, 4, 5), bool)))
    """
    random = np.random.default_rng(seed)
    x, y = random.standard_normal(op.shape), random.standard_normal(np.shape(op.gram))
    gram = _floats(op.gram)
    scale = float(np.sqrt(gram.max())) or 1.0
    close = _closeness(op)
    _require(adjoint_mismatch(op, seed) < close, "the adjoint is not that of forward")
    diagonal = _floats(op.forward(op.adjoint(np.ones_like(y))))
    _require(_near(diagonal, gram, close * scale**2), "gram is not the diagonal of Phi Phi^T")
    seen = gram > close * scale**2
    z = _floats(op.project(x, scale * y))
    left = scale * y - _floats(op.forward(z))
    _require(_near(left[seen], 0, 100 * close * scale), "the projection does not measure y")
    closed = np.broadcast_to(_floats(op.adjoint(np.ones_like(y))) == 0, x.shape)
    moved = closed & (np.abs(z - x) > close)
    _require(not moved.any(), "the projection moves what no mask shows")
    rho = 0.7 * scale**2
    z = _floats(op.project(x, scale * y, rho))
    slope = rho * (z - x) - _floats(op.adjoint(scale * y - _floats(op.forward(z))))
    _require(_near(slope, 0, 100 * close * scale**2), "the projection with rho does not minimise its objective")


def _video(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    return np.random.default_rng(0).random(shape).astype(dtype)


def _course(prior: Prior, shape: tuple[int, ...], dtype: np.dtype, video: np.ndarray | None = None) -> list[np.ndarray]:
    """What some calls of a session return, all with the same video."""
    session: Callable[..., Any] = prior.begin(shape, dtype)
    v = _video(shape, dtype) if video is None else video
    return [np.array(session(v, SIGMA)) for _ in range(CALLS)]


def _floats(array: Any) -> np.ndarray:
    return np.asarray(array, np.float64)


def _closeness(op: Any) -> float:
    """Relative rounding errors that sums over all planes may have."""
    planes = op.shape[0] * op.shape[1]
    return float(np.finfo(np.asarray(op.gram).dtype).eps) * 8 * (planes + 8)


def _near(a: np.ndarray, b: Any, tolerance: float) -> bool:
    return bool(np.all(np.abs(a - b) <= tolerance))


def _require(kept: bool, otherwise: str) -> None:
    if not kept:
        raise ContractError(otherwise)
