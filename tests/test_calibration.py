"""The tuned numbers of the code, and the tables that defend them, agree."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_spec = importlib.util.spec_from_file_location("calibrate", ROOT / "benchmarks" / "calibrate.py")
calibrate = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(calibrate)
NUMBERS = calibrate.tuned_numbers()


def rows():
    """{"module.name": [value, half, double, off]} of all tables."""
    pages = [page for page in calibrate.PAGES.glob("*.md") if page.name != "index.md"]
    return {name: cells for page in pages for name, cells in calibrate.rows_of(page).items()}


def test_there_are_at_most_seventy():
    assert 0 < len(NUMBERS) <= 70


def test_every_number_has_a_row_with_its_value():
    table = rows()
    assert set(table) == set(NUMBERS)
    for name, value in NUMBERS.items():
        assert table[name][0] == calibrate.as_text(value), name


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_is_changed_is_another_one_and_comes_back(name):
    before = NUMBERS[name]
    with calibrate.changed(name, 2 * before):
        assert calibrate.tuned_numbers()[name] == 2 * before
    assert calibrate.tuned_numbers()[name] == before


def test_what_switches_a_number_off_is_said_of_known_numbers():
    off = json.loads((ROOT / "benchmarks" / "calibrate_off.json").read_text())
    assert set(off) <= set(NUMBERS)
