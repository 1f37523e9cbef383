"""Command line of the trainer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from pnp_sci.training.clips import load_clips, split
from pnp_sci.training.loop import Budget, Place, launch, train

from .._network import ARCHITECTURES
from .task import Denoising, Sample

SAMPLES = {"video": Sample(frames=8, batch=2), "ffdnet": Sample(frames=1, batch=16)}
FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)
PATH = click.Path(path_type=Path)


@click.command(context_settings={"show_default": True})
@click.argument("name", type=click.Choice(sorted(ARCHITECTURES)))
@click.option("--data", type=FOLDER, multiple=True, required=True, help="Folder of videos or photographs; repeatable.")
@click.option("--out", type=PATH, help="Folder for checkpoint and curves.  [default: runs/NAME]")
@click.option(
    "--weights", type=PATH, help="Weights to write, the model card beside them.  [default: OUT/NAME.safetensors]"
)
@click.option("--minutes", default=90.0, help="Budget of time spent in training; a pause does not count.")
@click.option("--steps", type=int, help="Budget of steps instead: the same weights on every run of one machine.")
@click.option("--seed", default=0, help="Seed of weights, crops and noise.")
@click.option("--rate", default=1e-3, help="Highest learning rate.")
@click.option("--crop", default=64, help="Height and width of a training sample in pixels.")
@click.option("--batch", type=int, help="Samples a step and process.  [default: 2 clips or 16 images]")
@click.option("--resume", is_flag=True, help="Continue from the checkpoint in the output folder.")
def main(name, data, out, weights, minutes, steps, seed, rate, crop, batch, resume):
    """Train the prior NAME on a folder of videos; for the image net, of photographs too.

    Checkpoint, curves (CSV), weights and model card are renewed twenty times on the way. Works under torchrun.
    """
    out = out or Path("runs") / name
    budget = Budget(out, minutes, steps, seed, rate)
    sample = replace(SAMPLES[name], crop=crop, batch=batch or SAMPLES[name].batch)
    folders = " ".join(f"--data {folder.name}" for folder in data)
    spent = f"--minutes {minutes:g}" if steps is None else f"--steps {steps}"
    command = f"python -m priors.train {name} {folders} {spent} --seed {seed}"

    def run() -> None:
        training, validation = split(load_clips(data))
        task = Denoising(name, training, validation, sample, seed, weights or out / f"{name}.safetensors", command)
        train(task, budget, Place.here(), resume)

    launch(run)


if __name__ == "__main__":
    main()
