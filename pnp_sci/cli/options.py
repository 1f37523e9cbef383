"""Options that several commands of ``pnp-sci`` have, and what they stand for."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci.cli.kinds import FILE, POSITIVE
from pnp_sci.errors import InputError

if TYPE_CHECKING:
    from pnp_sci.sensing.sensor import Sensor

OF_SOLVE = {"scene", "sigma", "tol", "threads"}  # arguments of `solve` that --option takes, unless a command has them


def interactive() -> bool:
    """Whether somebody watches: only then progress is shown."""
    return sys.stderr is not None and sys.stderr.isatty()


def _several(*options: Callable) -> Callable[[Callable], Callable]:
    """A decorator that gives a command all of these options, in this order."""
    return lambda command: reduce(lambda decorated, option: option(decorated), reversed(options), command)


# Files of the measurement and of its masks.
file_options = _several(
    click.option("--masks", "masks_file", type=FILE, help="File with the masks.  [default: the measurement's]"),
    click.option("--calibration", type=FILE, help="File of `pnp-sci calibrate`: masks, dark frame, bad pixels."),
    click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of the masks."),
    click.option("--key", help="Name of the measurement in its file, where it cannot be told."),
    click.option("--masks-key", help="Name of the masks in their file, where it cannot be told."),
)

# Options of `solve`.
solver_options = _several(
    click.option("--prior", default="tv", show_default=True, help="One of `pnp-sci priors`, a+b, or stages a:60,b:20."),
    click.option("--algorithm", default="gap", show_default=True, help="gap, plain-gap or admm."),
    click.option(
        "--init", default="auto", show_default=True, help="First estimate; auto: a network's for learned priors."
    ),
    click.option("--effort", default="balanced", show_default=True, help="fast, balanced or best."),
    click.option("--iterations", type=click.IntRange(min=1), help="At most so many."),
    click.option(
        "--option",
        "options",
        multiple=True,
        metavar="KEY=VALUE",
        help="Option of the prior, or scene, sigma or tol of solve; may be repeated.",
    ),
)

# What `bench.grid` combines, but the priors, whose default differs.
grid_options = _several(
    click.option("--inits", default="auto", show_default=True, help="Comma-separated first estimates."),
    click.option("--algorithms", default="gap", show_default=True, help="Comma-separated: gap, plain-gap, admm."),
    click.option("--efforts", default="balanced", show_default=True, help="Comma-separated: fast, balanced, best."),
    click.option("--decoders", default="", help="Comma-separated networks that decode alone."),
    click.option("--iterations", type=click.IntRange(min=1), help="At most so many.  [default: as the effort says]"),
)

# What `camera` and `bad_pixels` take.
camera_options = _several(
    click.option(
        "--noise",
        default="auto",
        show_default=True,
        help="Standard deviation of the noise, with --gain of that in the dark, in units of y; or auto.",
    ),
    click.option("--gain", type=POSITIVE, help="Units of y an electron, for photon noise.  [default: none]"),
    click.option("--full-scale", type=POSITIVE, help="The camera's largest value: pixels there are saturated."),
    click.option("--bits", type=click.IntRange(1, 32), help="Grey levels of the camera, up to --full-scale."),
    click.option(
        "--bad",
        metavar="FILE|auto",
        help="Picture that is not 0 in bad pixels, which are not used; or auto: hot, dead and stuck ones are found.",
    ),
    click.option("--bad-key", help="Name of the picture in the file of --bad, where it cannot be told."),
)


def camera(
    noise: str, gain: float | None, full_scale: float | None, bits: int | None, black_level: float = 0.0
) -> str | float | Sensor:
    """What the options of the camera stand for: the `noise` of :func:`pnp_sci.solve`."""
    try:
        level = noise if noise == "auto" else float(noise)
    except ValueError:
        raise click.BadParameter(f"{noise!r} came, auto or a number was expected", param_hint="--noise") from None
    if (gain, full_scale, bits) == (None, None, None):
        return level
    from pnp_sci.sensing.sensor import Sensor

    try:
        return Sensor(level, gain or 0.0, full_scale, bits, black_level)  # type: ignore[arg-type]
    except InputError as error:
        raise click.BadParameter(str(error), param_hint="--noise, --gain, --full-scale, --bits") from error


def bad_pixels(bad: str | None, key: str | None) -> Any:
    """What ``--bad`` and ``--bad-key`` stand for: the `bad` of :func:`pnp_sci.solve`."""
    if bad is None or bad == "auto":
        if key is not None:
            raise click.BadParameter(f"{key!r} came, but no file: --bad FILE was expected", param_hint="--bad-key")
        return bad
    if not Path(bad).is_file():
        raise click.BadParameter(f"{bad!r} came, a file or auto was expected", param_hint="--bad")
    from pnp_sci import io

    return io.read_bad(bad, key)


def pairs(options: tuple[str, ...]) -> dict[str, Any]:
    """``("inner=5", "mode=iso")`` -> ``{"inner": 5, "mode": "iso"}``."""
    from pnp_sci import api

    found, own = {}, click.get_current_context().params.keys()
    taken = own | (inspect.signature(api.solve).parameters.keys() - OF_SOLVE)
    for option in options:
        key, separator, value = option.partition("=")
        if not separator or not key.isidentifier():
            raise click.BadParameter(f"{option!r} came, KEY=VALUE was expected", param_hint="--option")
        if key in taken:
            expected = f"an option of the prior, or one of {', '.join(sorted(OF_SOLVE - own))}"
            raise click.BadParameter(f"{key!r} came, {expected} was expected", param_hint="--option")
        try:
            found[key] = json.loads(value)
        except json.JSONDecodeError:
            found[key] = value
    return found


def words(text: str) -> list[str]:
    """``"tv,flow"`` -> ``["tv", "flow"]``; none of ``""``."""
    return [word for word in text.split(",") if word]


def stages(text: str) -> str | list[tuple[str, int]]:
    """``"tv:60,wavelet:20"`` -> stages; anything else is a name."""
    if ":" not in text:
        return text
    parts = [stage.partition(":")[::2] for stage in text.split(",")]
    if not all(name and count.isdigit() for name, count in parts):
        raise click.BadParameter(f"{text!r} came, NAME:ITERATIONS,... was expected", param_hint="--prior")
    return [(name, int(count)) for name, count in parts]
