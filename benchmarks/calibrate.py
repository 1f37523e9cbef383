"""Sweeps of the tuned numbers: change of PSNR in dB if a number is halved, doubled or switched off.

    PNP_SCI_DATA=DIR python benchmarks/calibrate.py priors.flow  # numbers of a module, or one: priors.flow.grain
    python benchmarks/calibrate.py --list  # all tuned numbers, and how many there are

The cases are crops of 128 x 128 pixels of validation clips (:func:`pnp_sci.training.clips.split`), whose scenes are not
in the training set. The three benchmark pairs are not used. Each number has a row in docs/calibration.
"""

import importlib
import inspect
import json
import os
import pkgutil
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from multiprocessing import get_context
from pathlib import Path

import click
import numpy as np

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "calibration"
SIZE = 128  # pixels per side of a case
OPTIONS = {  # numbers that are options
    "priors.flow.Flow": ("tolerance", "renew"),
    "priors.video.Video": ("renew",),
    "pnp_sci.api.solve": ("tol",),
}
DEFAULTS = {  # options whose defaults are tuned numbers
    "priors.tv.warmup": tuple(
        f"priors.{p}.first" for p in ("bm3d.BM3D", "flow.Flow", "desci.DeSCI", "ffdnet.FFDNet", "video.Video")
    ),
    "priors.motion.measure.neighbours": ("priors.flow.Flow.neighbours", "priors.desci.DeSCI.neighbours"),
    "priors.motion.measure.drift": ("priors.flow.Flow.drift",),
}
# Methods that depend on a module, and the kinds of cases: moving scenes, noise, still scenes, choice of the scene model
FAST, STRONG = ("tv", "flow"), ("flow", "video")
SERVES = {
    "pnp_sci.solvers.schedule": (FAST, "noise"),
    "pnp_sci.solvers.gap": (FAST, "moving noise"),
    "pnp_sci.solvers.displacement": (STRONG, "moving noise"),
    "pnp_sci.solvers.effort": (STRONG, "moving noise"),
    "pnp_sci.solvers.stopping": (("tv",), "moving noise"),
    "pnp_sci.api": (("tv",), "moving noise"),
    "pnp_sci.solvers.averaging": (STRONG, "moving noise"),
    "pnp_sci.pipeline.blend": (("video",), "noise"),
    "pnp_sci.scene.judge": (FAST, "scene"),
    "pnp_sci.scene.evidence": (FAST, "scene"),
    "pnp_sci.scene.dark_views": (FAST, "scene"),
    "pnp_sci.scene.choose": (("flow",), "scene"),
    "pnp_sci.sensing.problem": (("tv",), "moving noise"),
    "pnp_sci.sensing.noise": (("tv",), "moving noise"),
    "priors.tv": (("tv",), "moving noise still"),
    "priors.bm3d": (("bm3d", "flow"), "moving noise still"),
    "priors.flow": (("flow",), "moving noise still"),
    "priors.motion.measure": (("flow",), "moving"),
    "priors.motion.credit": (STRONG, "moving"),
    "priors.kernels.still": (FAST, "moving still"),
    "priors.ffdnet": (("ffdnet",), "moving noise"),
    "priors.session": (("ffdnet", "video"), "moving noise"),
    "priors.networks.along_motion": (("video",), "moving noise"),
    "priors.video": (("video",), "moving noise"),
    "ofanet_init.prepared": (("decode:ofanet-fast",), "moving noise"),
}
ALSO = {"pnp_sci.solvers.schedule.sigma": "moving", "pnp_sci.solvers.schedule.settled": "moving"}
ONLY = {"priors.tv.warmup": STRONG, "pnp_sci.solvers.schedule.settled": STRONG, "pnp_sci.solvers.effort.plain": ("tv",)}
EFFORT = {"pnp_sci.solvers.effort.fast": "fast", "pnp_sci.solvers.effort.best": "best"}
OFF = json.loads((Path(__file__).parent / "calibrate_off.json").read_text())  # values that switch a number off


@dataclass(frozen=True)
class Case:
    """A scene: indices of validation clips, frames, noise of max(y), and whether the first frame is repeated."""

    kind: str
    clips: tuple[int, ...]
    frames: int = 10
    noise: float = 0.0
    still: bool = False
    dim: float = 1.0  # brightness of the second view

    def load(self, clips):
        films = [_crop(clips[i], self.frames) for i in self.clips]
        truth = np.stack([np.repeat(f[:1], self.frames, 0) if self.still else f for f in films])
        if len(truth) > 1:
            truth[1] *= self.dim
        import pnp_sci

        masks = pnp_sci.moving_masks(truth.shape, seed=self.frames)
        return pnp_sci.simulate(truth, masks, self.noise), masks, truth


CASES = [
    *(Case("moving", pair) for pair in ((0, 1), (2, 3))),
    Case("moving", (7,), 8),
    Case("moving", (3, 6), 6),
    Case("moving", (5, 2), 14),
    Case("noise", (1, 4), noise=0.02),
    Case("noise", (6, 9), noise=0.1),
    Case("still", (0, 5), still=True),
    *(Case("scene", pair, still=s) for pair in ((0, 7), (2, 9)) for s in (False, True)),
    Case("scene", (3, 6), dim=0.2),
    Case("scene", (6, 1), dim=0.0),
]


def _crop(film, count):
    top, left = ((n - SIZE) // 2 for n in film.shape[1:])
    return (film[:count, top : top + SIZE, left : left + SIZE] / 255).astype(np.float32)


def validation_clips():
    """Frames of the validation clips; from the file PNP_SCI_VALIDATION if it is given, which saves the decoding."""
    file = os.environ.get("PNP_SCI_VALIDATION")
    if file:
        return list(np.load(file).values())
    from pnp_sci.training.clips import load_clips, split

    held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))[1]
    return [c.frames for c in held_out if len(c.frames) >= 14 and min(c.frames.shape[1:]) >= SIZE][:10]


def tuned_numbers():
    """All tuned numbers, ``{"module.name": value}``: fields of the classes `Tuned`, and options of priors."""
    from pnp_sci._tuned import Tuned

    for package in ("pnp_sci", "priors", "ofanet_init"):
        root = importlib.import_module(package)
        for module in pkgutil.walk_packages(root.__path__, f"{package}."):
            source = Path(importlib.util.find_spec(module.name).origin)
            if "(Tuned)" in source.read_text(encoding="utf-8"):
                importlib.import_module(module.name)
    found = {}
    for cls in sorted(Tuned.__subclasses__(), key=lambda cls: cls.__module__):
        tuned = importlib.import_module(cls.__module__).TUNED
        found |= {f"{cls.__module__}.{field.name}": getattr(tuned, field.name) for field in fields(tuned)}
    for path, names in OPTIONS.items():
        found |= {f"{path}.{name}": inspect.signature(_object(path)).parameters[name].default for name in names}
    return found


def _object(path):
    module, _, name = path.rpartition(".")
    return getattr(importlib.import_module(module), name)


def alternatives(name, value):
    """Alternative values of a number: half, double, and off if calibrate_off.json has it."""
    off = {"off": OFF[name]} if name in OFF else {}
    if isinstance(value, int):
        return {"half": max(value // 2, 1), "double": 2 * value} | off
    return {"half": value / 2, "double": 2 * value} | off


@contextmanager
def changed(name, value):
    """Context in which a tuned number has another value, and the defaults that are taken from it."""
    with ExitStack() as stack:
        for owner, _, field in (path.rpartition(".") for path in (name, *DEFAULTS.get(name, ())) if path):
            thing = _object(owner) if owner.rpartition(".")[2][:1].isupper() or owner in OPTIONS else None
            stack.enter_context(_default(thing, field, value) if thing else _field(owner, field, value))
        yield


@contextmanager
def _field(module, name, value):
    tuned = importlib.import_module(module).TUNED
    before = getattr(tuned, name)
    object.__setattr__(tuned, name, value)
    try:
        yield
    finally:
        object.__setattr__(tuned, name, before)


@contextmanager
def _default(thing, name, value):
    """Context in which an argument of a function or a class has another default."""
    function = thing.__init__ if inspect.isclass(thing) else thing
    positional, keywords = function.__defaults__ or (), function.__kwdefaults__
    names = [p for p, a in inspect.signature(function).parameters.items() if a.default is not a.empty]
    function.__defaults__ = tuple(value if n == name else d for n, d in zip(names, positional))
    function.__kwdefaults__ = keywords and {n: value if n == name else d for n, d in keywords.items()}
    try:
        yield
    finally:
        function.__defaults__, function.__kwdefaults__ = positional, keywords


_clips = []


def prepare():
    """Prepare a worker: one thread, and the validation clips."""
    import numba

    numba.set_num_threads(1)
    _clips.extend(validation_clips())


def measure(name, value, method, effort, case):
    """PSNR in dB, mean over the views, and seconds of the processor."""
    import pnp_sci

    y, masks, truth = case.load(_clips)
    with changed(name, value):
        begin = time.process_time()
        try:
            x = _solved(method, effort, case, y, masks)
        except (ValueError, ArithmeticError):  # a value that cannot be
            return float("nan"), float("nan")
        seconds = time.process_time() - begin
    return float(np.mean(np.minimum(pnp_sci.psnr(x, truth), 60))), seconds


def _solved(method, effort, case, y, masks):
    import pnp_sci

    if method.startswith("decode:"):
        return pnp_sci.decode(y, masks, method[7:], scene="full").x
    scene = "auto" if case.kind == "scene" else "full"
    return pnp_sci.solve(y, masks, method, effort=effort, scene=scene, threads=1).x


def tasks(names, values):
    """All measurements: (name, value, method, effort, case); the baselines, without a name, come first."""
    wanted = []
    for name in names:
        module = next(m for m in sorted(SERVES, key=len, reverse=True) if name.startswith(m + "."))
        methods, kinds = ONLY.get(name, SERVES[module][0]), SERVES[module][1]
        kinds = f"{kinds} {ALSO.get(name, '')}".split()
        effort = EFFORT.get(name, "balanced")
        for method in methods:
            for case in CASES:
                if case.kind in kinds:
                    wanted.append((None, None, method, effort, case))
                    wanted += [(name, v, method, effort, case) for v in alternatives(name, values[name]).values()]
    return sorted(dict.fromkeys(wanted), key=lambda task: task[0] is not None)


def sweep(names, values, jobs, log):
    """Measure all tasks that are not in `log` yet, and append them to it."""
    done = {}
    if log.is_file():
        for line in log.read_text().splitlines():
            *key, psnr, seconds = json.loads(line)
            done[json.dumps(key)] = psnr, seconds
    wanted = {json.dumps([n, v, m, e, CASES.index(c)]): (n, v, m, e, c) for n, v, m, e, c in tasks(names, values)}
    left = [task for key, task in wanted.items() if key not in done]
    prepare()
    for method in dict.fromkeys(task[2] for task in left):  # compiles once, before the workers start
        measure(None, None, method, "fast", CASES[0])
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=prepare) as pool, log.open("a") as file:
        futures = {pool.submit(measure, *task): key for key, task in zip(filter(lambda k: k not in done, wanted), left)}
        for future in as_completed(futures):
            if future.exception():
                pool.shutdown(cancel_futures=True)
            key = futures[future]
            done[key] = future.result()
            file.write(json.dumps([*json.loads(key), *done[key]]) + "\n")
            file.flush()
    return {key: done[key] for key in wanted}


def changes(name, value, measured):
    """For each alternative: value, mean and worst change of PSNR in dB, and ratio of processor seconds."""
    rows = {}
    for label, other in alternatives(name, value).items():
        psnr, seconds = [], []
        for key, (p, s) in measured.items():
            n, v, *rest = json.loads(key)
            if n == name and v == other:
                base, base_seconds = measured[json.dumps([None, None, *rest])]
                psnr.append(p - base)
                seconds.append(s / base_seconds)
        rows[label] = other, float(np.mean(psnr)), float(np.min(psnr)), float(np.median(seconds))
    return rows


def write(names, values, measured):
    """Write the rows of these numbers to their pages in docs/calibration."""
    PAGES.mkdir(parents=True, exist_ok=True)
    for module in dict.fromkeys(owner_of(name) for name in names):
        page = PAGES / f"{module}.md"
        rows = rows_of(page)
        for name in names:
            if owner_of(name) == module:
                cells = changes(name, values[name], measured)
                rows[name] = [as_text(values[name]), *(_cell(cells.get(label)) for label in ("half", "double", "off"))]
        known = [name for name in values if owner_of(name) == module]
        lines = [
            f"# {module}\n",
            f"Change of PSNR in dB on validation clips, mean (worst), and ratio of processor seconds, if one number of "
            f"`{module}` is halved, doubled or switched off. Made by `python benchmarks/calibrate.py {module}`.\n",
            "| number | value | half | double | off |",
            "| --- | --- | --- | --- | --- |",
            *(f"| `{name[len(module) + 1 :]}` | {' | '.join(rows[name])} |" for name in known if name in rows),
        ]
        page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def owner_of(name):
    """The module of a number, which may be an option of a prior."""
    owner = name.rpartition(".")[0]
    return owner.rpartition(".")[0] if owner in OPTIONS else owner


def rows_of(page):
    if not page.is_file():
        return {}
    module = page.stem
    lines = [line.strip("| \n").split(" | ") for line in page.read_text(encoding="utf-8").splitlines() if "| `" in line]
    return {f"{module}.{name.strip('`')}": cells for name, *cells in lines}


def as_text(value):
    return f"{value:.4g}"


def _cell(row):
    if row is None:
        return "-"
    other, mean, worst, seconds = row
    return (
        f"{as_text(other)}: {mean:+.3f} ({worst:+.2f}), {seconds:.2f}"
        if mean == mean
        else f"{as_text(other)}: cannot be"
    )


@click.command()
@click.argument("names", nargs=-1)
@click.option("--list", "listed", is_flag=True, help="Print all tuned numbers and how many there are.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--log", type=click.Path(path_type=Path), default=Path("runs/calibration.jsonl"), show_default=True)
def main(names, listed, jobs, log):
    """Sweep the numbers NAMES (modules or single numbers) and rewrite their tables in docs/calibration."""
    values = tuned_numbers()
    if listed:
        for name, value in values.items():
            click.echo(f"{name:60s} {as_text(value)}")
        click.echo(f"{len(values)} tuned numbers")
        return
    chosen = [name for name in values if not names or any(name == n or name.startswith(n + ".") for n in names)]
    log.parent.mkdir(parents=True, exist_ok=True)
    write(chosen, values, sweep(chosen, values, jobs, log))


if __name__ == "__main__":
    main()
