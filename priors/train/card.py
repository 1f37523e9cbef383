"""The model card, written beside the weights."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch

from .._network import LIMIT
from .data import Clip
from .validation import FRAMES, LEVELS, SIZE

if TYPE_CHECKING:
    from .loop import Trainer

CARD = """# {name}: denoiser of grey {kind}

A U-net of {parameters:.2f} million parameters, `{architecture}`.
It takes frames in [0, 1] and the standard deviation of their noise, is scale-equivariant, and never moves a pixel by
more than {limit:g} standard deviations. Weights in half precision; SHA-256 of their values: `{digest}`.

## Training

| | |
|---|---|
| command | `{command}` |
| data | {data} |
| samples | {batch} a step, each {frames} frame(s) of {crop} x {crop} pixels |
| steps | {steps} in {minutes:.1f} minutes |
| hardware | {hardware} |
| software | torch {torch} |

Loss: absolute error over the square root of sigma. AdamW, cosine schedule, exponential moving average of the weights.
Noise: standard deviation mostly log-uniform in 5-50 of 255, else uniform in 0-75; white, and for one sample in five
partly masked and shared by the frames, as the residual of a snapshot is.

## Validation

Mean PSNR in dB over the first {shown} frames, central {size} x {size} pixels, of {count} clips whose scenes were not
trained on ({held_out}); white Gaussian noise of seed 0:

| sigma (of 255) | {levels} |
|---|{rules}
| PSNR (dB) | {psnr} |

These figures do not say how well the prior serves inside a solver, whose estimates hold other errors than white noise.
"""


def hardware(device: torch.device, processes: int) -> str:
    """Describe the machine in kind, not by name."""
    if device.type == "cuda":
        return f"{processes} x {torch.cuda.get_device_name(device)}"
    capability = torch.backends.cpu.get_cpu_capability()
    return (
        f"CPU with {capability}, {os.cpu_count()} cores, {processes} process(es) of {torch.get_num_threads()} thread(s)"
    )


def write_card(trainer: Trainer, training: Sequence[Clip], validation: Sequence[Clip], digest: str) -> None:
    """Write the card of `trainer`'s weights as they stand; folders appear by their last name only."""
    settings, progress = trainer.settings, trainer.progress
    budget = f"--minutes {settings.minutes:g}" if settings.steps is None else f"--steps {settings.steps}"
    folders = " ".join(f"--data {folder.name}" for folder in settings.data)
    moving = [len(clip.frames) for clip in training if len(clip.frames) > 1]
    text = CARD.format(
        name=settings.name,
        kind="images" if settings.frames == 1 else "video",
        parameters=sum(p.numel() for p in trainer.network.parameters()) / 1e6,
        architecture=trainer.network.architecture,
        limit=LIMIT,
        digest=digest,
        command=f"python -m priors.train {settings.name} {folders} {budget} --seed {settings.seed}",
        data=f"{len(moving)} clips ({sum(moving)} frames) and {len(training) - len(moving)} photographs",
        batch=settings.batch * trainer.world,
        frames=settings.frames,
        crop=settings.crop,
        steps=progress.step,
        minutes=progress.seconds / 60,
        hardware=hardware(trainer.device, trainer.world),
        torch=torch.__version__,
        shown=FRAMES,
        size=SIZE,
        count=len(validation),
        held_out=", ".join(clip.name for clip in validation) or "none",
        levels=" | ".join(map(str, LEVELS)),
        rules="---|" * len(LEVELS),
        psnr=" | ".join(f"{value:.2f}" for value in progress.rows[-1][3:]),
    )
    settings.weights.with_suffix(".md").write_text(text)
