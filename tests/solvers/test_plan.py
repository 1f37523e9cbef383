"""What is decided before the first iteration, once, and that the solver keeps to it."""

import json

import numpy as np
import pytest
from made_priors import Made, answering

import pnp_sci
from pnp_sci import SensingOperator, Traits, datasets, solve
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import Joint, Stages
from pnp_sci.solvers.plan import make_plan
from priors.flow import Flow
from priors.tv import TV


def operator(views=2, frames=10, side=24):
    return SensingOperator(pnp_sci.random_masks((views, frames, side, side), seed=1))


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(32)


def iterations(effort="balanced", prior=None, noise=0.0, op=None, **options):
    return make_plan(op or operator(), noise, prior or Made(), effort=effort, **options).iterations


# ---- how many --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("warmup", [None, (Made(), 12)])
def test_more_effort_is_more_iterations_and_strong_priors_need_fewer(warmup):
    strong = Made(known=Traits(strong=True, warmup=warmup))
    plain = [iterations(effort) for effort in ("fast", "balanced", "best")]
    fewer = [iterations(effort, strong) for effort in ("fast", "balanced", "best")]
    assert plain == sorted(plain)
    assert fewer == sorted(fewer)
    assert plain[0] < plain[1] < plain[2]
    assert all(few <= many for few, many in zip(fewer, plain))
    assert fewer[0] > (warmup[1] if warmup else 0)


@pytest.mark.parametrize("strong", [False, True])
def test_a_prior_has_the_calls_of_an_effort_after_its_warm_up(strong):
    warmed, alone = (Made(known=Traits(strong=strong, warmup=warmup)) for warmup in ((Made(), 12), None))
    for effort in ("fast", "balanced", "best"):
        assert iterations(effort, warmed) == 12 + iterations(effort, alone)
        assert iterations(effort, warmed, decoded=True) == iterations(effort, alone)


def test_a_joint_prior_is_strong_where_a_member_is():
    strong = Made(known=Traits(strong=True))
    for effort in ("fast", "balanced", "best"):
        assert iterations(effort, Joint([Made(), strong])) == iterations(effort, strong)


def test_few_frames_and_many_frames_get_more_calls():
    strong = Made(known=Traits(strong=True))
    few, many = ((1, 1), (1, 8), (2, 6), (1, 16), (2, 10)), ((2, 10), (2, 14), (2, 20), (2, 100))
    for effort in ("fast", "balanced", "best"):
        falling = [iterations(effort, strong, op=operator(*size, side=8)) for size in few]
        rising = [iterations(effort, strong, op=operator(*size, side=8)) for size in many]
        assert falling == sorted(falling, reverse=True)
        assert rising == sorted(rising)
        assert falling[0] == rising[-1], "but not without end"
        assert (rising[0] < rising[-1]) == (effort == "balanced")


def test_noise_takes_iterations_of_a_strong_prior_away():
    strong = Made(known=Traits(strong=True, warmup=(Made(), 12)))
    counts = [iterations("best", strong, noise) for noise in (0.0, 0.3, 3.0)]
    assert counts == sorted(counts, reverse=True)
    assert 12 < counts[-1] < counts[0]


def test_given_iterations_and_those_of_stages_are_kept():
    stages = Stages([(Made(), 7), (Made(known=Traits(strong=True)), 4)])
    assert iterations(prior=stages) == 11
    assert iterations(prior=stages, iterations=5) == 5
    assert iterations(iterations=3) == 3


# ---- which prior when ------------------------------------------------------------------------------------------------


def test_warm_up_and_prior_take_turns():
    plan = make_plan(operator(side=32), 0.0, Flow(first=9))
    assert [(type(turn.prior), turn.begins) for turn in plan.serves] == [(TV, 0), (Flow, 9)]
    assert plan.least == 9, "no plateau counts before the last prior serves"


def test_sigma_falls_in_the_calls_of_a_strong_prior_only():
    op = operator()
    strong, plain = (Made(known=Traits(strong=strong, warmup=(Made(), 4))) for strong in (True, False))
    schedules = [make_plan(op, 0.0, prior, iterations=13).schedule for prior in (strong, plain)]
    falling, staying = ([schedule.at(n)[0] for n in range(13)] for schedule in schedules)
    assert len({*falling[:11], *staying}) == 1
    assert len(set(falling[10:])) == 3
    assert falling == sorted(falling, reverse=True)
    given = make_plan(op, 0.0, strong, iterations=10, sigma=0.1)
    assert given.describe()["sigma"] == [0.1, 0.1]


def test_after_a_decoder_the_first_stage_has_no_warm_up_and_sigma_is_one_number():
    stages = Stages([(Flow(first=9), 15), (Flow(), 5)])
    cold, warm = (make_plan(operator(side=32), 0.0, stages, decoded=decoded) for decoded in (False, True))
    assert [turn.begins for turn in cold.serves] == [0, 9, 15]
    assert [turn.begins for turn in warm.serves] == [0, 15]
    assert cold.iterations == warm.iterations == 20
    assert len({plan.schedule.at(call)[0] for plan in (cold, warm) for call in range(20)}) == 1


@pytest.mark.parametrize("limit", [0.95, 1.05])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_solver_keeps_to_the_plan(scene, noise, limit):
    """Who serves each call, and with what sigma, are as the plan says beforehand."""
    served = []

    def noting(name):
        return Made(lambda v, sigma: served.append((name, sigma)) or v)

    op = SensingOperator(scene.masks)
    below = limit * make_plan(op, noise, Made()).schedule.at(0)[0]
    known = Traits(warmup=(noting("warm"), 5), serves_below=below)
    prior = Made(lambda v, sigma: served.append(("prior", sigma)) or v, known=known)
    plan = make_plan(op, noise, prior, iterations=30)
    start = np.zeros(op.shape, np.float32)
    for state in pnp_sci.iterate(op, scene.y, prior, start, noise=noise):
        if state.iteration == 30:
            break
    sigmas = [plan.schedule.at(call)[0] for call in range(30)]
    assert [sigma for _, sigma in served] == sigmas
    assert [name for name, _ in served] == 5 * ["warm"] + 25 * ["prior" if limit > 1 else "warm"]


def test_estimates_are_averaged_where_the_serving_prior_asks_for_it():
    op, asking = operator(), Traits(average=True, warmup=(Made(), 4))
    plan = make_plan(op, 0.0, Made(known=asking))
    assert [plan.averages(n) for n in range(8)] == 5 * [False] + 3 * [True]
    always = make_plan(op, 0.0, Made(known=Traits(average=True)))
    assert [always.averages(n) for n in range(3)] == [False, True, True]
    assert not any(make_plan(op, 0.0, Made()).averages(n) for n in range(9))
    staged = Stages([(Made(), 2), (Made(known=Traits(average=True)), 2), (Made(), 2)])
    assert [make_plan(op, 0.0, staged).averages(n) for n in range(7)] == [False] * 3 + [True] * 2 + [False] * 2
    waiting = make_plan(op, 0.0, Made(known=Traits(average=True, warmup=(Made(), 1), serves_below=1e-3)))
    assert not any(waiting.averages(n) for n in range(9)), "the warm-up goes on"


# ---- the record ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.2, np.full((24, 24), 0.2)])
@pytest.mark.parametrize("prior", [TV(), Flow(), Stages([(TV(), 3), (Flow(), 4)]), Joint([TV(), Made()])])
def test_a_plan_describes_itself_in_json(noise, prior):
    plan = make_plan(operator(), noise, prior, algorithm="admm", tol=1e-3)
    told = plan.describe()
    assert json.loads(json.dumps(told)) == told
    assert told["algorithm"] == "admm"
    assert told["iterations"] == plan.iterations
    assert told["sigma"] == [plan.schedule.at(0)[0], pytest.approx(plan.schedule.at(10**6)[0])]
    assert (told["rho"] > 0) == (np.max(noise) > 0)
    assert [turn["from"] for turn in told["serves"]] == [turn.begins for turn in plan.serves]


def test_a_plan_of_very_many_iterations_is_described_at_once():
    """As for a run that a time budget or a callback ends."""
    told = make_plan(operator(side=32), 0.0, Flow(first=9), iterations=10**12).describe()
    assert [turn["from"] for turn in told["serves"]] == [0, 9]


def test_a_plan_says_when_sigma_is_low_enough_for_a_prior():
    falling = make_plan(operator(), 0.0, Made(known=Traits(strong=True)), iterations=40).schedule
    for call in (0, 5, 17, 38):
        below = falling.at(call)[0]
        prior = Made(known=Traits(strong=True, warmup=(TV(), 1), serves_below=below))
        plan = make_plan(operator(), 0.0, prior, iterations=40)
        names = [plan.serves[plan.place(n)].prior for n in range(40)]
        told = [turn["from"] for turn in plan.describe()["serves"]]
        assert told == [0, names.index(prior)], "TV serves until then"
    never = Made(known=Traits(strong=True, warmup=(TV(), 1), serves_below=1e-3))
    assert [turn["from"] for turn in make_plan(operator(), 0.0, never).describe()["serves"]] == [0]


def test_a_plan_names_the_members_of_a_joint_prior():
    (turn,) = make_plan(operator(), 0.0, Joint([TV(), Made()])).describe()["serves"]
    assert turn["name"] == "TV + Made"


def test_the_result_holds_the_plan_of_each_measurement(scene):
    y = np.stack([scene.y, pnp_sci.simulate(scene.truth, scene.masks, noise=0.1)])
    result = solve(y, scene.masks, Flow(first=3), "adjoint", iterations=45, tol=0, scene="full")
    plans = result.settings["plan"]
    assert len(plans) == 2
    for n, plan in enumerate(plans):
        assert json.loads(json.dumps(plan)) == plan
        assert [turn["from"] for turn in plan["serves"]] == [0, 3]
        told = [record.sigma for record in result.history if record.measurement == n]
        assert [told[1], told[-1]] == pytest.approx(plan["sigma"], rel=0.01)
    assert plans[0]["sigma"][0] < plans[1]["sigma"][0]
    text = str(result)
    for words in ("measurement 1: gap", "measurement 2: gap", "TV to iteration 3", "Flow to iteration 45", "falling"):
        assert words in text


def test_the_noise_is_estimated_once_and_the_scene_judged_once(scene, monkeypatch):
    calls = {"noise": 0, "scene": 0}

    def counted(name, function):
        def call(*arguments, **options):
            calls[name] += 1
            return function(*arguments, **options)

        return call

    from pnp_sci.pipeline import sequence
    from pnp_sci.sensing import problem

    monkeypatch.setattr(problem, "estimate_noise", counted("noise", problem.estimate_noise))
    monkeypatch.setattr(sequence, "choose_scene", counted("scene", sequence.choose_scene))
    grey = {"counted": lambda: lambda problem, scene: np.full(problem.op.shape, 0.5)}
    monkeypatch.setitem(registry._registered, "decoders", grey)
    for init in ("adjoint", "counted", lambda problem, scene: np.full(problem.op.shape, 0.5)):
        calls.update(noise=0, scene=0)
        solve(scene.y, scene.masks, init=init, iterations=2)
        assert calls == {"noise": 1, "scene": 1}


def test_no_estimate_has_converged_before_the_last_prior_serves(scene):
    """Estimates that stay the same end a run, but not during the warm-up."""
    still = solve(scene.y, scene.masks, answering(0.1), scene="full", algorithm="plain-gap")
    late = solve(scene.y, scene.masks, answering(0.1, warmup=(answering(0), 12)), scene="full", algorithm="plain-gap")
    assert len(still.history) <= 12
    assert len(late.history) > 12 + 5
