"""The training loop for one or several processes (torchrun), CPU or CUDA, with a budget of minutes or steps."""

from __future__ import annotations

import csv
import logging
import math
import os
import statistics
import time
from collections import deque
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from pickle import UnpicklingError

import torch
from torch import distributed
from torch.nn.parallel import DistributedDataParallel

from pnp_sci.errors import FormatError
from pnp_sci.formats.replacing import replacing
from pnp_sci.training.muon import Muon
from pnp_sci.training.task import Place, Progress, Task

log = logging.getLogger(__name__)

AGREE = 20  # steps from one broadcast of the elapsed time to the next
WARM_UP = 0.01  # fraction of the budget with a linearly rising rate
DECAY = 0.999  # of the exponential moving average of the weights; smaller in the first steps, see share
DECAYED = 1e-4  # weight decay
OPTIMIZERS = ("adam", "muon")
SCHEDULES: dict[str, Callable[[float], float]] = {  # fraction of the budget -> fraction of the highest rate
    "cosine": lambda done: min(done / WARM_UP, 0.5 + 0.5 * math.cos(math.pi * done)),
    "steps": lambda done: 0.9 ** int(9 * done),  # OFaNet's: 10 % less every ten of ninety epochs
}


@dataclass(frozen=True)
class Budget:
    """Length of training and learning rate: `steps` if given, else `minutes`; `out` holds checkpoint and curves."""

    out: Path
    minutes: float = 90.0
    steps: int | None = None
    seed: int = 0
    rate: float = 1e-3
    schedule: str = "cosine"
    optimizer: str = "adam"  # or "muon" for the kernels of convolutions
    validations: int = 20  # number in the whole budget, each with a checkpoint; the budget excludes their time


class Clock:
    """Measures the time of laps, without pauses: a lap counts at most five times the median lap.

    The time before the end of the first lap does not count, because it includes compilation.
    """

    def __init__(self) -> None:
        self.recent: deque[float] = deque(maxlen=101)
        self.last = math.inf

    def restart(self) -> None:
        """Discard the time since the last lap."""
        self.last = time.perf_counter()

    def lap(self) -> float:
        """End a lap; return its seconds, without pauses."""
        now = time.perf_counter()
        lasted, self.last = now - self.last, now
        if lasted < 0:
            return 0.0
        self.recent.append(lasted)
        return min(lasted, 5 * statistics.median(self.recent))


def share(steps: int) -> float:
    """Weight of the current weights in the moving average, after `steps` earlier steps.

    It is ``9 / (9 + steps)``, but at least ``1 - DECAY``. So the first steps have little weight in short trainings too.
    """
    return max(1 - DECAY, 9 / (9 + steps))


def optimizers(network: torch.nn.Module, budget: Budget) -> list[torch.optim.Optimizer]:
    """The optimisers of the trainable weights: Adam for all, or Muon for the kernels and Adam for the others."""
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
    """State of a training run, its steps and its checkpoints."""

    def __init__(self, task: Task, budget: Budget, place: Place):
        self.task, self.budget, self.place = task, budget, place
        self.network = task.network.to(place.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.progress = Progress()
        # not torch's AveragedModel, whose counter on the device needs a synchronisation; the networks have no buffers
        self.average = deepcopy(self.network).requires_grad_(False)
        self.optimizers = optimizers(self.network, budget)
        if place.device.type == "cuda":  # on the CPU, compilation takes longer than it saves
            torch.backends.cudnn.benchmark = True
            for module in task.compiled:
                module.compile()
        self.model = DistributedDataParallel(self.network) if place.world > 1 else self.network

    def done(self) -> float:
        """Fraction of the budget that is spent, equal in all processes."""
        if self.budget.steps is not None:
            return self.progress.step / self.budget.steps
        spent = torch.tensor([self.progress.seconds / (60 * self.budget.minutes)], device=self.place.device)
        if self.place.world > 1:
            distributed.broadcast(spent, 0)
        return spent.item()

    def step(self, done: float) -> torch.Tensor:
        """Do one optimisation step; return the loss."""
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
        """Mean scores of the averaged weights over all processes; NaN without validation cases."""
        total = self.task.validate(self.average, self.place).to(self.place.device)
        if self.place.world > 1:
            distributed.all_reduce(total)
        return (total[:-1] / total[-1]).tolist()

    def publish(self) -> None:
        """Write checkpoint (atomically), curves, weights and model card."""
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
            "task": self.task.state(),
        }
        with replacing(out / "checkpoint.pt") as temporary:
            torch.save(state, temporary)
        with replacing(out / "curves.csv") as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["step", "minutes", "loss", *self.task.scores])
            writer.writerows(self.progress.rows)
        self.task.publish(self.average, self.progress, self.place)

    def resume(self) -> None:
        """Restore the state from the checkpoint in the output folder.

        Raises
        ------
        FormatError
            If there is no checkpoint, it is damaged, or it belongs to another task, other settings or another seed.
        """
        checkpoint = self.budget.out / "checkpoint.pt"
        if not checkpoint.is_file():
            raise FormatError(f"resume: {checkpoint} does not exist")
        try:
            state = torch.load(checkpoint, map_location=self.place.device, weights_only=True)
        except (EOFError, RuntimeError, UnpicklingError) as error:
            why = str(error).partition("\n")[0] or "it ends too early"
            raise FormatError(f"resume: {checkpoint} cannot be read, it may be damaged: {why}") from error
        earlier = "an earlier version"
        held = state["name"], state.get("settings", earlier), state["seed"], state.get("by", earlier)
        asked = self.task.name, self.task.settings, self.budget.seed, self.budget.optimizer
        if held != asked:
            runs = ("{} ({}) with seed {} by {}".format(*run) for run in (held, asked))
            raise FormatError("resume: the checkpoint is of {}, but {} was asked for".format(*runs))
        try:
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self.task.restore(state.get("task", {}))
        except (KeyError, RuntimeError) as error:
            raise FormatError(f"resume: the checkpoint is of {earlier}: its values do not fit") from error
        for optimizer, kept in zip(self.optimizers, state["optimizers"]):
            optimizer.load_state_dict(kept)
        self.progress = Progress(**state["progress"])


def train(task: Task, budget: Budget, place: Place, resume: bool = False) -> Progress:
    """Train until the budget is spent; resuming a finished run only rewrites its files.

    Raises
    ------
    FormatError
        If the output folder holds the checkpoint of an earlier run and it is not resumed, or cannot be.
    """
    if not resume and (earlier := budget.out / "checkpoint.pt").exists():
        raise FormatError(f"out: {earlier} is of an earlier run: --resume goes on with it; or give another folder")
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
                torch.cuda.synchronize()  # CUDA calls return before they are done
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
    """Call `run`, in a process group if torchrun started this process."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    if int(os.environ.get("WORLD_SIZE", 1)) == 1:
        run()
        return
    backend = "nccl" if torch.cuda.is_available() else "gloo"
    distributed.init_process_group(backend, timeout=timedelta(days=1))  # longer than a pause of the run
    try:
        run()
        distributed.barrier()  # no process ends while another one still writes
    finally:
        distributed.destroy_process_group()
