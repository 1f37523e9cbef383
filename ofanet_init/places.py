"""Where the frames of a measurement stand in a network for more frames than that, or for more views."""

from __future__ import annotations

import torch


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


def placed(planes: torch.Tensor, views: int, frames: int) -> torch.Tensor:
    """Masks or frames (N, V, B, H, W) at their places among `views` x `frames`, with zeros at the others."""
    where = places((planes.shape[1], planes.shape[2]), views, frames)
    assert where is not None
    whole = planes.new_zeros(len(planes), views * frames, *planes.shape[3:])
    whole[:, where] = planes.flatten(1, 2)
    return whole.unflatten(1, (views, frames))


def taken(video: torch.Tensor, given: tuple[int, int]) -> torch.Tensor:
    """Of a network's video (N, views, frames, H, W) the frames of `given` views x frames; the inverse of `placed`."""
    return video.flatten(1, 2)[:, places(given, *video.shape[1:3])].unflatten(1, given)
