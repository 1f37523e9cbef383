"""The widget of napari that solves a measurement in a thread of its own and adds the views as layers."""

from pathlib import Path
from typing import Any

from pnp_sci import io
from pnp_sci._optional import needed_for
from pnp_sci.api import solve
from pnp_sci.napari_plugin.reader import Layer, layers_of
from pnp_sci.plugins import registry
from pnp_sci.solvers.effort import EFFORTS


def recover(measurement: Path, masks: Path | None, prior: str, effort: str) -> list[Layer]:
    """The layers of what :func:`pnp_sci.solve` makes of two files; the masks may be in that of the measurement."""
    y = io.read_measurement(measurement)
    result = solve(y, io.read_masks(masks or measurement), prior, effort=effort)
    return layers_of(result, Path(measurement).stem)


def solve_widget() -> Any:
    """A form for measurement, masks, prior and effort; the button solves, and adds the layers when it is done."""
    with needed_for("the widget", "napari"):
        from magicgui import magicgui  # pyright: ignore[reportMissingImports]
        from napari import current_viewer  # pyright: ignore[reportMissingImports]
        from napari.qt.threading import create_worker  # pyright: ignore[reportMissingImports]
        from napari.utils.notifications import show_error  # pyright: ignore[reportMissingImports]

    def add(layers: list[Layer]) -> None:
        if (viewer := current_viewer()) is not None:
            for data, kept, _ in layers:
                viewer.add_image(data, **kept)

    @magicgui(
        call_button="Solve",
        prior={"choices": ["auto", *registry.available("priors")]},
        effort={"choices": list(EFFORTS)},
        masks={"nullable": True},
    )
    def form(
        measurement: Path = Path(), masks: Path | None = None, prior: str = "tv", effort: str = "balanced"
    ) -> None:
        form.call_button.enabled = False
        worker = create_worker(recover, measurement, masks, prior, effort)
        worker.returned.connect(add)
        worker.errored.connect(lambda error: show_error(str(error)))
        worker.finished.connect(lambda: setattr(form.call_button, "enabled", True))
        worker.start()

    return form
