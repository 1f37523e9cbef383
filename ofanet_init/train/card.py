"""The model card (Markdown) beside the weights."""

from __future__ import annotations

from typing import Any

import torch

from pnp_sci.training.task import Place, Progress

CARD = """# {title} for {views} view(s) of {frames} frames

`{config}`, {parameters:.2f} million parameters. Inputs: a measurement in units where the video spans about [0, 1], and
masks in [0, 1]. Weights in half precision; SHA-256 of their values: `{digest}`.

## Training

The table describes the last stage. A command with `--start` started from the weights of earlier ones.

| | |
|---|---|
| command | `{command}` |
| data | {data} |
| samples | {batch} per step, of {crop} x {crop} pixels; new random masks for each |
| steps | {steps} in {minutes:.1f} minutes |
| hardware | {hardware} |
| software | torch {torch} |

Curves of this stage: the averaged weights on {count} clips whose scenes are not in the training set ({held_out}):

| minutes | loss | {scores} |
|---|---|{rules}
{rows}
"""


def write_card(stage: Any, progress: Progress, place: Place, digest: str) -> None:
    """Write the card for the current weights of `stage`."""
    config = stage.model.config
    moving = [len(clip.frames) for clip in stage.training if len(clip.frames) > 1]
    shown = progress.rows[::-4][::-1] if len(progress.rows) > 10 else progress.rows
    text = CARD.format(
        title=stage.model.title,
        views=config.views,
        frames=config.frames,
        config=config,
        parameters=sum(p.numel() for p in stage.model.parameters()) / 1e6,
        digest=digest,
        command=stage.command,
        data=f"{len(moving)} clips ({sum(moving)} frames) and {len(stage.training) - len(moving)} photographs",
        batch=stage.sample.batch * place.world,
        crop=stage.sample.crop,
        steps=progress.step,
        minutes=progress.seconds / 60,
        hardware=place.hardware(),
        torch=torch.__version__,
        count=len(stage.validation),
        held_out=", ".join(clip.name for clip in stage.validation) or "none",
        scores=" | ".join(stage.scores),
        rules="---|" * len(stage.scores),
        rows="\n".join("| " + " | ".join(f"{value:.4g}" for value in row[1:]) + " |" for row in shown),
    )
    stage.weights.with_suffix(".md").write_text(text)
