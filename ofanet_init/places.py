"""Where the frames of a measurement stand in a network for more frames than that, or for more views."""

from __future__ import annotations

import numpy as np


def places(given: tuple[int, int], views: int, frames: int) -> list[int] | None:
    """The places of `given` views x frames in a network for `views` x `frames`, in order; None if it has too few.

    Each view fills the first places of as many of the network's views as there are for each, frame after frame and
    equally many in each of these.

    >>> places((2, 2), 2, 3), places((1, 5), 2, 3), places((2, 4), 2, 3)
    ([0, 1, 3, 4], [0, 1, 2, 3, 4], None)
    """
    each = views // given[0]  # of the network's views, for each view
    if each == 0 or given[1] > each * frames:
        return None
    run = -(-given[1] // each)
    return [(v * each + b // run) * frames + b % run for v in range(given[0]) for b in range(given[1])]


def placed(planes: np.ndarray, views: int, frames: int) -> np.ndarray:
    """Masks (V, B, H, W) at their places among `views` x `frames`, with zeros at the others."""
    whole = np.zeros((views * frames, *planes.shape[2:]), planes.dtype)
    whole[places((planes.shape[0], planes.shape[1]), views, frames)] = planes.reshape(-1, *planes.shape[2:])
    return whole.reshape(views, frames, *planes.shape[2:])


def taken(video: np.ndarray, given: tuple[int, int]) -> np.ndarray:
    """Of a network's video (views, frames, H, W) the frames of `given` views x frames; the inverse of `placed`."""
    views, frames, *picture = video.shape
    return video.reshape(-1, *picture)[places(given, views, frames)].reshape(*given, *picture)
