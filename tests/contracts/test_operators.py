"""Every operator keeps the promises of an operator."""

import numpy as np
import pytest
from operators_and_priors import OPERATORS

from pnp_sci import SensingOperator
from pnp_sci.testing import check_operator


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("masks", OPERATORS.values(), ids=OPERATORS)
def test_operators_keep_their_promises(masks, dtype):
    check_operator(SensingOperator(masks, dtype))
