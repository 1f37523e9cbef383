"""The training loop: one process or several (torchrun), CPU or CUDA, to the end of a budget of minutes or steps."""

from __future__ import annotations

import csv
import logging
import math
import os
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Protocol

import torch
from torch import distributed
from torch.nn.parallel import DistributedDataParallel

from pnp_sci.errors import FormatError
from pnp_sci.training.muon import Muon

log = logging.getLogger(__name__)

AGREE = 20  # steps between two looks of all processes at the first one's clock
WARM_UP = 0.01  # of the budget
DECAY = 0.999  # of the moving average; less in the beginning, see `share`
DECAYED = 1e-4  # part of the rate by which each step shrinks the weights
OPTIMIZERS = ("adam", "muon")
SCHEDULES: dict[str, Callable[[float], float]] = {  # part of the budget that is spent -> part of the highest rate
    "cosine": lambda done: min(done / WARM_UP, 0.5 + 0.5 * math.cos(math.pi * done)),
    "steps": lambda done: 0.9 ** int(9 * done),  # OFaNet's: 10 % less every ten of ninety epochs
}


@dataclass(frozen=True)
class Budget:
    """How long is trained and how fast: until `steps`, or else for `minutes`; `out` holds checkpoint and curves."""

    out: Path
    minutes: float = 90.0
    steps: int | None = None
    seed: int = 0
    rate: float = 1e-3
    schedule: str = "cosine"
    optimizer: str = "adam"  # or "muon" for the kernels of convolutions, which learns more in a step
    validations: int = 20  # in the whole budget, each with a checkpoint; their time does not count


@dataclass
class Progress:
    """How far training is. seconds: time spent in steps, by the first process's clock; rows: the curves."""

    step: int = 0
    seconds: float = 0.0
    rows: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True)
class Place:
    """Which of how many processes this is, and where it computes."""

    rank: int
    world: int
    device: torch.device

    @classmethod
    def here(cls, device: str = "auto") -> Place:
        """As torchrun's environment says; "auto" is CUDA where there is one."""
        if device == "auto":
            device = f"cuda:{os.environ.get('LOCAL_RANK', 0)}" if torch.cuda.is_available() else "cpu"
        return cls(int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1)), torch.device(device))

    def hardware(self) -> str:
        """Describe the machine in kind, not by name."""
        if self.device.type == "cuda":
            return f"{self.world} x {torch.cuda.get_device_name(self.device)}"
        capability = torch.backends.cpu.get_cpu_capability()
        threads = torch.get_num_threads()
        return f"CPU with {capability}, {os.cpu_count()} cores, {self.world} process(es) of {threads} thread(s)"


class Task(Protocol):
    """What is trained: a network, its loss and its validation. The loop knows nothing else of it."""

    @property
    def name(self) -> str:
        """What the checkpoint says it holds."""
        ...

    @property
    def settings(self) -> str:
        """What else a run that is resumed must have been begun with, in words."""
        ...

    @property
    def network(self) -> torch.nn.Module:
        """What learns."""
        ...

    @property
    def scores(self) -> tuple[str, ...]:
        """What `validate` measures, as the curves name it."""
        ...

    @property
    def compiled(self) -> Sequence[torch.nn.Module]:
        """The parts of `network` that are worth compiling where there is CUDA."""
        ...

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """The loss of one batch, the same for the same rank and step; `model` is `network`, perhaps wrapped."""
        ...

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sum of each score over the validation cases of this process, then their number."""
        ...

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write weights and model card of the averaged `network`."""
        ...


class Clock:
    """Times laps; one that lasts over five times the median counts as that: the process was paused.

    What passes before the first lap ends does not count: kernels are compiled and chosen there.
    """

    def __init__(self) -> None:
        self.recent: deque[float] = deque(maxlen=101)
        self.last = math.inf

    def restart(self) -> None:
        """Leave out what has passed since the last lap."""
        self.last = time.perf_counter()

    def lap(self) -> float:
        """Return the seconds to count for the lap that ends now."""
        now = time.perf_counter()
        lasted, self.last = now - self.last, now
        if lasted < 0:
            return 0.0
        self.recent.append(lasted)
        return min(lasted, 5 * statistics.median(self.recent))


def share(steps: int) -> float:
    """Part of the way to the current weights that their average moves in a step which so many have preceded.

    It is ``9 / (9 + steps)``, ``1 - DECAY`` at least, and 1 in the first step. So the average forgets the first steps,
    far from anything useful, in a short training too.
    """
    return max(1 - DECAY, 9 / (9 + steps))


def optimizers(network: torch.nn.Module, budget: Budget) -> list[torch.optim.Optimizer]:
    """What moves the weights that learn: Adam all of them, or Muon the kernels and Adam the others."""
    learned = [p for p in network.parameters() if p.requires_grad]
    kernels = [p for p in learned if p.ndim == 4 and budget.optimizer == "muon"]
    others = [p for p in learned if p.ndim != 4 or budget.optimizer != "muon"]
    found: list[torch.optim.Optimizer] = []
    if kernels:
        found.append(Muon(kernels, budget.rate, DECAYED))
    if others:
        found.append(torch.optim.AdamW(others, budget.rate, weight_decay=DECAYED, foreach=True))
    return found


class Trainer:
    """Everything that a checkpoint must hold, and the steps that change it."""

    def __init__(self, task: Task, budget: Budget, place: Place):
        self.task, self.budget, self.place = task, budget, place
        self.network = task.network.to(place.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.progress = Progress()
        # not torch's AveragedModel, whose count may lie on the device: to read it would wait; no network has buffers
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimizers = optimizers(self.network, budget)
        if place.device.type == "cuda":  # on the CPU compiling takes longer than it saves
            torch.backends.cudnn.benchmark = True
            for module in task.compiled:
                module.compile()
        self.model = DistributedDataParallel(self.network) if place.world > 1 else self.network

    def done(self) -> float:
        """Part of the budget that is spent, the same in all processes."""
        if self.budget.steps is not None:
            return self.progress.step / self.budget.steps
        spent = torch.tensor([self.progress.seconds / (60 * self.budget.minutes)], device=self.place.device)
        if self.place.world > 1:
            distributed.broadcast(spent, 0)
        return spent.item()

    def step(self, done: float) -> torch.Tensor:
        """One step of the optimisers; returns the loss."""
        loss = self.task.loss(self.model, self.place, self.progress.step)
        self.network.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0, foreach=True)
        for optimizer in self.optimizers:
            for group in optimizer.param_groups:
                group["lr"] = max(self.budget.rate * SCHEDULES[self.budget.schedule](done), 1e-6)
            optimizer.step()
        averaged, current = (list(net.parameters()) for net in (self.average, self.network))
        with torch.no_grad():
            torch._foreach_lerp_(averaged, current, share(self.progress.step))  # type: ignore[attr-defined]
        self.progress.step += 1
        return loss.detach()

    def validate(self) -> list[float]:
        """Mean scores of the averaged weights, NaN where there is no case; the processes share the cases."""
        total = self.task.validate(self.average, self.place).to(self.place.device)
        if self.place.world > 1:
            distributed.all_reduce(total)
        return (total[:-1] / total[-1]).tolist()

    def publish(self) -> None:
        """Write checkpoint, curves, weights and card; a file is renamed to its place when it is complete."""
        out = self.budget.out
        out.mkdir(parents=True, exist_ok=True)
        state = {
            "name": self.task.name,
            "settings": self.task.settings,
            "seed": self.budget.seed,
            "by": self.budget.optimizer,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "progress": vars(self.progress),
        }
        torch.save(state, out / "checkpoint.partial")
        os.replace(out / "checkpoint.partial", out / "checkpoint.pt")
        with open(out / "curves.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["step", "minutes", "loss", *self.task.scores])
            writer.writerows(self.progress.rows)
        self.task.publish(self.average, self.progress, self.place)

    def resume(self) -> None:
        """Continue where the checkpoint in the output folder stands."""
        checkpoint = self.budget.out / "checkpoint.pt"
        if not checkpoint.is_file():
            raise FormatError(f"resume: {checkpoint} was expected, but there is none")
        state = torch.load(checkpoint, map_location=self.place.device, weights_only=True)
        earlier = "an earlier version"
        held = state["name"], state.get("settings", earlier), state["seed"], state.get("by", earlier)
        asked = self.task.name, self.task.settings, self.budget.seed, self.budget.optimizer
        if held != asked:
            runs = ("{} ({}) with seed {} by {}".format(*run) for run in (held, asked))
            raise FormatError("resume: the checkpoint is of {}, but {} was asked for".format(*runs))
        try:
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
        except RuntimeError as error:
            raise FormatError(f"resume: the checkpoint is of {earlier}, whose weights do not fit") from error
        for optimizer, kept in zip(self.optimizers, state["optimizers"]):
            optimizer.load_state_dict(kept)
        self.progress = Progress(**state["progress"])


def train(task: Task, budget: Budget, place: Place, resume: bool = False) -> Progress:
    """Train until the budget is spent; to resume a run that has spent its own only writes its files anew."""
    trainer = Trainer(task, budget, place)
    if resume:
        trainer.resume()
    progress, clock, losses = trainer.progress, Clock(), []
    done = trainer.done()
    mark = int(done * budget.validations)
    if done >= 1 and place.rank == 0:
        trainer.publish()
    while done < 1:
        losses.append(trainer.step(done))
        if budget.steps is not None or progress.step % AGREE == 0:
            if place.device.type == "cuda":
                torch.cuda.synchronize()  # else the clock runs ahead of the device
            progress.seconds += clock.lap()
            done = trainer.done()
        if int(done * budget.validations) > mark:
            mark = int(done * budget.validations)
            loss, losses = torch.stack(losses).mean().item(), []
            row = [progress.step, round(progress.seconds / 60, 3), loss, *trainer.validate()]
            progress.rows.append(row)
            if place.rank == 0:
                trainer.publish()
                shown = "  ".join(f"{name} {value:.3f}" for name, value in zip(task.scores, row[3:]))
                log.info("%s: %3.0f %%, step %d, loss %.5f, %s", task.name, 100 * done, progress.step, loss, shown)
            clock.restart()
    return progress


def launch(run: Callable[[], object]) -> None:
    """Call `run`, within a process group if torchrun started this process."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    if int(os.environ.get("WORLD_SIZE", 1)) == 1:
        run()
        return
    backend = "nccl" if torch.cuda.is_available() else "gloo"
    distributed.init_process_group(backend, timeout=timedelta(days=1))  # outlasts a run that somebody pauses
    try:
        run()
        distributed.barrier()  # a process that ends while another still writes has been seen to abort
    finally:
        distributed.destroy_process_group()
