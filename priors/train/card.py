"""The model card, written beside the weights."""

from __future__ import annotations

from typing import Any

import torch

from pnp_sci.training.loop import Place, Progress
from priors.networks import LIMIT
from priors.train.data import CLIP, FRAME
from priors.train.validation import FRAMES, LEVELS, SIZE

CARD = """# {name}: denoiser of grey {kind}

A U-net of {parameters:.2f} million parameters, `{architecture}`.
It takes frames in [0, 1] and the standard deviation of the noise in each pixel, is scale-equivariant, and never moves a
pixel by more than {limit:g} standard deviations. Weights in half precision; SHA-256 of their values: `{digest}`.

## Training

| | |
|---|---|
| command | `{command}` |
| data | {data} |
| samples | {batch} a step, each {frames} frame(s) of {crop} x {crop} pixels |
| steps | {steps} in {minutes:.1f} minutes |
| hardware | {hardware} |
| software | torch {torch} |

Loss: logarithm of the squared error of a frame; cosine schedule, exponential moving average of the weights.
Noise: standard deviation mostly log-uniform in 5-50 of 255, else uniform in 0-75; white, and for {share:.0%} of the
samples partly masked and shared by the frames, as the residual of a snapshot is.
{seen} Training began with {origin}.
{states}
## Validation

Mean PSNR in dB over the first {shown} frames, central {size} x {size} pixels, of {count} clips whose scenes were not
trained on ({held_out}); white Gaussian noise of seed 0:

| sigma (of 255) | {levels} |
|---|{rules}
| PSNR (dB) | {psnr} |

These figures do not say how well the prior serves inside a solver, whose estimates hold other errors than white noise.
"""

STATES = """In each step as many frames again are what the network has seen within the solver meanwhile, from {} such
frames of measurements of training clips; where `ofanet-fast` has weights the solver began with that.
"""


def write_card(task: Any, progress: Progress, place: Place, digest: str) -> None:
    """Write the card of the task's weights as they stand; folders appear by their last name only."""
    sample = task.sample
    moving = [len(clip.frames) for clip in task.training if len(clip.frames) > 1]
    text = CARD.format(
        name=task.name,
        kind="images" if sample.frames == 1 else "video",
        parameters=sum(p.numel() for p in task.network.parameters()) / 1e6,
        architecture=task.network.architecture,
        limit=LIMIT,
        share=FRAME if sample.frames == 1 else CLIP,
        seen=task.prepare.__doc__,
        origin=task.origin,
        states=STATES.format(task.learned * place.world) if task.watch else "",
        digest=digest,
        command=task.command,
        data=f"{len(moving)} clips ({sum(moving)} frames) and {len(task.training) - len(moving)} photographs",
        batch=sample.batch * place.world,
        frames=sample.frames,
        crop=sample.crop,
        steps=progress.step,
        minutes=progress.seconds / 60,
        hardware=place.hardware(),
        torch=torch.__version__,
        shown=FRAMES,
        size=SIZE,
        count=len(task.validation),
        held_out=", ".join(clip.name for clip in task.validation) or "none",
        levels=" | ".join(map(str, LEVELS)),
        rules="---|" * len(LEVELS),
        psnr=" | ".join(f"{value:.2f}" for value in progress.rows[-1][3:]),
    )
    task.weights.with_suffix(".md").write_text(text)
