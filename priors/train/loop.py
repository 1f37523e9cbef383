"""The training loop: one process or several (torchrun), CPU or CUDA, to the end of a budget of minutes or steps."""

from __future__ import annotations

import csv
import logging
import math
import os
import statistics
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import distributed
from torch.nn.parallel import DistributedDataParallel
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from pnp_sci.errors import FormatError

from .. import _weights
from .._network import ARCHITECTURES, Network
from .card import write_card
from .data import Clip, Sampler, load_clips, split
from .validation import LEVELS, psnr

log = logging.getLogger(__name__)

VALIDATIONS = 20  # in the whole budget, each with a checkpoint
AGREE = 20  # steps between two looks of all processes at the first one's clock
WARM_UP = 0.01  # of the budget
DECAY = 0.999  # of the moving average


@dataclass(frozen=True)
class Settings:
    """What is trained, on what and for how long: until `steps`, or else for `minutes`."""

    name: str
    data: tuple[Path, ...]
    out: Path
    weights: Path
    minutes: float = 90.0
    steps: int | None = None
    seed: int = 0
    rate: float = 1e-3
    frames: int = 8
    crop: int = 64
    batch: int = 2


@dataclass
class Progress:
    """How far training is. seconds: time spent in steps, by the first process's clock; rows: the curves."""

    step: int = 0
    seconds: float = 0.0
    rows: list[list[float]] = field(default_factory=list)


class Clock:
    """Sums the durations of steps; one that lasts over five times the median counts as that: the process was paused."""

    def __init__(self):
        self.recent: deque[float] = deque(maxlen=101)
        self.last = time.perf_counter()

    def restart(self) -> None:
        """Leave out what has passed since the last lap."""
        self.last = time.perf_counter()

    def lap(self) -> float:
        """Return the seconds to count for the step that ends now."""
        now = time.perf_counter()
        self.recent.append(now - self.last)
        self.last = now
        return min(self.recent[-1], 5 * statistics.median(self.recent))


class Trainer:
    """Everything that a checkpoint must hold, and the steps that change it."""

    def __init__(self, settings: Settings):
        self.settings = settings
        self.rank, self.world = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
        cuda = torch.cuda.is_available()
        self.device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0))) if cuda else torch.device("cpu")
        torch.manual_seed(settings.seed)
        self.network = Network(ARCHITECTURES[settings.name]).to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = AveragedModel(self.network, multi_avg_fn=get_ema_multi_avg_fn(DECAY))
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=settings.rate, weight_decay=1e-4, foreach=True)
        self.model = DistributedDataParallel(self.network) if self.world > 1 else self.network
        self.progress = Progress()

    def done(self) -> float:
        """Part of the budget that is spent, the same in all processes."""
        settings, progress = self.settings, self.progress
        if settings.steps is not None:
            return progress.step / settings.steps
        spent = torch.tensor([progress.seconds / (60 * settings.minutes)], device=self.device)
        if self.world > 1:
            distributed.broadcast(spent, 0)
        return spent.item()

    def step(self, sampler: Sampler, done: float) -> torch.Tensor:
        """One step of the optimiser; returns the loss."""
        rate = self.settings.rate * min(done / WARM_UP, 0.5 + 0.5 * math.cos(math.pi * done))
        for group in self.optimizer.param_groups:
            group["lr"] = max(rate, 1e-6)
        clean, noisy, sigma = (torch.from_numpy(a).to(self.device) for a in sampler(self.rank, self.progress.step))
        with torch.autocast(self.device.type, torch.bfloat16):
            out = noisy - self.model(noisy, sigma)
        loss = ((out - clean).abs().mean((1, 2, 3)) / (sigma + 1 / 255).sqrt()).mean()
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0, foreach=True)
        self.optimizer.step()
        self.average.update_parameters(self.network)
        self.progress.step += 1
        return loss.detach()

    def validate(self, clips: list[Clip]) -> list[float]:
        """PSNR in dB of the averaged weights at each of the validation's levels; the processes share the clips."""
        total = psnr(self.average.module, clips[self.rank :: self.world], self.device).to(self.device)
        if self.world > 1:
            distributed.all_reduce(total)
        return (total / max(len(clips), 1)).tolist()

    def publish(self, training: list[Clip], validation: list[Clip]) -> None:
        """Write checkpoint, curves, weights and card; a file is renamed to its place when it is complete."""
        out, progress = self.settings.out, self.progress
        out.mkdir(parents=True, exist_ok=True)
        state = {
            "name": self.settings.name,
            "seed": self.settings.seed,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "progress": vars(progress),
        }
        torch.save(state, out / "checkpoint.partial")
        os.replace(out / "checkpoint.partial", out / "checkpoint.pt")
        with open(out / "curves.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["step", "minutes", "loss", *(f"psnr_{level}" for level in LEVELS)])
            writer.writerows(progress.rows)
        digest = _weights.save(
            self.settings.weights, self.settings.name, self.network.architecture, self.average.module
        )
        write_card(self, training, validation, digest)

    def resume(self) -> None:
        """Continue where the checkpoint in the output folder stands."""
        state = torch.load(self.settings.out / "checkpoint.pt", map_location=self.device, weights_only=True)
        if (state["name"], state["seed"]) != (self.settings.name, self.settings.seed):
            raise FormatError(
                f"resume: the checkpoint is of {state['name']} with seed {state['seed']}, "
                f"but {self.settings.name} with seed {self.settings.seed} was asked for"
            )
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.progress = Progress(**state["progress"])


def train(settings: Settings, resume: bool = False) -> Progress:
    """Train a prior, write its weights and its model card; see ``python -m priors.train --help``.

    To resume a run that has spent its budget only writes its files anew.
    """
    trainer = Trainer(settings)
    if resume:
        trainer.resume()
    training, validation = split(load_clips(settings.data))
    sampler = Sampler(training, frames=settings.frames, crop=settings.crop, batch=settings.batch, seed=settings.seed)
    progress, clock, losses = trainer.progress, Clock(), []
    done = trainer.done()
    mark = int(done * VALIDATIONS)
    if done >= 1 and trainer.rank == 0:
        trainer.publish(training, validation)
    while done < 1:
        losses.append(trainer.step(sampler, done))
        progress.seconds += clock.lap()
        if settings.steps is not None or progress.step % AGREE == 0:
            done = trainer.done()
        if int(done * VALIDATIONS) > mark:
            mark = int(done * VALIDATIONS)
            loss, losses = torch.stack(losses).mean().item(), []
            row = [progress.step, round(progress.seconds / 60, 3), loss, *trainer.validate(validation)]
            progress.rows.append(row)
            if trainer.rank == 0:
                trainer.publish(training, validation)
                log.info(
                    "%s: %3.0f %%, step %d, loss %.4f, PSNR %s", settings.name, 100 * done, progress.step, loss, row[3:]
                )
            clock.restart()
    return progress
