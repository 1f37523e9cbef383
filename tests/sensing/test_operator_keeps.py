"""An operator keeps its own masks: the caller's array may be written to. It stands for them where masks are taken."""

import numpy as np
import pytest

from pnp_sci import SensingOperator, condition, simulate
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import as_masks
from pnp_sci.sensing.sequence import SequenceOperator


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.float32, np.float64])
def test_the_callers_array_may_be_filled_anew(dtype):
    rng = np.random.default_rng(0)
    buffer = (rng.random((2, 3, 8, 8)) < 0.5).astype(dtype)
    op, y = SensingOperator(buffer), rng.random((8, 8))
    before = op.forward(np.ones(op.shape))
    buffer[:] = 1 - buffer.astype(int)
    np.testing.assert_array_equal(op.forward(np.ones(op.shape)), before)
    y = before * 0.3
    x = op.project(np.zeros(op.shape), y)
    np.testing.assert_allclose(op.forward(x), y, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("dtype", [bool, np.float32, np.float64])
def test_an_operator_stands_for_its_masks(dtype):
    rng = np.random.default_rng(0)
    masks, x = (rng.random((2, 3, 8, 8)) < 0.5).astype(dtype), rng.random((2, 3, 8, 8))
    op = SensingOperator(masks, np.float64)
    assert as_masks(op) is op.masks
    assert condition(op) == condition(op.masks)
    np.testing.assert_array_equal(simulate(x, op), op.forward(x))
    again = SensingOperator(op)
    assert (again.masks.dtype, again.dtype) == (op.masks.dtype, op.dtype)
    assert SensingOperator(op, np.float32).dtype == np.float32


def test_an_operator_of_several_measurements_has_no_masks_for_all():
    part = SensingOperator(np.ones((1, 2, 4, 4)))
    with pytest.raises(InputError, match=r"masks has shape \(2, 1, 2, 4, 4\)"):
        as_masks(SequenceOperator([part, part]))
