"""A comparison as one self-contained HTML file, with pictures, plot, styles and script."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pnp_sci._optional import needed_for
from pnp_sci.bench.pareto import Point, chart
from pnp_sci.formats.plain import finite
from pnp_sci.formats.replacing import replacing

with needed_for("the report", "report"):
    from jinja2 import Environment, PackageLoader, StrictUndefined

BUDGET = 10 * 2**20  # bytes of pictures; base64 adds a third, so the file is below 15 MB
ENCODINGS = ((1, None), (1, 90), (1, 70), (2, 70), (4, 70), (8, 70))  # divisor of the size, WebP quality (None: PNG)
CLOSE = 1.0  # dB below the best method, within which the summary names the fastest one


def write(path: str | Path, comparison: Any, title: str) -> None:
    """Write the report of a :class:`~pnp_sci.bench.Comparison` atomically."""
    with replacing(Path(path)) as temporary:
        temporary.write_text(render(comparison, title), "utf-8", "backslashreplace")


def render(comparison: Any, title: str) -> str:
    """The HTML text of the report. Texts from outside, such as file names, are escaped.

    Examples
    --------
    >>> import pnp_sci
    >>> from pnp_sci.bench import compare, grid
    >>> scene = pnp_sci.datasets.embedded_scene(32)
    >>> page = render(compare(scene.y, scene.masks, grid(["none"], iterations=1)), "<b>")
    >>> "<b>" in page, "://" in page
    (False, False)
    """
    solved = [(trial, trial.result) for trial in comparison.trials if trial.result is not None]
    shown = [(trial.method.name, trial.psnr, result.x / comparison.white) for trial, result in solved]
    if comparison.truth is not None:
        shown = [("Truth", (), comparison.truth), *shown]
    pictures, encoding = _encode([video for *_, video in shown])
    panels = [{"name": name, "psnr": psnr, "frames": f} for (name, psnr, _), f in zip(shown, pictures)]
    points = [
        Point(trial.method.name, result.settings["seconds"], trial.quality)
        for trial, result in solved
        if trial.quality is not None and np.isfinite(trial.quality)
    ]
    quality = "PSNR" if comparison.truth is not None else "Score"
    environment = Environment(
        loader=PackageLoader("pnp_sci.bench"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html").render(
        title=title,
        made=datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        comparison=comparison,
        rows=[trial.row() for trial in comparison.trials],
        summary=_summary(points, quality),
        quality=quality,
        has_truth=comparison.truth is not None,
        measurement=_picture(_stretched(comparison.y), 1, None),
        panels=finite(panels),
        shape=shown[0][2].shape if shown else (0, 0, 0, 0),
        encoding=encoding,
        chart=chart(points) if points else None,
        sizes=lambda values, digits: " / ".join(f"{value:.{digits}f}" for value in values),
        mean=lambda values: float(np.mean(values)),
    )


def _summary(points: list[Point], quality: str) -> str:
    """A sentence on the best method, and one on the fastest method of similar quality."""
    if not points:
        return "No method could be scored."
    best = max(points, key=lambda point: point.quality)
    quick = min((p for p in points if p.quality >= best.quality - CLOSE), key=lambda point: point.seconds)
    text = f"Best by {quality}: {best.name}, {best.quality:.2f} dB in {best.seconds:.3g} s."
    if quick is best:
        return text
    return (
        f"{text} Within {CLOSE:g} dB of it in less time: {quick.name}, {quick.quality:.2f} dB in {quick.seconds:.3g} s."
    )


def _encode(videos: list[np.ndarray]) -> tuple[list[list[list[str]]], str]:
    """Data URIs of all frames, [video][view][frame], in the best encoding within BUDGET, and the name of it."""
    for shrink, quality in ENCODINGS:
        kind = "without loss, in 8 bits" if quality is None else f"compressed with loss (WebP, quality {quality})"
        name = kind if shrink == 1 else f"{kind}, shrunk by {shrink}"
        if _estimate(videos, shrink, quality) <= BUDGET:
            break
    return [[[_picture(f, shrink, quality) for f in view] for view in video] for video in videos], name


def _estimate(videos: list[np.ndarray], shrink: int, quality: int | None) -> float:
    """Estimated bytes of all frames, from one frame of each view."""
    samples = ((len(view), view[len(view) // 2]) for view in _views(videos))
    return sum(count * len(_compress(frame, shrink, quality)) for count, frame in samples)


def _views(videos: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    for video in videos:
        yield from video


def _picture(frame: np.ndarray, shrink: int, quality: int | None) -> str:
    kind = "png" if quality is None else "webp"
    return f"data:image/{kind};base64,{base64.b64encode(_compress(frame, shrink, quality)).decode()}"


def _compress(frame: np.ndarray, shrink: int, quality: int | None) -> bytes:
    """A frame (H, W), clipped to [0, 1], as the content of an image file."""
    grey = np.nan_to_num(np.clip(frame, 0, 1) * 255).round().astype(np.uint8)
    file, image = BytesIO(), Image.fromarray(grey).reduce(shrink)
    if quality is None:
        image.save(file, "PNG")
    else:
        image.save(file, "WEBP", quality=quality, method=2)
    return file.getvalue()


def _stretched(y: np.ndarray) -> np.ndarray:
    """Map the range of y to [0, 1]."""
    low, high = float(y.min()), float(y.max())
    return (y - low) / ((high - low) or 1.0)
