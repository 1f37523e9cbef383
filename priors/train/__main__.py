"""Command line of the trainer."""

from __future__ import annotations

import logging
import os
from datetime import timedelta
from pathlib import Path

import click
import torch
from torch import distributed

from .._network import ARCHITECTURES
from .loop import Settings, train

SAMPLES = {"video": {"frames": 8, "batch": 2}, "ffdnet": {"frames": 1, "batch": 16}}
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
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    out = out or Path("runs") / name
    sample = SAMPLES[name] | ({"batch": batch} if batch else {})
    settings = Settings(
        name, data, out, weights or out / f"{name}.safetensors", minutes, steps, seed, rate, crop=crop, **sample
    )
    if int(os.environ.get("WORLD_SIZE", 1)) == 1:
        train(settings, resume)
        return
    backend = "nccl" if torch.cuda.is_available() else "gloo"
    distributed.init_process_group(backend, timeout=timedelta(days=1))  # outlasts a run that somebody pauses
    try:
        train(settings, resume)
    finally:
        distributed.destroy_process_group()


if __name__ == "__main__":
    main()
