"""The operator of consecutive measurements: each sees its own frames, through the same masks or its own."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from operators_and_priors import OPERATORS

import pnp_sci
from pnp_sci import SensingOperator, SequenceOperator
from pnp_sci.errors import InputError, InputTypeError
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


def test_it_is_an_operator_everywhere():
    """For scipy's solvers, and instead of masks."""
    random = np.random.default_rng(0)
    op = SequenceOperator([SensingOperator(random.random((2, 3, 8, 8))) for _ in range(3)])
    linear, x, y = op.linear_operator(), random.random(op.shape), random.random(op.pictures)
    np.testing.assert_allclose(linear.matvec(x.ravel()), op.forward(x).ravel())
    np.testing.assert_allclose(linear.rmatvec(y.ravel()), op.adjoint(y).ravel())
    by_masks, by_op = (pnp_sci.solve(y, masks, iterations=3) for masks in (op.masks, op))
    np.testing.assert_array_equal(by_masks.x, by_op.x)
    with pytest.raises(InputTypeError, match="parts has ndarray"):
        SequenceOperator(op.masks)
