"""Why a run stopped, and the record of its course."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_result import RECORDS, make

from pnp_sci.errors import InputError, SolverError
from pnp_sci.results.history import History, Record, Status


def test_only_numerical_failures_are_not_ok():
    assert {status for status in Status if not status.ok} == {Status.DIVERGED, Status.NOT_FINITE}


@pytest.mark.parametrize("status", Status)
def test_raise_for_status_raises_exactly_for_failures(status):
    result = make(status=status)
    if status.ok:
        result.raise_for_status()
    else:
        with pytest.raises(SolverError, match=status.value):
            result.raise_for_status()


@given(st.lists(st.sampled_from(list(Status)), min_size=1))
def test_a_failure_among_many_is_the_worst(statuses):
    worst = Status.worst(statuses)
    assert worst in statuses
    assert worst.ok == all(status.ok for status in statuses)


numbers = st.floats(allow_nan=False)
records = st.builds(
    Record,
    st.integers(0, 10**6),
    numbers,
    numbers,
    numbers,
    st.none() | numbers,
    st.none() | numbers,
    st.integers(0, 99),
)


@given(st.lists(records, max_size=5))
def test_a_table_keeps_the_history(rows):
    history = History(rows)
    assert History.from_table(history.table()) == history
    assert history.table().shape == (len(rows), 7)


def test_history_is_a_sequence_of_records_and_a_table_of_columns():
    history = History(RECORDS)
    assert list(history) == RECORDS
    assert history[-1] is RECORDS[-1]
    assert history[1:] == History(RECORDS[1:])
    assert history["residual"].tolist() == [0.25, 0.125]
    assert np.isnan(history["ssim"]).tolist() == [True, False]
    with pytest.raises(InputError, match=r"'resid'.*residual, sigma"):
        history["resid"]
    with pytest.raises(TypeError):
        history[0] = RECORDS[1]
