"""`planner.plan`: several joints, each as the inversion of its own would plan it."""

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner import InvalidInput, Plan, lower_bound
from planner.model.evidence import Evidence
from planner.planning.plan import request_motion
from planner.planning.task import Task
from tests.instances import ERS210A, saturating
from tests.plans import inversion

SLOW = planner.JointModel(v_max=2.0, theta_0=0.1, lag=0.03, acceleration_time=0.05)
PHASE = 2.0 * np.pi * np.arange(60) / 60
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE)])
LOADED = replace(ERS210A, compliance=0.05, dead_band=0.01)
TORQUES = np.column_stack([0.3 * np.cos(PHASE), 0.1 + 0.0 * PHASE])


@pytest.mark.parametrize("method", ["optimal", "closed_form"])
def test_each_joint_is_planned_as_by_itself(method):
    models = {"hip": LOADED, "knee": SLOW}
    limits = {"limits": (-0.5, 0.5)} if method == "optimal" else {}
    plan = planner.plan(models, DESIRED, load=TORQUES, method=method, **limits)
    invert = planner.invert_optimal if method == "optimal" else planner.invert_closed_form
    for j, model in enumerate(models.values()):
        alone = invert(model, DESIRED[:, j], load=TORQUES[:, j], **limits)
        np.testing.assert_array_equal(plan.requests[:, j], alone.requests)
        np.testing.assert_array_equal(plan.predicted[:, j], alone.predicted)
        assert plan.rms[j] == alone.rms
        assert plan.inversions[j].lower_bound == alone.lower_bound
    np.testing.assert_array_equal(plan.desired, DESIRED)
    assert (plan.names, plan.models) == (("hip", "knee"), (LOADED, SLOW))


@pytest.mark.parametrize(
    ("models", "of_each"),
    [
        ((ERS210A, SLOW), (ERS210A, SLOW)),
        ({"knee": SLOW, "": ERS210A, "elbow": SLOW}, (ERS210A, SLOW)),
        (ERS210A, (ERS210A, ERS210A)),
    ],
)
def test_models_are_one_for_each_joint_or_by_joint_or_that_of_all(models, of_each):
    made = planner.plan(models, DESIRED, names=["hip", "knee"], method="closed_form")
    assert made.models == of_each
    assert made.inversions[0].method == "closed_form"


def test_one_column_is_one_joint():
    made = planner.plan({"": ERS210A}, DESIRED[:, 0], method="closed_form", segments=4)
    assert (made.names, made.requests.shape) == (("joint_1",), (60, 1))
    assert made.inversions[0].approximation.segments == 4


WITHOUT_EFFECT = {
    "closed_form": "limits start norm tolerance max_step smoothness robust solver",
    "shift": "max_step smoothness robust solver segments rule refine",
    "optimal": "segments rule refine",
}


@pytest.mark.parametrize("method", WITHOUT_EFFECT)
def test_an_option_without_effect_is_refused(method):
    for option in WITHOUT_EFFECT[method].split():
        told = f"^{option}: without effect with method '{method}'; leave it out"
        with pytest.raises(InvalidInput, match=told):
            planner.plan(ERS210A, DESIRED, method=method, **{option: 0.1})


def planted(desired, requests, models=ERS210A, **options):
    """A plan with these requests: nothing is searched."""
    return Plan(task=Task.of(models, desired, smoothness=0.0, **options), requests=requests)


def test_the_ways_of_requests_and_of_desired_angles_are_counted_apart_back_and_forth():
    requests = np.array([0.0, 0.3, 0.1, 0.4])
    motion = request_motion(requests, 0.5 * requests, period=0.1, cyclic=False)
    assert motion.path_length == pytest.approx(0.3 + 0.2 + 0.3)
    assert motion.desired_path_length == pytest.approx(0.5 * motion.path_length)


def test_desired_angles_requested_as_they_are_meet_the_load_and_the_rest_of_the_plan():
    models = (LOADED, SLOW)
    options = {"load": TORQUES, "cyclic": False}
    made = planted(DESIRED, DESIRED, models, **options)
    for j, model in enumerate(models):
        load = TORQUES[:, j] if model.feels_load else None
        start = float(DESIRED[0, j])  # where the plan begins
        alone = planner.simulate(model, DESIRED[:, j], cyclic=False, start=start, load=load)
        np.testing.assert_array_equal(made.direct.predicted[:, j], alone)


def test_the_foot_on_the_robot_is_expected_off_by_the_plans_errors_and_those_of_the_models():
    walk = planner.reference_walk()
    error = 0.02
    model = ERS210A.with_evidence(Evidence(error))
    task = Task.of(model, walk.desired_foot, leg=walk.leg, smoothness=0.0)
    made = Plan(task=task, requests=np.roll(task.desired, -5, axis=0), method="foot_optimal")
    jacobians = walk.leg.jacobians(made.predicted)
    squares = np.mean(made.distances**2) + error**2 * np.mean(np.sum(jacobians**2, axis=(1, 2)))
    assert made.expected_foot == pytest.approx(np.sqrt(squares), rel=0.01)
    learnt = replace(task, disturbance=np.full_like(task.desired, 0.01))
    assert replace(made, task=learnt).expected_foot is None
    np.testing.assert_array_equal(replace(made, task=learnt).lower_bounds, [0.0])


def test_what_cycles_have_added_is_predicted_counts_in_the_bound_and_ends_what_was_promised():
    added = 0.01 * np.arange(120.0).reshape(60, 2)
    made = planted(DESIRED, 0.9 * DESIRED)
    learnt = replace(made, task=replace(made.task, disturbance=added))
    np.testing.assert_array_equal(learnt.predicted, made.predicted + added)
    np.testing.assert_array_equal(learnt.errors, made.predicted + added - DESIRED)
    of_models_alone = made.direct.predicted
    np.testing.assert_array_equal(learnt.direct.predicted, of_models_alone)
    desired = saturating(np.random.default_rng(2), ERS210A)
    disturbance = 0.1 * np.roll(desired, 5)
    added = disturbance[:, np.newaxis]
    plan = replace(inversion(ERS210A, desired, desired), disturbance=added)
    assert plan.lower_bound == lower_bound(ERS210A, desired - disturbance)
    tested = inversion(ERS210A.with_evidence(Evidence(0.01)), desired, desired)
    assert tested.expected.error > 0.01
    assert math.isnan(replace(tested, disturbance=added).expected.error)


def test_the_bound_of_each_joint_holds_under_its_load():
    heavy = replace(SLOW, compliance=0.1, speed_per_torque=0.8)
    load = np.column_stack([-0.5 * np.sign(np.cos(PHASE)), 0.0 * PHASE])  # against the motion
    made = planted(4.0 * DESIRED, DESIRED, (heavy, SLOW), load=load)
    for j, (model, torque) in enumerate(((heavy, load[:, 0]), (SLOW, None))):
        alone = planner.lower_bound(model, 4.0 * DESIRED[:, j], load=torque)
        assert made.lower_bounds[j] == pytest.approx(alone, rel=1e-9)
    assert made.lower_bounds[0] > 1.01 * planner.lower_bound(SLOW, 4.0 * DESIRED[:, 0])


def test_what_a_joint_is_expected_to_miss_follows_its_own_motion_and_load():
    by_motion = Evidence(0.01, load=0.25, by_acceleration=((0.0, 0.004), (20.0, 0.02)))
    tested = ERS210A.with_evidence(Evidence(0.02, speed=0.1))
    models = [LOADED.with_evidence(by_motion), tested, ERS210A]
    ramp = np.column_stack([np.linspace(0.0, 0.5, 60), 0.0 * PHASE, 0.2 * np.sin(PHASE)])
    load = 0.3 * np.ones((60, 3))
    made = planted(ramp, ramp, models, cyclic=False, load=load)
    for j, model in enumerate(models[:2]):
        known = model.evidence.error_of(made.predicted[:, j], period=ERS210A.period, cyclic=False)
        assert made.expected_rms[j] == pytest.approx(np.hypot(made.rms[j], known))
    assert [each.untested for each in made.expected] == [("load",), (), ()]
    assert np.isnan(made.expected_rms[2])
    around = planted(ramp, ramp, models, load=load)
    assert around.expected_rms[0] > 2.0 * made.expected_rms[0]  # the jump back accelerates


@pytest.mark.parametrize(
    ("requests", "cyclic", "reversals"),
    [
        ([0.0, 1.0, 2.0, 1.0], True, 2),
        ([0.0, 1.0, 2.0, 1.0], False, 1),
        ([0.0, 1.0, 1.0, 2.0], True, 2),
        ([0.0, 1.0, 1.0, 0.0], False, 1),
        ([0.0, 1.0, 1.0 - 1e-10, 2.0], False, 0),
        ([0.0, 1e-5, 0.0, 1e-5], False, 2),
        ([1.0, 1.0, 1.0, 1.0], True, 0),
    ],
)
def test_reversals_are_counted_by_second_where_requests_turn_by_more_than_rounding(
    requests, cyclic, reversals
):
    requests = np.array(requests)
    motion = request_motion(requests, requests, period=0.05, cyclic=cyclic)
    assert motion.reversals_per_s == pytest.approx(reversals / 0.2)
    assert motion.largest_step == pytest.approx(
        np.max(np.abs(np.diff(requests, append=requests[0] if cyclic else requests[-1])))
    )


def test_the_view_of_each_joint_shows_the_figures_of_that_joint():
    """Those of a plan of this joint alone, name by name, and none of them is that of the other."""
    known = [
        LOADED.with_evidence(Evidence(0.01)),
        replace(SLOW, compliance=0.2).with_evidence(Evidence(0.02)),
    ]
    made = planted(
        DESIRED,
        1.1 * DESIRED + np.array([0.01, 0.03]),
        known,
        cyclic=False,
        norm="max",
        limits=(-0.5, [0.5, 0.6]),
        max_step=[0.1, 0.2],
        start=[0.01, 0.19],
        load=TORQUES + 0.1,
        tolerance=0.1,
    )
    names = "requests predicted errors desired rms max_error error lower_bound gap"
    names += " expected largest_step excess model over_models errors_of_models"
    for j, view in enumerate(made.inversions):
        (alone,) = made.joint(j).inversions
        (other,) = made.joint(1 - j).inversions
        for name in names.split():
            own = getattr(view, name)
            np.testing.assert_equal(own, getattr(alone, name), err_msg=name)
            with pytest.raises(AssertionError):
                np.testing.assert_equal(own, getattr(other, name), err_msg=name)
        assert view.within_tolerance is (view.max_error <= 0.1)


def test_a_tolerance_is_kept_in_the_norm_of_the_plan():
    """A tenth of the samples are far off, so that the largest error is three times the rms."""
    requests = np.where(np.arange(60) // 6 == 5, 0.2, 0.0)[:, np.newaxis]
    made = planted(0.0 * requests, requests)
    assert made.inversions[0].within_tolerance  # none was asked for
    between = 0.5 * float(made.rms[0] + made.max_error[0])
    for norm, kept in (("rms", True), ("max", False)):
        task = replace(made.task, norm=norm, tolerance=between)
        (view,) = replace(made, task=task).inversions
        assert view.within_tolerance is kept


@pytest.fixture
def unsearched(monkeypatch):
    """What is asked of the search, which answers with the desired angles."""
    asked = []

    def solved(task, *, solver, executed, progress):
        assert executed is None
        asked.append((task, solver))
        for name in task.names if progress else ():
            progress(name)
        nominal = 2.0 * task.desired if len(task.scenarios) > 1 else None
        return task.desired + 0.0, nominal

    monkeypatch.setattr("planner.planning.search.solve", solved)
    return asked


OPTIONS = {
    "cyclic": False,
    "limits": (-0.5, 0.6),
    "start": 0.01,
    "max_step": 0.1,
    "smoothness": 0.02,
    "robust": "worst",
    "norm": "max",
    "tolerance": 0.3,
    "solver": "ipopt",
    "load": 0.2,
}


@pytest.mark.parametrize("joints", [1, 2])
def test_every_option_is_asked_of_the_search_and_kept_in_the_task_of_the_plan(joints, unsearched):
    models, told = [LOADED, replace(LOADED, lag=0.05)], []
    if joints == 1:
        made = planner.invert_optimal(models, DESIRED[:, 0], **OPTIONS).plan
    else:
        asked = {"names": ["hip", "knee"], "progress": told.append, **OPTIONS}
        made = planner.plan([models, [SLOW]], DESIRED, **asked)
        assert told == ["hip", "knee"]
    ((task, solver),) = unsearched
    assert (made.task, made.solver, solver) == (task, "ipopt", "ipopt")
    kept = ("cyclic", "smoothness", "robust", "norm", "tolerance")
    assert {name: getattr(task, name) for name in kept} == {name: OPTIONS[name] for name in kept}
    assert task.limits == ((-0.5, 0.6),) * joints
    assert task.starts == (0.01,) * joints
    np.testing.assert_array_equal(task.max_step, [0.1] * joints)
    np.testing.assert_array_equal(task.load, np.tile([0.2, 0.0][:joints], (60, 1)))
    assert len(task.models[0]) == 2
    np.testing.assert_array_equal(made.nominal_requests, 2.0 * DESIRED[:, :joints])
    assert (made.method, made.approximations, made.learning) == ("optimal", (), ())


@pytest.mark.parametrize("norm", ["rms", "max"])
@pytest.mark.parametrize("start", [None, 0.3])
def test_the_gap_is_the_error_over_the_bound_in_the_plans_own_norm(norm, start):
    cyclic = start is None
    desired = saturating(np.random.default_rng(1), ERS210A)
    requests = np.roll(desired, -10)  # about the best shift: a gap far above the bound is none
    requests[0] = desired[0] if start is None else start
    plan = inversion(ERS210A, desired, requests, norm=norm, cyclic=cyclic, start=start)
    bound = lower_bound(ERS210A, desired, cyclic=cyclic, norm=norm, start=start)
    assert plan.lower_bound == bound
    assert plan.gap == pytest.approx(plan.error / bound - 1.0, rel=1e-12)
    assert plan.gap >= 0.0


@pytest.mark.parametrize(
    ("requests", "excess"),
    [([0.0, 1.0, 0.5], 0.0), ([-0.2, 1.1, 0.5], 0.2), ([0.2, 1.3, 0.5], 0.3), ([0.5] * 3, 0.0)],
)
def test_the_excess_is_the_distance_beyond_the_desired_range(requests, excess):
    plan = inversion(ERS210A, [0.0, 1.0, 0.5], requests, cyclic=False, start=0.0)
    assert plan.excess == pytest.approx(excess)


def test_a_caller_who_makes_underflow_an_error_gets_the_plan_all_the_same():
    fast = 1.2 * np.sin(2.0 * np.pi * np.arange(88) / 88)
    expected = planner.plan(ERS210A, fast, norm="max").requests
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(planner.plan(ERS210A, fast, norm="max").requests, expected)
