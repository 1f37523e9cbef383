"""Storage of benchmark rows as JSON, and as a CSV table for other software."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict
from pathlib import Path

from filelock import FileLock

from pnp_sci.bench.cases import Case
from pnp_sci.bench.methods import Method
from pnp_sci.bench.runner import Row
from pnp_sci.errors import FormatError
from pnp_sci.formats.replacing import replacing

COLUMNS = (
    "case", "noise", "frames", "masks", "views", "key", "masks_key", "reference_key",
    "prior", "init", "algorithm", "effort", "limit",
)  # fmt: skip


class Results:
    """Rows in a JSON file that is written after each row, so that a run can be continued.

    A file ``results.csv`` beside ``results.json`` has a line for each case, method and checkpoint. Several processes
    may add rows to the same file.

    Parameters
    ----------
    path : path
        The JSON file; its rows are read if it exists.

    Raises
    ------
    FormatError
        If the file has another content.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._lock = FileLock(self.path.with_name(f".{self.path.name[:60]}.lock"))
        self.rows: list[Row] = []
        self._read()
        if self.rows and not self.path.with_suffix(".csv").exists():
            self._write()

    def find(self, case: Case, method: Method, repeat: int = 1) -> Row | None:
        """The row of this case and method, or None; not one of fewer timings, or of a file with other content."""
        row = next((row for row in self.rows if (row.case, row.method) == (case, method)), None)
        if row is None or len(row.seconds) < repeat or not case.has(row.settings):
            return None
        return row

    def add(self, row: Row) -> None:
        """Store a row in both files; it replaces a row of the same case and method."""
        with self._lock:
            self._read()
            self.rows = [r for r in self.rows if (r.case, r.method) != (row.case, row.method)] + [row]
            self._write()

    def _read(self) -> None:
        self.rows = read(self.path) if self.path.exists() else []

    def _write(self) -> None:
        lines = ",\n".join(json.dumps(asdict(row)) for row in self.rows)
        with replacing(self.path.with_suffix(".csv")) as temporary:
            self._tabulate(temporary)
        with replacing(self.path) as temporary:
            temporary.write_text(f'{{"rows": [\n{lines}\n]}}\n', encoding="utf-8")

    def _tabulate(self, path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
            table = csv.writer(file)
            table.writerow([*COLUMNS, "iteration", "seconds", "psnr", "residual", "ssim", "peak_mib", "status"])
            for row in self.rows:
                what = (*asdict(row.case).values(), *asdict(row.method).values())
                ssim = sum(row.ssim) / len(row.ssim) if row.ssim else None
                for point in row.course:
                    of_all = (ssim, row.peak_mib, row.status) if point is row.course[-1] else (None,) * 3
                    table.writerow([*what, *asdict(point).values(), *of_all])


def read(path: str | Path) -> list[Row]:
    """Read the rows of a file of :class:`Results`; raises a FormatError for other content."""
    try:
        return [Row.from_dict(row) for row in json.loads(Path(path).read_text(encoding="utf-8"))["rows"]]
    except (ValueError, KeyError, TypeError) as error:
        why = f"{type(error).__name__}: {error}"  # of an error in text, repr would show all bytes of the file
        raise FormatError(f"{path} holds no results of `pnp-sci bench`: {why}") from error
