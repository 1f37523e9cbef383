"""Benchmark cases: known scenes by name and files of measurements, optionally with other noise or fewer frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci import datasets
from pnp_sci._validate import white
from pnp_sci.errors import InputError
from pnp_sci.pipeline.provenance import digest
from pnp_sci.sensing.simulate import simulate

_SCENES: dict[str, Callable[[], datasets.Scene]] = {
    "embedded": datasets.embedded_scene,
    **{pair: partial(datasets.dualview, pair) for pair in datasets.DUAL_VIEW_PAIRS},
    **{name: partial(datasets.singleview, name) for name in (*datasets.SINGLE_VIEW, "kobe")},
    **{name: partial(datasets.real, name) for name in datasets.REAL},
    "wheel+hand": datasets.real_dual,
}
GROUPS: dict[str, tuple[str, ...]] = {
    "dualview": datasets.DUAL_VIEW_PAIRS,
    "singleview": (*datasets.SINGLE_VIEW, "kobe"),
    "real": (*datasets.REAL, "wheel+hand"),
}


@dataclass(frozen=True)
class Case:
    """A scene, and how it is measured.

    Attributes
    ----------
    scene : str
        A known scene, or a file with ``y``, ``masks`` and optionally the truth ``x``, as ``pnp-sci simulate`` writes.
    noise : float, optional
        Simulate the measurement from the truth, with this standard deviation relative to the largest value of y.
    frames : int, optional
        Simulate the measurement from this number of frames of each view, from the first on.
    masks, views, key, masks_key, reference_key : optional
        Of a file, as for ``pnp-sci solve``: another file with the masks, and names of arrays.
    """

    scene: str
    noise: float | None = None
    frames: int | None = None
    masks: str | None = None
    views: int | None = None
    key: str | None = None
    masks_key: str | None = None
    reference_key: str | None = None

    @property
    def name(self) -> str:
        """
        The scene, and the settings that are not the default.

        >>> Case("kobe").name, Case("kobe", noise=0.1, frames=6).name
        ('kobe', 'kobe, noise 0.1, 6 frames')
        """
        words = [self.scene]
        words += [f"noise {self.noise:g}"] if self.noise is not None else []
        words += [f"{self.frames} frames"] if self.frames is not None else []
        return ", ".join(words)

    def has(self, settings: Mapping[str, Any]) -> bool:
        """Whether a result with these settings is of this case as its file is now; known scenes do not change."""
        if self.scene in _SCENES or not Path(self.scene).exists():
            return True
        scene = self.load()
        return (digest(scene.y), digest(scene.masks)) == (settings.get("y"), settings.get("masks"))

    def load(self) -> datasets.Scene:
        """Load the scene, and simulate its measurement if noise or frames are given.

        Raises
        ------
        InputError
            If the scene is unknown, has fewer frames, or has no truth to simulate from.
        FormatError, DataUnavailableError
            As for :func:`pnp_sci.datasets.fetch`.
        """
        scene = _SCENES[self.scene]() if self.scene in _SCENES else self._from_file()
        if self.noise is None and self.frames is None:
            return scene
        if scene.truth is None:
            raise InputError(f"case is {self.name!r}: a scene whose truth is known was expected")
        if self.frames is not None and not 1 <= self.frames <= scene.masks.shape[-3]:
            most = scene.masks.shape[-3]
            raise InputError(f"frames is {self.frames}: a whole number from 1 to {most} was expected for {self.scene}")
        masks, truth = (a[..., : self.frames, :, :] for a in (scene.masks, scene.truth))
        films = truth.reshape(-1, *masks.shape[-4:])
        each = np.broadcast_to(masks, films.shape)  # of all, or of each of several measurements
        y = np.stack([simulate(*pair, self.noise or 0.0, seed) for seed, pair in enumerate(zip(films, each))])
        return replace(scene, y=y.reshape(scene.y.shape), masks=masks, truth=truth)

    def _from_file(self) -> datasets.Scene:
        from pnp_sci import io

        file = self.scene
        if not Path(file).exists():
            raise InputError(f"case is {file!r}: a file, or one of these was expected: {', '.join(_SCENES)}")
        y, masks = io.read_measurement(file, self.key), io.read_masks(self.masks or file, self.views, self.masks_key)
        key = self.reference_key or "x"
        if self.reference_key is None and key not in {entry.key for entry in io.describe(file)}:
            return datasets.Scene(file, y, masks, None, None)
        truth = io.read_video(file, masks.shape[-4], key)
        largest = white("x", truth.dtype, float(truth.max()))
        if largest != 1:
            y, truth = (a / np.float32(largest) for a in (y, truth))
        return datasets.Scene(file, y, masks, truth, None)


def expand(
    names: Iterable[str],
    noises: Iterable[float | None] = (None,),
    frames: Iterable[int | None] = (None,),
    **of_files: Any,
) -> list[Case]:
    """All distinct combinations of scenes, noise and frames; groups are replaced by their members.

    `of_files` are other fields of :class:`Case`, for scenes that are files.

    Raises
    ------
    InputError
        If a name is not a scene, a group (``dualview``, ``singleview``, ``real``) or a file.

    Examples
    --------
    >>> [case.name for case in expand(["embedded", "real"])]
    ['embedded', 'wheel', 'hand', 'wheel+hand']
    """
    scenes: list[str] = []
    for name in names:
        if name not in _SCENES and name not in GROUPS and not Path(name).exists():
            known = ", ".join((*_SCENES, *GROUPS))
            raise InputError(f"case is {name!r}: a file, or one of these was expected: {known}")
        scenes += GROUPS.get(name, (name,))
    return [Case(*one, **of_files) for one in dict.fromkeys(product(scenes, noises, frames))]
