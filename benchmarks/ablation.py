"""The ablation table of the OFaNet paper at an equal, small training budget: PSNR in dB of every variant.

PNP_SCI_DATA=... python benchmarks/ablation.py MINUTES [refine]

Of its MINUTES each variant trains its separator for the one half and everything for the other, from random weights but
for the flow net: that is pre-trained once, for a quarter of them, as the paper's is. With `refine` the variants of the
refine net alone: all MINUTES for it and the flow net, behind the separator of the weights that come with the package,
and with their flow net to begin with, which has learned together with a refine net before. Runs stay in runs/ablation.
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
    """Weights after that stage; a run that has ended stays as it is."""
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
    """Parameters in millions; PSNR of separator and whole on the trainer's held-out clips, and on the three pairs."""
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
    """Weights of every variant, all from the beginning."""
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
    """Weights of the variants of the refine net, behind the package's separator."""
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
