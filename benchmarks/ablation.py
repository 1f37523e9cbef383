"""Ablation study of the OFaNet paper with an equal, small training budget: PSNR in dB of each variant.

PNP_SCI_DATA=DIR python benchmarks/ablation.py MINUTES [refine]

Each variant trains its separator for half of MINUTES and the whole model for the other half, from random weights. The
flow net is pre-trained once, for a quarter of MINUTES, as in the paper. With `refine`, only variants of the refine net
are trained, with their flow net, for all MINUTES. Separator and initial flow net are then those of the package.
Runs are stored in runs/ablation.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch

import pnp_sci
from ofanet_init import files as _weights
from pnp_sci.accel.inference import mixed_precision

DATA = Path(os.environ["PNP_SCI_DATA"])
RUNS = Path("runs/ablation")
PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
SEPARATORS = {"W/o DA": "--no-amplifier", "W/o DNS": "--single"}
REFINES = {"W/o OF": "--flow none", "W/o Br": "--flow forward", "W/o JT": "--frozen", "BRRN": "--refine birecurrent"}


def train(name, stage, minutes, options="", *starts):
    """Train a stage, or resume it; return the path of its weights."""
    out = RUNS / f"{minutes:g}-minutes" / name.replace("/", "").replace(" ", "-").lower()
    options += " --crop 96 --batch 4" if stage in ("dns", "flow") else " --crop 64 --batch 2 --window 4"
    options += " --optimizer muon --schedule cosine --rate 0.001 --validations 1"
    command = [sys.executable, "-m", "ofanet_init.train", "--stage", stage, "--minutes", minutes, "--out", out]
    command += [*options.split(), "--data", DATA / "train_video", "--data", DATA / "train_still"]
    command += [word for start in starts for word in ("--start", start)]
    command += ["--resume"] if (out / "checkpoint.pt").exists() else []
    subprocess.run([str(word) for word in command], check=True)
    return out / "ofanet.safetensors"


def scores(weights):
    """Millions of parameters; PSNR in dB of separator and whole model on held-out clips and on the three pairs."""
    with open(weights.with_name("curves.csv"), newline="") as file:
        last = list(csv.DictReader(file))[-1]
    network, _ = _weights.load(weights)
    pairs = []
    for name in PAIRS:
        scene = pnp_sci.datasets.dualview(name)
        y, masks = (torch.from_numpy(np.float32(a))[None] for a in (scene.y, scene.masks))
        with torch.inference_mode(), mixed_precision(torch.device("cpu")):
            videos = network(y, masks)
        pairs.append([np.mean(pnp_sci.psnr(video[0].float().numpy(), scene.truth)) for video in videos])
    millions = sum(p.numel() for p in network.parameters()) / 1e6
    return millions, float(last["psnr_first"]), float(last["psnr_refined"]), *np.mean(pairs, 0)


def whole_models(minutes):
    """Weights of each variant, trained from random weights."""
    half = minutes / 2
    flow = train("flow", "flow", minutes / 4)
    separator = train("separator", "dns", half)
    variants = {"W/o RN": train("W/o RN", "dns", minutes)}
    for name, option in SEPARATORS.items():
        own = train(f"separator {name}", "dns", half, option)
        variants[name] = train(name, "joint", half, option, flow, own)
    for name, option in REFINES.items():
        variants[name] = train(name, "joint", half, option, flow, separator)
    return variants | {"OFaNet": train("OFaNet", "joint", half, "", flow, separator)}


def refine_nets(minutes):
    """Weights of the variants of the refine net, with the separator of the package."""
    network, _ = _weights.load(_weights.FOLDER / "v2b10.safetensors")
    network.refiners = torch.nn.ModuleList()
    RUNS.mkdir(parents=True, exist_ok=True)
    _weights.save(RUNS / "start.safetensors", network)
    options = REFINES | {"OFaNet": ""}
    return {n: train(f"refine {n}", "refine", minutes, o, RUNS / "start.safetensors") for n, o in options.items()}


def main(minutes, which="whole"):
    variants = {"whole": whole_models, "refine": refine_nets}[which](float(minutes))
    print("| variant | million parameters | held-out clips: separator | whole | three pairs: separator | whole |")
    print("|---|---|---|---|---|---|")
    for name, weights in variants.items():
        print("| {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |".format(name, *scores(weights)))


if __name__ == "__main__":
    main(*sys.argv[1:])
