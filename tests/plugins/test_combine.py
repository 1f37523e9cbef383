"""Priors made of others: means of several, one after the other, and who serves when."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_priors import Made, answering

import pnp_sci
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import FunctionPrior, Identity, InTurn, Joint, Stages, serving, turns
from pnp_sci.plugins.protocols import Traits
from pnp_sci.testing import check_prior

SHAPE = (1, 2, 4, 4)
FLOAT32 = np.dtype(np.float32)


def session_of(prior, shape=SHAPE):
    return prior.begin(shape, FLOAT32)


def zeros(shape=SHAPE):
    return np.zeros(shape, np.float32)


# ---- several at once -------------------------------------------------------------------------------------------------


def test_a_joint_prior_is_the_mean_of_its_members_by_their_shares():
    members = answering(0.4), answering(0.8), answering(0.1)
    assert np.allclose(session_of(Joint(members))(zeros(), 0.1), 1.3 / 3)
    shared = session_of(Joint(members, [2, 1, 1]))(zeros(), 0.1)
    assert np.allclose(shared, 1.7 / 4)
    assert shared.dtype == np.float32


def test_members_that_agree_are_the_mean_to_the_last_digit():
    x = np.random.default_rng(0).random(SHAPE, np.float32)
    joint = Joint([Made(lambda v, sigma: v * np.float32(0.3))] * 3, [3, 5, 1])
    assert np.array_equal(session_of(joint)(x, 0.1), x * np.float32(0.3))


def test_a_joint_prior_finishes_with_those_members_that_do():
    members = [answering(0, end=lambda x, sigma: x + sigma), answering(0), answering(0, end=lambda x, sigma: x)]
    finished = session_of(Joint(members, [3, 5, 1])).finish(1 + zeros(), 0.2)
    assert np.allclose(finished, 1 + 0.2 * 3 / 9)


def test_members_may_return_the_same_buffer():
    buffer = zeros()

    def into_buffer(factor):
        def call(v, sigma):
            np.multiply(v, np.float32(factor), out=buffer)
            return buffer

        return Made(call)

    mean = session_of(Joint([into_buffer(0.2), into_buffer(0.6)]))(1 + zeros(), 0.1)
    assert np.allclose(mean, 0.4)


@pytest.mark.parametrize("shares", [(1,), (1, 1, 1), (1, 0), (1, -1), (1, np.nan), (1, np.inf)])
def test_each_member_has_a_share_above_0(shares):
    with pytest.raises(InputError, match=r"shares is .*2 numbers > 0 were expected"):
        Joint([answering(0), answering(1)], shares)


def test_what_holds_for_a_member_holds_for_the_joint_prior():
    plain = answering(0)
    for known in ({"strong": True}, {"network": True}, {"average": True}, {"serves_below": 0.3}):
        joint = Joint([plain, answering(1, **known)])
        assert joint.traits(SHAPE) == Traits(**known)


@pytest.mark.parametrize("calls", [(3, 7), (7, 3), (7, 7)])
def test_the_longest_warm_up_of_a_member_serves_all(calls):
    warm = [answering(k) for k in range(2)]
    joint = Joint([answering(5, warmup=(w, n)) for w, n in zip(warm, calls)])
    order = turns(joint, SHAPE)
    assert [turn.begins for turn in order] == [0, 7]
    assert order[0].prior is warm[int(np.argmax(calls))]
    assert order[1].prior is joint
    session = InTurn(order, SHAPE, FLOAT32)
    answers = [float(session(zeros(), 0.1).max()) for _ in range(8)]
    assert answers == [float(np.argmax(calls))] * 7 + [5.0]


def test_a_joint_prior_merges_what_its_members_have_found():
    one, other = Made(found={"weights": ["a"]}), Made(found={"weights": ["b"], "still": [0.5]})
    assert session_of(Joint([one, other])).facts() == {"weights": ["a", "b"], "still": [0.5]}
    json.dumps(session_of(Joint([one, other])).facts())


@pytest.mark.parametrize("name", ["tv+wavelet", "bm3d+flow", "tv+flow"])
def test_classical_priors_together_are_no_network(name):
    assert not pnp_sci.as_prior(name).traits((2, 10, 64, 64)).network


# ---- one after the other ---------------------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 6), min_size=1, max_size=4))
def test_every_stage_serves_its_calls_and_the_last_one_all_that_follow(calls):
    stages = Stages([(answering(k), n) for k, n in enumerate(calls)])
    assert stages.calls == sum(calls)
    session = session_of(stages)
    answers = [int(session(zeros(), 0.1).max()) for _ in range(sum(calls) + 2)]
    assert answers == [k for k, n in enumerate(calls) for _ in range(n)] + [len(calls) - 1] * 2


def test_stages_finish_as_the_stage_that_has_served_last():
    ends = [Made(end=lambda x, sigma, k=k: 0 * x + k) for k in (1, 2)]
    session = session_of(Stages([(ends[0], 2), (ends[1], 2)]))
    for served in (1, 1, 2, 2, 2):
        session(zeros(), 0.1)
        assert session.finish(zeros(), 0.1).max() == served


def test_stages_keep_averaging():
    """Each stage as its prior asks: only the calls of the one that asks are averaged."""
    order = turns(Stages([(answering(0), 3), (answering(1, average=True), 3), (answering(2), 3)]), SHAPE)
    assert [turn.average for turn in order] == [False, True, False]


def test_the_warm_up_of_the_first_stage_is_part_of_its_calls_and_a_later_stage_has_none():
    warmed = answering(1, warmup=(answering(0), 4), average=True)
    first = turns(Stages([(warmed, 6), (answering(2), 3)]), SHAPE)
    assert [(turn.begins, turn.average) for turn in first] == [(0, False), (4, True), (6, False)]
    later = turns(Stages([(answering(2), 3), (warmed, 6)]), SHAPE)
    assert [turn.begins for turn in later] == [0, 3]
    assert later[1].prior is warmed


def test_a_prior_whose_stage_ends_within_its_warm_up_has_no_turn():
    warmed = answering(1, warmup=(answering(0), 4))
    order = turns(Stages([(warmed, 2), (answering(2), 3)]), SHAPE)
    assert [(int(turn.prior.call(zeros(), 0).max()), turn.begins) for turn in order] == [(0, 0), (2, 2)]


@pytest.mark.parametrize("first", [True, False])
def test_stages_within_stages(first):
    inner, other = (Stages([(answering(0), 2), (answering(1), 1)]), 3), (answering(2), 1)
    stages, expected = ([inner, other], [0, 0, 1, 2, 2]) if first else ([other, inner], [2, 0, 0, 1, 1])
    session = InTurn(turns(Stages(stages), SHAPE), SHAPE, FLOAT32)
    assert [int(session(zeros(), 0.1).max()) for _ in range(5)] == expected


# ---- whose turn it is ------------------------------------------------------------------------------------------------


def test_above_its_sigma_a_prior_waits():
    order = turns(answering(1, warmup=(answering(0), 2), serves_below=0.2), SHAPE)
    session = InTurn(order, SHAPE, FLOAT32)
    sigmas = [0.1, 0.1, 0.3, 0.21, 0.2, 0.3, 0.1]
    assert [serving(order, call, sigma) for call, sigma in enumerate(sigmas)] == [0, 0, 0, 0, 1, 0, 1]
    assert [int(session(zeros(), sigma).max()) for sigma in sigmas] == [0, 0, 0, 0, 1, 0, 1]


def test_a_warm_up_of_no_calls_is_none():
    prior = answering(1, warmup=(answering(0), 0), average=True)
    (turn,) = turns(prior, SHAPE)
    assert (turn.prior, turn.begins, turn.average) == (prior, 0, True)


def test_a_prior_that_cannot_begin_is_told_before_the_first_call():
    class Broken(Made):
        def begin(self, shape, dtype):
            raise InputError("weights is 'nowhere': a file was expected")

    with pytest.raises(InputError, match="weights"):
        InTurn(turns(Broken(known=Traits(warmup=(Identity(), 30))), SHAPE), SHAPE, FLOAT32)


@pytest.mark.parametrize("prior", [pytest.param(p, id=type(p).__name__) for p in (
    Identity(), FunctionPrior(lambda x, sigma: x / (1 + sigma)),
    Joint([Identity(), FunctionPrior(lambda x, sigma: x / 2)], [3, 1]),
    Stages([(Identity(), 2), (FunctionPrior(lambda x, sigma: x / 2), 1)]),
)])  # fmt: skip
def test_combinations_keep_the_promises_of_a_prior(prior):
    check_prior(prior)
