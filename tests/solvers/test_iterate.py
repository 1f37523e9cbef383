"""The iterates of a solver, to be taken one by one."""

import itertools

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SensingOperator, datasets
from pnp_sci.errors import InputError
from pnp_sci.sensing.problem import level
from pnp_sci.solvers.iterate import ALGORITHMS
from priors.flow import Flow
from priors.tv import TV


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(48)


def first(count, *arguments, **options):
    return list(itertools.islice(pnp_sci.iterate(*arguments, **options), count))


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS))
def test_iterates_stay_as_they_were(scene, algorithm):
    op, copies = SensingOperator(scene.masks), []
    states = []
    for state in pnp_sci.iterate(op, scene.y, "tv", np.zeros(op.shape, np.float32), algorithm=algorithm):
        states.append(state)
        copies.append([a.copy() for a in (state.x, state.residual, state.dual)])
        if state.iteration == 4:
            break
    for state, copy in zip(states, copies):
        assert all(np.array_equal(a, b) for a, b in zip((state.x, state.residual, state.dual), copy))


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS))
def test_the_memory_order_of_y_does_not_matter(scene, algorithm):
    op = SensingOperator(scene.masks)
    ends = [
        first(6, op, y, TV(), level(op, scene.y), algorithm=algorithm, noise=0.1)[-1].x
        for y in (scene.y, np.asfortranarray(scene.y))
    ]
    assert np.array_equal(*ends)


def test_the_first_state_is_the_first_estimate(scene):
    op, x = SensingOperator(scene.masks), np.full(scene.masks.shape, 0.5, np.float32)
    (state,) = first(1, op, scene.y, "none", x)
    assert state.iteration == 0
    assert np.array_equal(state.x, x)
    np.testing.assert_allclose(state.residual, scene.y - op.forward(x), rtol=1e-6)


def test_names_objects_and_stages_are_priors_here_too(scene):
    op = SensingOperator(scene.masks)
    start = level(op, scene.y)
    named, made, staged = (first(4, op, scene.y, p, start)[-1].x for p in ("tv", TV(), [("tv", 1), ("tv", 1)]))
    assert np.array_equal(named, made)
    assert not np.array_equal(named, staged), "the second stage has a session of its own"


def test_a_warm_up_serves_here_too(scene):
    op = SensingOperator(scene.masks)
    start = level(op, scene.y)
    warming, tv = (first(4, op, scene.y, p, start)[-1].x for p in (Flow(first=3), TV()))
    assert np.array_equal(warming, tv)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "no such"}, "algorithm is 'no such'"),
        ({"prior": lambda x, sigma: x[0]}, "what the prior returns has shape"),
    ],
)
def test_errors_name_the_argument(scene, change, message):
    op = SensingOperator(scene.masks)
    given = {"op": op, "y": scene.y, "prior": "none", "x": level(op, scene.y)} | change
    with pytest.raises(InputError, match=message):
        first(2, **given)
