"""The model card (Markdown) beside the weights."""

from __future__ import annotations

from typing import Any

import torch

from pnp_sci.training.task import Place, Progress
from priors.networks import LIMIT
from priors.train.data import CLIP, FRAME
from priors.train.solves import ITERATIONS, LONG
from priors.train.validation import FRAMES, LEVELS, SIZE
from priors.train.windows import CALLS

CARD = """# {name}: denoiser of grey {kind}

A U-net of {parameters:.2f} million parameters, `{architecture}`.
Inputs: frames in [0, 1] and the standard deviation of the noise of each pixel. The network is scale-equivariant and
changes no pixel by more than {limit:g} standard deviations. Weights in half precision; SHA-256 of their values:
`{digest}`.

## Training

| | |
|---|---|
| command | `{command}` |
| data | {data} |
| samples | {batch} per step, each {frames} frame(s) of {crop} x {crop} pixels |
| steps | {steps} in {minutes:.1f} minutes |
| hardware | {hardware} |
| software | torch {torch} |

Loss: logarithm of the squared error of a frame; cosine schedule, exponential moving average of the weights.
Noise: standard deviation log-uniform in 5-50 of 255 for 80 % of the samples, else uniform in 0-75. It is white. For
{share:.0%} of the samples, part of it is a noise common to all frames times binary masks, as in snapshot residuals.
{seen} Training began with {origin}.
{solves}
## Validation

Mean PSNR in dB over the first {shown} frames, central {size} x {size} pixels, of {count} clips whose scenes are not in
the training set ({held_out}); white Gaussian noise of seed 0:

| sigma (of 255) | {levels} |
|---|{rules}
| PSNR (dB) | {psnr} |

These figures do not measure the prior inside a solver, whose estimates have other errors than white noise.
"""

SOLVES = """Half of the loss is that of estimates after one to {calls} calls in a row within the solver; call n has
weight n. The gradient passes through these calls. Solves of measurements of training clips gave {windows} windows of
{calls} calls in each process, of which a step takes one. Of the solves, {long:.0%} had {iterations} iterations at one
sigma, from `adjoint`, on crops of half the size. The others had the defaults, or the best effort, and `ofanet-fast`
where that has weights.
"""


def write_card(task: Any, progress: Progress, place: Place, digest: str) -> None:
    """Write the card for the current weights of `task`; folders appear by their last name only."""
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
        solves=_of_solves(sum(task.windows.values())) if task.watch else "",
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


def _of_solves(windows: int) -> str:
    return SOLVES.format(calls=CALLS, windows=windows, long=LONG, iterations=ITERATIONS)
