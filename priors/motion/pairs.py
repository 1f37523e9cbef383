"""Pairs (b, n) of neighbouring frames, an array of int (P, 2), and which of them are related."""

from __future__ import annotations

import numpy as np


def neighbouring(frames: int, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of frames at most `reach` apart, sorted, and where those of each frame begin, (B + 1,).

    >>> pairs, first = neighbouring(3, 1)
    >>> pairs.tolist(), first.tolist()
    ([[0, 1], [1, 0], [1, 2], [2, 1]], [0, 1, 3, 4])
    """
    each = np.arange(frames)
    apart = np.abs(each[:, None] - each)
    pairs = np.stack(np.nonzero((apart > 0) & (apart <= reach)), 1)
    return pairs, np.searchsorted(pairs[:, 0], np.arange(frames + 1))


def reverse(pairs: np.ndarray) -> list[int]:
    """For each pair (b, n) the place of (n, b)."""
    place = _places(pairs)
    return [place[n, b] for b, n in pairs.tolist()]


def adjacent(pairs: np.ndarray) -> list[list[int]]:
    """For each pair (b, n) the places of (b, b - 1) and of (b, b + 1); of the first and last frame the one that exists.

    >>> adjacent(neighbouring(3, 1)[0])
    [[0, 1, 1, 3], [0, 2, 2, 3]]
    """
    place = _places(pairs)
    return [[place.get((b, b + d), place.get((b, b - d), -1)) for b, _ in pairs.tolist()] for d in (-1, 1)]


def steady(pairs: np.ndarray) -> list[tuple[list[int], np.ndarray]]:
    """Where else a steady motion of each pair (b, n) is seen: the places of pairs, and the factors of their flow.

    First those with the opposite frame, (b, 2 b - n), where there is one; then with the farthest one on the same side.

    >>> for places, factors in steady(neighbouring(3, 2)[0]): print(places, factors.tolist())
    [0, 1, 3, 2, 4, 5] [1.0, 1.0, -1.0, -1.0, 1.0, 1.0]
    [1, 1, 2, 3, 4, 4] [0.5, 1.0, 1.0, 1.0, 1.0, 0.5]
    """
    place, steps = _places(pairs), pairs[:, 1] - pairs[:, 0]
    reach, last = int(steps.max()), int(pairs.max())
    opposite = [place.get((b, 2 * b - n), p) for p, (b, n) in enumerate(pairs.tolist())]
    farthest = [place[b, min(b + reach, last) if n > b else max(b - reach, 0)] for b, n in pairs.tolist()]
    return [(source, steps / steps[source]) for source in (opposite, farthest)]


def _places(pairs: np.ndarray) -> dict[tuple[int, int], int]:
    return {(b, n): p for p, (b, n) in enumerate(pairs.tolist())}
