"""Command line of the trainer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import numba
import torch

from pnp_sci.errors import InputError
from pnp_sci.training.clips import load_clips, split
from pnp_sci.training.loop import OPTIMIZERS, Budget, launch, train
from pnp_sci.training.task import Place
from priors.motion.measure import SMALLEST
from priors.train.task import Denoising, Sample
from priors.train.windows import Watch

SAMPLES = {"video": Sample(frames=8, batch=1, crop=96), "ffdnet": Sample(frames=1, batch=16, crop=64)}
FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)
PATH = click.Path(path_type=Path)


@click.command(context_settings={"show_default": True})
@click.argument("name", type=click.Choice(sorted(SAMPLES)))
@click.option("--data", type=FOLDER, multiple=True, required=True, help="Folder of videos or photographs; repeatable.")
@click.option("--start", type=PATH, help="Initial weights.  [default: random; for video the image net's]")
@click.option("--solves", type=click.IntRange(min=1), help="Measurements to solve for training samples.")
@click.option("--out", type=PATH, help="Folder for checkpoint and curves.  [default: runs/NAME]")
@click.option("--weights", type=PATH, help="Weights to write, with a model card.  [default: OUT/NAME.safetensors]")
@click.option("--minutes", default=90.0, help="Budget of training time in minutes, without pauses.")
@click.option(
    "--steps", type=click.IntRange(min=1), help="Budget in steps; replaces --minutes. Reproducible on one machine."
)
@click.option("--seed", default=0, help="Random seed of weights, crops and noise.")
@click.option("--rate", default=1e-3, help="Highest learning rate.")
@click.option(
    "--crop",
    type=click.IntRange(min=8),
    help="Height and width of a sample in pixels.  [default: 96 for clips, 64 for images]",
)
@click.option(
    "--batch", type=click.IntRange(min=1), help="Samples per step and process.  [default: 1 clip or 16 images]"
)
@click.option("--optimizer", type=click.Choice(OPTIMIZERS), default="adam", help="Adam, or Muon for kernels.")
@click.option("--validations", default=20, type=click.IntRange(min=1), help="Number of validations and checkpoints.")
@click.option("--resume", is_flag=True, help="Continue from the checkpoint in the output folder.")
def main(
    name, data, start, solves, out, weights, minutes, steps, seed, rate, crop, batch, optimizer, validations, resume
):  # fmt: skip
    """Train the prior NAME on folders of videos; the image net (ffdnet) also on photographs.

    The video net starts from the image net of this package, which also denoises its input frames. To train both, train
    the image net first, with --weights priors/weights/ffdnet.safetensors. --start takes other weights of NAME.

    With --solves, each process solves that many measurements of the training clips before the first step and after each
    validation but the last. Half of the loss is then the error of the estimates after up to four successive calls of
    the network in these solves; the gradient passes through the solver. The budget excludes most of the time of the
    solves. A resumed run first repeats the last solves.

    Each validation rewrites checkpoint, curves (CSV), weights and model card. Works under torchrun.
    """
    out = out or Path("runs") / name
    asked = {key: value for key, value in (("crop", crop), ("batch", batch)) if value is not None}
    budget = Budget(out, minutes, steps, seed, rate, optimizer=optimizer, validations=validations)
    sample = replace(SAMPLES[name], **asked)
    folders = " ".join(f"--data {folder.name}" for folder in data)
    spent = f"--minutes {minutes:g}" if steps is None else f"--steps {steps}"
    size = "".join(f" --{key} {value}" for key, value in asked.items())
    learning = f"--seed {seed} --rate {rate:g} --optimizer {optimizer}"
    begun = f" --start {start.name}" if start else ""
    begun += f" --solves {solves} --validations {validations}" if solves else ""
    if solves and not start:
        raise InputError("solves: weights to --start from were expected")
    if solves and (crop or SAMPLES[name].crop) < SMALLEST:
        raise InputError(f"crop is {crop}: {SMALLEST} pixels at least were expected, with --solves")
    command = f"python -m priors.train {name} {folders} {spent} {learning}{size}{begun}"

    def run() -> None:
        numba.set_num_threads(min(torch.get_num_threads(), numba.get_num_threads()))  # torchrun limits torch's threads
        training, validation = split(load_clips(data))
        path = weights or out / f"{name}.safetensors"
        place = Place.here()
        watch = Watch(training, name, solves, sample.crop, seed, place.rank) if solves else None
        task = Denoising(name, training, validation, sample, seed, path, command, start, watch)
        train(task, budget, place, resume)

    launch(run)


if __name__ == "__main__":
    main()
