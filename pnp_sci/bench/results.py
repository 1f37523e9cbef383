"""Storage of benchmark rows as JSON, and as a CSV table for other software."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict
from pathlib import Path

from pnp_sci.bench.cases import Case
from pnp_sci.bench.methods import Method
from pnp_sci.bench.runner import Row
from pnp_sci.errors import FormatError
from pnp_sci.formats.replacing import replacing

COLUMNS = ("case", "noise", "frames", "prior", "init", "algorithm", "effort", "limit")  # first columns


class Results:
    """Rows in a JSON file that is written after each row, so that a run can be continued.

    A file ``results.csv`` beside ``results.json`` has a line for each case, method and checkpoint.

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
        self.rows: list[Row] = read(self.path) if self.path.exists() else []

    def find(self, case: Case, method: Method) -> Row | None:
        """The row of this case and method, or None."""
        return next((row for row in self.rows if (row.case, row.method) == (case, method)), None)

    def add(self, row: Row) -> None:
        """Store a row in both files; it replaces a row of the same case and method."""
        self.rows = [r for r in self.rows if (r.case, r.method) != (row.case, row.method)] + [row]
        lines = ",\n".join(json.dumps(asdict(row)) for row in self.rows)
        with replacing(self.path) as temporary:
            temporary.write_text(f'{{"rows": [\n{lines}\n]}}\n', encoding="utf-8")
        with replacing(self.path.with_suffix(".csv")) as temporary:
            self._tabulate(temporary)

    def _tabulate(self, path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
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
        raise FormatError(f"{path} holds no results of `pnp-sci bench`: {error!r}") from error
