"""The operator of consecutive measurements: each sees its own frames, through the same masks or its own."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from operators_and_priors import OPERATORS

import pnp_sci
from pnp_sci import SensingOperator, SequenceOperator
from pnp_sci.errors import InputError
from pnp_sci.sensing.sequence import joined, split
from pnp_sci.testing import check_operator


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("masks", OPERATORS.values(), ids=OPERATORS)
def test_it_keeps_the_promises_of_an_operator(masks, dtype):
    part, other = SensingOperator(masks, dtype), SensingOperator(masks[:, ::-1], dtype)
    check_operator(SequenceOperator([part, other, part]))


@given(seed=st.integers(0, 99), views=st.integers(1, 3), frames=st.integers(1, 4), count=st.integers(1, 4))
def test_each_picture_is_the_sum_over_its_own_frames(seed, views, frames, count):
    random = np.random.default_rng(seed)
    masks = random.standard_normal((count, views, frames, 3, 4))
    x = random.standard_normal((views, count * frames, 3, 4))
    y = SequenceOperator([SensingOperator(m) for m in masks]).forward(x)
    for n in range(count):
        of_n = x[:, n * frames : (n + 1) * frames]
        np.testing.assert_allclose(y[n], (masks[n] * of_n).sum((0, 1)), atol=1e-12)


def test_rho_may_differ_between_measurements():
    random = np.random.default_rng(0)
    parts = [SensingOperator(random.random((2, 3, 4, 5))) for _ in range(2)]
    x, y, rho = random.random((2, 6, 4, 5)), random.random((2, 4, 5)), random.random((2, 4, 5))
    projected = SequenceOperator(parts).project(x, y, rho)
    alone = [part.project(v, m, r) for part, v, m, r in zip(parts, split(x, 2), y, rho)]
    np.testing.assert_array_equal(projected, joined(alone))


def test_parts_must_be_alike():
    with pytest.raises(InputError, match="parts has operators of 2 shapes"):
        SequenceOperator([SensingOperator(np.ones((1, 2, 4, 4))), SensingOperator(np.ones((1, 3, 4, 4)))])


def test_it_can_be_iterated():
    """Without a prior the iterates explain every measurement."""
    scene = pnp_sci.datasets.embedded_scene(32)
    op = SequenceOperator([SensingOperator(scene.masks)] * 2)
    y = np.stack([scene.y, scene.y[::-1]])
    for algorithm in ("gap", "plain-gap", "admm"):
        course = pnp_sci.iterate(op, y, "none", np.zeros(op.shape), algorithm=algorithm)
        last = list(itertools.islice(course, 4))[-1]
        assert np.abs(last.residual).max() < 1e-3 * y.max()
