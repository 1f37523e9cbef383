"""Large pictures: tiles that overlap, solved one after the other, so that memory is bounded."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np

from pnp_sci.pipeline.measurement import Outcome, entries, judged_until, one_or_auto, reconstruct, untouched
from pnp_sci.pipeline.noise_of_still import noise_of_still
from pnp_sci.pipeline.progress import Watch
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import Request
from pnp_sci.pipeline.sequence import MOST, Window
from pnp_sci.results.history import Record, Status
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.solvers.state import length

MARGIN = 64  # pixels that a tile sees beyond its own on every side
GRID = 8  # pixels: tiles begin at multiples, as blocks of the priors do


Part = tuple[Any, Any]  # rows and columns: slices, or index arrays that go with each other


@dataclass(frozen=True)
class Tile:
    """A part of the picture.

    Attributes
    ----------
    seen : tuple of slice or of index arrays
        Rows and columns that are solved.
    kept : tuple
        Those whose result is used: every pixel is in one tile.
    inner : tuple
        Where the kept pixels are among those seen.
    """

    seen: Part
    kept: Part
    inner: Part


def tiles(shape: Sequence[int], most: int) -> list[Tile]:
    """Tiles of a video (V, B, H, W), each of about `most` values at most.

    >>> [tile.kept[0] for tile in tiles((8, 800, 200), 8 * 340 * 340)]
    [slice(0, 200, None), slice(200, 400, None), slice(400, 600, None), slice(600, 800, None)]
    """
    frames = int(np.prod(shape[:-2]))
    if int(np.prod(shape)) <= most:
        side = max(shape[-2:])
    else:
        side = max(int((most / frames) ** 0.5) - 2 * MARGIN, 2 * MARGIN)
    rows, columns = (list(_spans(length, side)) for length in shape[-2:])
    return [Tile(*zip(row, column)) for row, column in product(rows, columns)]


def tiles_of_planes(shape: Sequence[int], most: int) -> list[Tile]:
    """Tiles of a mosaic (N, V, B, H, W) in planes: the same part of each plane."""
    height, width = (n // 2 for n in shape[-2:])

    def both(part: Part, rows: int, columns: int) -> Part:
        down, right = (np.arange(n)[own] for own, n in zip(part, (rows, columns)))
        return np.concatenate([down, down + rows])[:, None], np.concatenate([right, right + columns])

    found = []
    for tile in tiles((*shape[:-2], height, width), most // 4):
        rows, columns = (own.stop - own.start for own in tile.seen)
        whole = both(tile.seen, height, width), both(tile.kept, height, width)
        found.append(Tile(*whole, both(tile.inner, rows, columns)))
    return found


def _spans(length: int, side: int) -> Iterator[tuple[slice, slice, slice]]:
    """Rows or columns that a tile sees, those that it keeps, about `side`, and where these are among the seen ones."""
    count = -(-length // side)
    ends = [round(length * n / count / GRID) * GRID for n in range(count)] + [length]
    for begin, end in pairwise(ends):
        first = max(begin - MARGIN, 0)
        yield slice(first, min(end + MARGIN, length)), slice(begin, end), slice(begin - first, end - first)


def reconstruct_in_tiles(
    problems: Sequence[Problem],
    request: Request,
    scene: SceneModel,
    out: np.ndarray,
    *,
    window: Window,
    deadline: float | None = None,
    watch: Watch,
    truth: Reference | None = None,
) -> Outcome:
    """Solve the measurements that a window sees, as one video; large pictures tile by tile.

    The videos of those that are kept go to `out` (N, V, B, H, W), in the user's units.
    """
    shape = problems[0].op.shape
    whole = (len(problems), *shape)
    parts = tiles(whole, MOST) if request.mosaic is None else tiles_of_planes(whole, MOST)
    if len(parts) == 1:
        return reconstruct(problems, request, scene, out, window=window, deadline=deadline, watch=watch, truth=truth)
    if request.mosaic is None:
        problems = noise_of_still(problems, scene, request, judged_until(deadline))
    moves = scene.reduce(problems[0].op).shape[1] > 1  # else all tiles have the same noise
    outcomes = []
    for left, tile in zip(range(len(parts), 0, -1), parts):
        own = request.cropped(tile.seen)
        cropped = [replace(problem.crop(tile.seen), estimated=problem.estimated and moves) for problem in problems]
        video = np.empty((*out.shape[:3], *cropped[0].op.shape[2:]), out.dtype)
        now = time.perf_counter()
        end = None if deadline is None else now + (deadline - now) / left
        if watch.stopped:
            outcomes.append(untouched(window.of_kept(cropped), video, window.kept))
        else:
            outcomes.append(reconstruct(cropped, own, scene, video, window=window, deadline=end, watch=watch))
        out[(..., *tile.kept)] = video[(..., *tile.inner)]
    sizes = [out[(0, 0, 0, *tile.kept)].size for tile in parts]
    return _of_tiles(outcomes, sizes, window.of_kept(problems), out, window, truth)


def _of_tiles(
    outcomes: Sequence[Outcome],
    sizes: Sequence[int],
    problems: Sequence[Problem],
    out: np.ndarray,
    window: Window,
    truth: Reference | None,
) -> Outcome:
    """What has become of measurements whose tiles have these outcomes and `sizes`; PSNR is of the last iteration only.

    Parts that stand still, shares and estimated noise are means over all pixels, the plan is that of the first tile.
    """
    first, solved = outcomes[0], [outcome for outcome in outcomes if outcome.plan]
    norms = [float(np.linalg.norm([length(problem.y) for problem in outcome.problems])) for outcome in outcomes]
    records = merged([outcome.records for outcome in outcomes], norms)
    scenes = [_scene(each, sizes, problem) for each, problem in zip(zip(*(o.scenes for o in outcomes)), problems)]
    start = one_or_auto(outcome.start for outcome in solved)
    shares = np.average([o.shares for o in solved], axis=0, weights=sizes[: len(solved)]).tolist() if solved else []
    if truth:
        scores = [(truth.psnr(video, n), truth.ssim(video, n)) for n, video in zip(window.kept, out)]
        psnr, ssim = np.mean(scores, axis=0).tolist()
        records[-1] = replace(records[-1], psnr=psnr, ssim=ssim)
    status = Status.worst([outcome.status for outcome in outcomes])
    own = [_problem(problem, [o.problems[n] for o in outcomes], sizes) for n, problem in enumerate(problems)]
    return replace(first, problems=own, status=status, records=records, scenes=scenes, start=start, shares=shares)


def _problem(problem: Problem, tiles: Sequence[Problem], sizes: Sequence[int]) -> Problem:
    """The problem of a measurement, with the mean of the noise that its tiles were told if that was estimated."""
    if not problem.estimated:
        return problem
    return replace(problem, noise=float(np.average([float(tile.noise) for tile in tiles], weights=sizes)))


def _scene(tiles: Sequence[dict[str, Any]], sizes: Sequence[int], problem: Problem) -> dict[str, Any]:
    """What was found of a scene in all tiles."""
    rests = list(zip(*(scene["at_rest"] for scene in tiles)))  # of each view
    at_rest = [None if None in rest else round(float(np.average(rest, weights=sizes)), 3) for rest in rests]
    remarks = list(dict.fromkeys(remark for scene in tiles for remark in scene["remarks"]))
    return {**tiles[0], **entries(problem), "at_rest": at_rest, "remarks": remarks}


def merged(courses: Sequence[Sequence[Record]], norms: Sequence[float]) -> list[Record]:
    """One course of the tiles' records: their seconds together, and the residual of all; `norms` are their ``||y||``.

    A tile that has stopped counts with its last record.
    """
    weights = np.square(norms) / max(float(np.sum(np.square(norms))), np.finfo(float).tiny)
    records = []
    for k in range(max(map(len, courses))):
        now = [course[min(k, len(course) - 1)] for course in courses]
        residual = float(np.sqrt(np.dot(weights, [record.residual**2 for record in now])))
        latest = max(now, key=lambda record: record.iteration)
        records.append(replace(latest, seconds=sum(record.seconds for record in now), residual=residual))
    return records
