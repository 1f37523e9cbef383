"""Time budgets: what cannot be finished is not begun, and after a decoder there is no warm-up."""

import time
from dataclasses import replace

import numpy as np
import pytest
from made_priors import Made

import pnp_sci
from pnp_sci import SensingOperator, Status, Traits, datasets, register_decoder, solve
from pnp_sci.sensing.scene_model import full
from pnp_sci.solvers import pace as paces
from pnp_sci.solvers.backend import NUMBA
from pnp_sci.solvers.plan import Pace, make_plan
from pnp_sci.solvers.stopping import Stopping

WARM = Traits(strong=True, warmup=(Made(), 4))


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def solved(prior, **options):
    scene = datasets.embedded_scene(64)
    return solve(scene.y, scene.masks, prior, scene="full", iterations=30, tol=0, **options)


def sleeping(seconds, **known):
    return Made(lambda v, sigma: (time.sleep(seconds), v)[1], known=Traits(strong=True, **known))


def test_a_strong_prior_that_would_miss_the_deadline_is_not_begun():
    """Each of its calls takes longer than the whole budget, warm-up calls none."""
    slow = sleeping(0.7, warmup=(Made(), 4))
    scene = datasets.embedded_scene(64)
    paces.pace(slow, SensingOperator(scene.masks), scene.y, 9, NUMBA)  # tried before
    result = solved(slow, init="adjoint", time_budget=0.6)
    assert result.status is Status.TIME_BUDGET
    assert result.history[-1].iteration == 4


@pytest.mark.parametrize(("left", "stops"), [(3.5, False), (2.5, True)])
def test_time_for_the_next_prior_and_its_finish_must_be_left(left, stops):
    made = make_plan(SensingOperator(np.ones((1, 1, 2, 2))), 0.0, Made(known=WARM), tol=0.0)
    made = replace(made, deadline=time.perf_counter() + left, paces=(Pace(0.1, 0.1), Pace(2.0, 0.5, 1.0)))
    stopping = Stopping(made, 2.0)
    state = next(
        pnp_sci.iterate(SensingOperator(np.ones((1, 1, 2, 2))), np.ones((2, 2)), "none", np.ones((1, 1, 2, 2)))
    )
    found = [stopping.reason(replace(state, iteration=n), 0.1, True) for n in range(5)]
    assert found[:4] == [None] * 4
    assert (found[4] is Status.TIME_BUDGET) == stops


def test_after_a_decoder_there_is_no_warm_up():
    """With a deadline or without; the strong prior has as many calls."""
    for deadline in (None, time.perf_counter() + 60):
        op, prior = SensingOperator(np.ones((1, 1, 2, 2))), Made(known=WARM)
        cold, warm = (make_plan(op, 0.0, prior, decoded=decoded, deadline=deadline) for decoded in (False, True))
        assert [turn.begins for turn in warm.serves] == [0]
        assert [turn.begins for turn in cold.serves] == [0, 4]
        assert warm.iterations == cold.iterations - 4
        assert warm.describe()["sigma"] == cold.describe()["sigma"]


def test_a_decoders_estimate_is_not_spoilt_by_a_warm_up(scene):
    register_decoder("truth", lambda: lambda problem, model: (scene.truth / problem.unit).astype(np.float32))
    prior = Made(known=Traits(strong=True, warmup=(Made(lambda v, sigma: 0 * v), 3)))
    for iterations in (1, 5):
        result = solve(scene.y, scene.masks, prior, init="truth", iterations=iterations, scene="full", tol=0)
        assert np.allclose(result.x, scene.truth, atol=1e-5)
        assert len(result.history) == iterations + 1


def test_a_decoder_that_would_miss_the_deadline_gives_way_and_it_is_said(scene):
    def slow(problem, model):
        time.sleep(0.4)
        return np.ones(problem.op.shape, np.float32)

    register_decoder("slow", lambda: slow)
    solve(scene.y, scene.masks, init="slow", iterations=1)
    solve(scene.y, scene.masks, init="slow", iterations=1)  # a warm run, whose time counts
    result = solved("tv", init="slow", time_budget=0.3)
    assert result.settings["init"] == "adjoint"
    assert any("init: 'slow'" in remark for remark in result.remarks)
    assert solved("tv", init="slow", time_budget=60.0).settings["init"] == "slow"


def test_the_judge_of_scenes_ends_an_estimate_in_time(scene):
    from pnp_sci.scene.judge import _Pixels

    op, seen = SensingOperator(scene.masks), np.ones(scene.y.shape, bool)
    pixels = _Pixels(op, scene.y, seen, ~seen, 0.0, until=0.0)
    with pytest.raises(TimeoutError):
        next(pixels.estimates(full(op), pnp_sci.as_prior("tv"), 50))
