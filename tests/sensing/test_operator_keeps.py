"""An operator keeps its own masks: the caller's array may be written to."""

import numpy as np
import pytest

from pnp_sci import SensingOperator


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
