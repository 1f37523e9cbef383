"""Benchmark measurements and real captures by name, and a scene that needs no download."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci._validate import one_of, whole
from pnp_sci.errors import DataUnavailableError, FormatError, InputError
from pnp_sci.io import read, read_masks, read_measurement, read_video
from pnp_sci.masks import moving_masks
from pnp_sci.sensing.simulate import simulate

DUAL_VIEW_PAIRS = ("bear_blackswan", "bike_bus", "boy_girl", "car-b_car-w", "cow_dog", "hike_hockey")
SINGLE_VIEW = {"runner": "runner40", "traffic": "traffic48", "drop": "drop40"}
REAL = {"wheel": "6fan14", "hand": "4hand14"}
_REAL_SHIFT = 16  # pixels, in rows and columns: offset of the second view's masks, 8 mask elements


@dataclass(frozen=True, eq=False)
class Scene:
    """A measurement, its masks, and the true video if it is known.

    Attributes
    ----------
    name : str
    y : ndarray of float32, (H, W) or (N, H, W)
        One measurement, or N successive ones.
    masks : ndarray, (V, B, H, W)
    truth : ndarray of float32, (V, B, H, W) or (N, V, B, H, W), or None
        The true video in [0, 1]; None if it is unknown.
    peak : float or None
        Value of white in the video, in the units of `y`; None if it is unknown.
    """

    name: str
    y: np.ndarray
    masks: np.ndarray
    truth: np.ndarray | None
    peak: float | None

    def __repr__(self) -> str:
        views, frames, rows, columns = self.masks.shape
        count = f"{len(self.y)} measurements of " if self.y.ndim == 3 else ""
        known = "with" if self.truth is not None else "without"
        return f"Scene({self.name}: {count}{views} views x {frames} frames of {rows} x {columns}, {known} truth)"


def fetch(name: str) -> Path:
    """Local path of a data file: in the folder ``PNP_SCI_DATA``, else in the cache, else downloaded to the cache.

    Parameters
    ----------
    name : str
        One of :func:`available`, such as ``"real/6fan14_cacti.mat"``.

    Raises
    ------
    InputError
        If the name is unknown.
    FormatError
        If the SHA-256 of the file is wrong.
    DataUnavailableError
        If the file is not on this machine and cannot be downloaded; the message has its URL.
    """
    files = _registry()
    one_of("name", name, files)
    digest, url = files[name]
    if (local := _local(name)) is not None:
        found = hashlib.sha256(local.read_bytes()).hexdigest()
        if found != digest:
            raise FormatError(f"{local} has SHA-256 {found}, but {digest} was expected: replace or remove the file")
        return local
    with needed_for("downloading data", "data"):
        import pooch
    cache_folder = Path(pooch.os_cache("pnp-sci"))
    store = pooch.create(cache_folder, base_url="", registry={name: digest}, urls={name: url})
    try:
        return Path(store.fetch(name))
    except ValueError as error:
        raise FormatError(f"{url} has not the SHA-256 {digest} that was expected: {error}") from error
    except OSError as error:
        raise DataUnavailableError(
            f"{name} is not on this machine and cannot be downloaded ({type(error).__name__}): download {url} to "
            f"{cache_folder / name}, or set the environment variable PNP_SCI_DATA to a folder that has {name}"
        ) from error


def available() -> dict[str, bool]:
    """Names of all known data files, and whether each is on this machine."""
    with needed_for("the folder of downloaded data", "data"):
        import pooch
    cache_folder = Path(pooch.os_cache("pnp-sci"))
    return {name: _local(name) is not None or (cache_folder / name).is_file() for name in _registry()}


def dualview(pair: str, frames: int | None = None) -> Scene:
    """A pair of the dual-view benchmark (Lu et al., OFaNet): B = 10, 256 x 256, binary masks, no noise.

    Parameters
    ----------
    pair : str
        ``bear_blackswan``, ``bike_bus``, ``boy_girl``, ``car-b_car-w``, ``cow_dog`` or ``hike_hockey``.
    frames : int, optional
        Number of frames of each view, 1 to 10, from the first on; the measurement is then simulated.

    Raises
    ------
    InputError
        If the pair or the number of frames is unknown.
    FormatError, DataUnavailableError
        As for :func:`fetch`.
    """
    one_of("pair", pair, DUAL_VIEW_PAIRS)
    masks = read_masks(fetch("dualview/256_simu_mask10.mat"))
    truth = read_video(fetch(f"dualview/gt/{pair}.mat"))
    if frames is None:
        counts = read_measurement(fetch(f"dualview/meas/{pair}.mat"))
    else:
        if frames not in range(1, truth.shape[1] + 1):
            raise InputError(f"frames is {frames}: a whole number from 1 to {truth.shape[1]} was expected")
        masks, truth = masks[:, :frames].copy(), truth[:, :frames]
        counts = simulate(truth, masks)
    return Scene(pair, _unit(counts), masks, _unit(truth), 1.0)


def singleview(name: str) -> Scene:
    """A single-view benchmark: B = 8, 256 x 256, binary masks, no noise, one measurement or several successive ones.

    Parameters
    ----------
    name : str
        ``runner`` (5 measurements), ``traffic`` (6), ``drop`` (5), or ``kobe`` (its first; only from ``PNP_SCI_DATA``).

    Raises
    ------
    InputError
        If the name is unknown.
    FormatError, DataUnavailableError
        As for :func:`fetch`.
    """
    one_of("name", name, (*SINGLE_VIEW, "kobe"))
    if name == "kobe":
        return _kobe()
    path = fetch(f"singleview/{SINGLE_VIEW[name]}_cacti.mat")
    y, masks, truth = read_measurement(path), read_masks(path), read_video(path)
    return Scene(name, _unit(y), masks, _unit(truth).reshape(len(y), *masks.shape), 1.0)


def real(name: str) -> Scene:
    """A capture of a real camera (CACTI): B = 14, 256 x 256, calibrated grey masks, no truth.

    The masks are divided by their largest value. y has the stored values, 8-bit counts times 1000 / 255.

    Parameters
    ----------
    name : str
        ``wheel`` (a rotating chopper wheel) or ``hand``.

    Raises
    ------
    InputError
        If the name is unknown.
    FormatError, DataUnavailableError
        As for :func:`fetch`.
    """
    one_of("name", name, tuple(REAL))
    path = fetch(f"real/{REAL[name]}_cacti.mat")
    masks = read_masks(path).astype(np.float32)
    return Scene(name, read_measurement(path).astype(np.float32), masks / masks.max(), None, None)


def real_dual() -> Scene:
    """A dual-view measurement from two real captures, view 1 the wheel and view 2 the hand: B = 14, 240 x 240.

    As light is additive, the sum of two captures is a dual-view capture with noise. The hand and its masks are cropped
    16 pixels further down and right, so that the views have different masks. Raises as :func:`fetch`.
    """
    s = _REAL_SHIFT
    wheel, hand = real("wheel"), real("hand")
    masks = np.concatenate((wheel.masks[..., :-s, :-s], hand.masks[..., s:, s:]))
    return Scene("wheel+hand", wheel.y[:-s, :-s] + hand.y[s:, s:], masks, None, None)


def embedded_scene(size: int = 256) -> Scene:
    """A dual-view scene that needs no download, made from pictures of scikit-image: B = 10, no noise.

    In each view the camera pans by 0.5 to 2 pixels per frame. An object with another texture moves in another direction
    and occludes the background. The masks are :func:`~pnp_sci.masks.moving_masks`.

    Parameters
    ----------
    size : int
        Rows and columns, at least 16.

    Raises
    ------
    InputError
        If `size` is no whole number, or smaller.

    Examples
    --------
    >>> embedded_scene(32)
    Scene(embedded: 2 views x 10 frames of 32 x 32, with truth)
    """
    from skimage import data

    size = whole("size", size, 16)
    camera, coins = data.camera(), data.coins()
    astronaut, coffee = data.astronaut()[..., 1], data.coffee()[..., 1]
    truth = np.stack(
        [
            _moving_scene(camera, coins, size, pan=(0.5, 1.25), object_step=(-0.75, -2.0)),
            _moving_scene(astronaut, coffee, size, pan=(-0.75, 1.5), object_step=(1.5, -0.5)),
        ]
    )
    masks = moving_masks(truth.shape)
    return Scene("embedded", simulate(truth, masks), masks, truth, 1.0)


def _moving_scene(
    background: np.ndarray, texture: np.ndarray, size: int, pan: tuple[float, float], object_step: tuple[float, float]
) -> np.ndarray:
    """A disc of `texture` moves over `background`: (10, size, size), float32 in [0, 1]; steps in pixels per frame."""
    from scipy.ndimage import shift
    from skimage.transform import resize

    frames, margin = 10, 12  # the margin is at least half of the longest pan
    canvas = size + 2 * margin
    scene = _square(background, canvas, resize)
    disc_texture = _square(texture, canvas, resize)
    rows, columns = np.mgrid[:canvas, :canvas]
    distance = np.hypot(rows - canvas / 2, columns - canvas / 2)
    disc = np.clip(size / 6 - distance + 0.5, 0, 1)
    video = np.empty((frames, size, size), np.float32)
    for b in range(frames):
        time = b - (frames - 1) / 2
        seen = shift(scene, np.multiply(pan, time), mode="nearest")
        move = np.multiply(object_step, time)
        cover = shift(disc, move, order=1)
        frame = (1 - cover) * seen + cover * shift(disc_texture, move, mode="nearest")
        video[b] = np.clip(frame[margin:-margin, margin:-margin], 0, 1)
    return video


def _square(picture: np.ndarray, size: int, resize) -> np.ndarray:
    """The central square of a uint8 picture, resized to (size, size), in [0, 1]."""
    side = min(picture.shape)
    top, left = (picture.shape[0] - side) // 2, (picture.shape[1] - side) // 2
    return resize(picture[top : top + side, left : left + side] / 255.0, (size, size), anti_aliasing=True)


def _kobe() -> Scene:
    snapshot, ground_truth = (_local(f"singleview/kobe8_{part}.npz") for part in ("snapshot", "ground_truth"))
    if snapshot is None or ground_truth is None:
        raise DataUnavailableError(
            "kobe is not among the files that can be downloaded: set the environment variable PNP_SCI_DATA to a folder "
            "with singleview/kobe8_snapshot.npz (y, masks) and singleview/kobe8_ground_truth.npz (x)"
        )
    masks, truth = read_masks(snapshot), read_video(ground_truth)
    return Scene("kobe", read(snapshot, "y")[None], masks, truth[None], 1.0)


def _unit(counts: np.ndarray) -> np.ndarray:
    """8-bit values, or sums of them, divided by 255, as float32."""
    return (counts / 255).astype(np.float32)


def _local(name: str) -> Path | None:
    """The file in the folder PNP_SCI_DATA; None if it is not there."""
    folder = os.environ.get("PNP_SCI_DATA")
    return path if folder and (path := Path(folder) / name).is_file() else None


@cache
def _registry() -> dict[str, tuple[str, str]]:
    """Name -> (SHA-256, URL)."""
    lines = Path(__file__).with_name("registry.txt").read_text(encoding="utf-8").splitlines()
    return {name: (digest, url) for name, digest, url in map(str.split, filter(None, lines))}
