"""Progress bars, one over the iterations of all measurements, and the caller's own callback."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from pnp_sci.errors import InputTypeError
from pnp_sci.results.history import Record
from pnp_sci.solvers.state import State


def bar(iterable: Iterable | None = None, *, shown: bool = True, **options: Any) -> Any:
    """A bar of tqdm; it shows nothing if not `shown`, or if the process has no stderr, as a daemon."""
    from tqdm.auto import tqdm

    return tqdm(iterable, disable=not shown or sys.stderr is None, **options)


class Watch:
    """Called with every iterate: moves the bar, if any, and asks the callback whether to stop."""

    def __init__(self, callback: Callable[[State], Any] | None, bar: Any = None):
        self.callback, self.bar, self.stopped = callback, bar, False

    def expect(self, iterations: int) -> None:
        """So many more iterations may come."""
        if self.bar is not None:
            self.bar.total = (self.bar.total or 0) + iterations

    def __call__(self, state: State, record: Record) -> bool:
        """Whether the callback asks to stop."""
        if self.bar is not None and record.iteration:
            self.bar.set_postfix_str(f"residual {record.residual:.4f}", refresh=False)
            self.bar.update()
        if self.callback and not self.stopped:
            answer = self.callback(state)
            try:
                self.stopped = bool(answer)
            except Exception as error:  # arrays of any library
                kind = type(answer).__name__
                raise InputTypeError(f"callback returns {kind}: None, True or False was expected") from error
        return self.stopped


@contextmanager
def watching(callback: Callable[[State], Any] | None, shown: bool) -> Iterator[Watch]:
    """A watch; nothing is shown, or loaded for that, if not `shown`."""
    if not shown:
        yield Watch(callback)
        return
    with bar(unit="it", leave=False) as shown_bar:
        yield Watch(callback, shown_bar)
