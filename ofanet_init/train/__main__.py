"""Command line of the trainer."""

from __future__ import annotations

from pathlib import Path

import click
import torch
from click.core import ParameterSource

from ofanet_init import files as _weights
from ofanet_init.baselines.config import BaselineConfig
from ofanet_init.config import FLOWS, REFINES, OFaNetConfig
from ofanet_init.train.tasks import Baseline, Flow, Reconstruction, Sample
from pnp_sci.errors import InputError
from pnp_sci.training.clips import load_clips, split
from pnp_sci.training.loop import OPTIMIZERS, SCHEDULES, Budget, launch, train
from pnp_sci.training.task import Place

FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)
PATH = click.Path(path_type=Path)
OFANETS = ("stage", "amplifier", "dual", "refine", "flow", "joint", "passes", "window")  # options for OFaNet only


@click.command(context_settings={"show_default": True})
@click.option("--model", type=click.Choice(list(_weights.MODELS)), default="ofanet", help="Which network.")
@click.option(
    "--stage", type=click.Choice(["dns", "flow", "refine", "joint"]), help="Stage of training; for ofanet only."
)
@click.option("--data", type=FOLDER, multiple=True, required=True, help="Folder of videos or photographs; repeatable.")
@click.option("--views", default=2, help="Number of views V.")
@click.option("--frames", default=10, help="Number of frames B of a view.")
@click.option("--amplifier/--no-amplifier", default=True, help="With or without the diversity amplifier.")
@click.option("--dual/--single", default=True, help="A separator branch for each view, or one for all.")
@click.option("--refine", type=click.Choice(REFINES), default="simplified", help="Which refine net.")
@click.option("--flow", type=click.Choice(FLOWS), default="both", help="Flows that the refine net has as inputs.")
@click.option("--joint/--frozen", default=True, help="Whether the flow net is trained with the refine net.")
@click.option("--passes", default=1, help="Passes of flow and refine net over the video.")
@click.option("--start", type=PATH, multiple=True, help="Initial weights, from an earlier stage; repeatable.")
@click.option("--out", type=PATH, help="Folder for checkpoint and curves.  [default: runs/MODEL-STAGE]")
@click.option("--weights", type=PATH, help="Weights to write, with a model card.  [default: OUT/MODEL.safetensors]")
@click.option(
    "--minutes",
    default=90.0,
    type=click.FloatRange(min=0, min_open=True),
    help="Budget of training time in minutes, without pauses.",
)
@click.option("--steps", type=click.IntRange(min=1), help="Budget in steps; replaces --minutes.")
@click.option("--seed", default=0, help="Random seed of weights, crops, masks and noise.")
@click.option("--rate", default=3e-4, help="Highest learning rate.")
@click.option(
    "--schedule",
    type=click.Choice(sorted(SCHEDULES)),
    default="steps",
    help="Learning-rate schedule; steps: the paper's.",
)
@click.option(
    "--optimizer", type=click.Choice(OPTIMIZERS), default="adam", help="Adam, as in the paper, or Muon for kernels."
)
@click.option("--crop", default=256, help="Height and width of a training sample in pixels.")
@click.option("--batch", default=2, type=click.IntRange(min=1), help="Samples per step and process.")
@click.option("--window", type=int, help="Consecutive frames refined in a step.  [default: all]")
@click.option("--device", default="auto", help="cpu, cuda or auto.")
@click.option("--validations", default=20, type=click.IntRange(min=1), help="Number of validations and checkpoints.")
@click.option("--resume", is_flag=True, help="Continue from the checkpoint in the output folder.")
def main(
    model, stage, data, views, frames, amplifier, dual, refine, flow, joint, passes, start, out, weights, minutes,
    steps, seed, rate, schedule, optimizer, crop, batch, window, device, validations, resume,
):  # fmt: skip
    """Train a decoder.

    OFaNet is trained in stages: separator (dns), flow net (flow), flow and refine net (refine), all together (joint).
    The stage dns trains a model without refine net. The stage refine is optional. Each stage writes the weights of the
    whole model; --start takes the weights of earlier stages. The other networks have one stage.

    Each validation rewrites checkpoint, curves (CSV), weights and model card. Works under torchrun.
    """
    source = click.get_current_context().get_parameter_source
    if model == "ofanet" and stage is None:
        raise InputError("model is ofanet: --stage was expected")
    if model != "ofanet" and (given := [name for name in OFANETS if source(name) is not ParameterSource.DEFAULT]):
        raise InputError(f"model is {model}, but these options are for ofanet only: {', '.join(given)}")
    name = model if stage is None else f"{model}-{stage}"
    out = out or Path("runs") / name
    budget = Budget(out, minutes, steps, seed, rate, schedule, optimizer, validations)
    place = Place.here(device)
    torch.manual_seed(seed)
    if stage == "dns":
        refine = "none"
    if stage == "refine" and (refine == "none" or not (start or resume)):
        raise InputError("stage is refine: a refine net, and weights to --start from, were expected")
    make, _ = _weights.MODELS[model]
    if stage is None:
        network = make(BaselineConfig(views, frames))
    else:
        network = make(OFaNetConfig(views, frames, amplifier, dual, refine, flow, joint, passes))
    for path in start:
        _weights.start(network, path)
    spent = f"--minutes {minutes:g}" if steps is None else f"--steps {steps}"
    command = (
        f"python -m ofanet_init.train --model {model} "
        + (f"--stage {stage} " if stage else "")
        + f"{' '.join(f'--data {folder.name}' for folder in data)} "
        f"--views {views} --frames {frames} {spent} --rate {rate:g} --schedule {schedule} --optimizer {optimizer} "
        f"--crop {crop} --batch {batch} --seed {seed}"
        + (f" --window {window}" if window else "")
        + (f" --passes {passes}" if passes > 1 else "")
        + ("" if joint else " --frozen")
        + "".join(f" --start {path.name}" for path in start)
    )

    def run() -> None:
        material = (network, *split(load_clips(data)), Sample(batch, crop, window or frames), seed, place)
        material += (weights or out / f"{model}.safetensors", command)
        if stage is None:
            task = Baseline(*material)
        else:
            task = Flow(*material) if stage == "flow" else Reconstruction(stage, *material)
        train(task, budget, place, resume)

    launch(run)


if __name__ == "__main__":
    main()
