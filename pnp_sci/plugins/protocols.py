"""What a prior, the memory it has of one video, and a decoder promise to the solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np

    from pnp_sci.sensing.problem import Problem
    from pnp_sci.sensing.scene_model import SceneModel


@dataclass(frozen=True)
class Traits:
    """What the solver must know of a prior before the first call.

    Attributes
    ----------
    strong : bool
        One call does much: some tens of calls suffice where a plain prior needs a hundred. The solver may start from a
        decoder's estimate.
    network : bool
        PyTorch is needed.
    warmup : (Prior, int), optional
        The prior that serves the first iterations in its place, and how many; none after a decoder's estimate.
    serves_below : float
        Standard deviation above which the warm-up prior, if it has served, goes on, in units where x spans [0, 1].
    average : bool
        The estimates fluctuate from call to call: the solver returns their mean.
    motion : bool
        It averages frames along a motion that it finds in them. Before each call the solver displaces frames where the
        data say so, see :mod:`pnp_sci.solvers.displacement`.

    Examples
    --------
    >>> Traits(strong=True).average
    False
    """

    strong: bool = False
    network: bool = False
    warmup: tuple[Prior, int] | None = None
    serves_below: float = float("inf")
    average: bool = False
    motion: bool = False


@runtime_checkable
class Session(Protocol):
    """The state of a prior for one video."""

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        """Denoise v.

        Parameters
        ----------
        v : ndarray, (V, B, H, W)
            C-ordered, of the shape and dtype that the session began with; values about [0, 1]. Stays as it is unless
            it is `out`.
        sigma : float
            Standard deviation of the noise in the same units, >= 0.
        out : ndarray, optional
            An array of the same shape and dtype, maybe v itself, that the result may be written to.

        Returns
        -------
        ndarray, (V, B, H, W)
            `out`, or another array; the solver copies what is in another one at once. Views must not be mixed.
        """
        ...

    def finish(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """What the solver returns instead of its last estimate; by default that itself.

        Parameters
        ----------
        x : ndarray, (V, B, H, W)
            The last estimate.
        sigma : float
            Standard deviation of the noise, as for a call.
        """
        return x

    def facts(self) -> Mapping[str, Any]:
        """What is recorded in the result: ``still`` (part of each view), ``weights`` (list of hashes of networks)."""
        return {}


@runtime_checkable
class Prior(Protocol):
    """A denoiser that encodes what is assumed of a video. Immutable: threads and processes may share one.

    Examples
    --------
    A prior that smooths along time; its session is a function, as it needs no memory:

    >>> import pnp_sci
    >>> from scipy.ndimage import gaussian_filter1d
    >>> smooth = pnp_sci.as_prior(lambda v, sigma: gaussian_filter1d(v, 1.0, axis=1))
    >>> isinstance(smooth, Prior), smooth.traits((1, 8, 16, 16)).strong
    (True, False)
    """

    def traits(self, shape: tuple[int, ...]) -> Traits:
        """What the solver must know beforehand.

        Parameters
        ----------
        shape : tuple of int
            (V, B, H, W) of the videos.
        """
        return Traits()

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A new session, for one video.

        Parameters
        ----------
        shape : tuple of int
            (V, B, H, W)
        dtype : dtype
            float32 or float64.
        """
        ...


@runtime_checkable
class DevicePrior(Protocol):
    """What a :class:`Prior` has beside its own methods if it can work on tensors of a device."""

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Session | None:
        """A new session that takes and returns tensors on a torch device, such as "cuda", and never leaves it.

        Parameters
        ----------
        shape : tuple of int
            (V, B, H, W)
        dtype : dtype
            float32 or float64, as numpy names it.
        device : str

        Returns
        -------
        Session or None
            None for videos for which the prior runs on the CPU only.
        """
        ...


@runtime_checkable
class Decoder(Protocol):
    """Reconstructs a video from its measurement alone; also serves as the solver's first estimate.

    Attributes
    ----------
    needs_scene : bool
        Whether it makes use of the scene model; if not, :func:`pnp_sci.decode` does not look for one.

    Examples
    --------
    >>> import pnp_sci
    >>> decoder = pnp_sci.as_decoder(lambda problem, scene: problem.op.adjoint(problem.y) / 10)
    >>> scene = pnp_sci.datasets.embedded_scene(32)
    >>> pnp_sci.decode(scene.y, scene.masks, decoder).x.shape
    (2, 10, 32, 32)
    """

    needs_scene: bool

    def __call__(self, problem: Problem, scene: SceneModel) -> np.ndarray:
        """Decode a measurement.

        Parameters
        ----------
        problem : Problem
            Operator, measurement and noise, in units where the video spans about [0, 1].
        scene : SceneModel
            Which views are dark or still.

        Returns
        -------
        ndarray, (V, B, H, W)
            The video, in the problem's units: it spans about [0, 1]. It need not be clipped.

        Raises
        ------
        InputError
            If no weights serve so many views and frames, masks are negative by more than noise, or the device cannot be
            used.
        """
        ...
