"""What is asked of a plan is said in one of several ways, and checked once."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from planner import (
    JointModel,
    invert_foot,
    invert_optimal,
    plan,
    reference_walk,
    simulate,
)
from planner.exceptions import Infeasible, InvalidInput, InvalidTrajectory
from planner.planning.plan import joined
from planner.planning.task import Task

SERVO = replace(JointModel.ers210a(), compliance=0.02)
PATH = 0.3 * np.sin(2.0 * np.pi * np.arange(40)[:, np.newaxis] / 40 + [0.0, 1.0])
NAMES = ("hip", "knee")


def _same(one, other):
    for field in fields(Task):
        left, right = getattr(one, field.name), getattr(other, field.name)
        np.testing.assert_equal(left, right, err_msg=field.name)


def test_one_number_one_a_joint_and_by_name_ask_for_the_same():
    options = ("max_step", "limits", "start", "load")
    ways = [
        (0.1, (-0.5, 0.5), 0.02, 0.3),
        ([0.1, 0.1], ([-0.5, -0.5], 0.5), [0.02, 0.02], [0.3, 0.3]),
        tuple(dict.fromkeys(NAMES, each) for each in (0.1, (-0.5, 0.5), 0.02, 0.3)),
    ]
    asked = [dict(zip(options, way, strict=True)) for way in ways]
    tasks = [Task.of(SERVO, PATH, names=NAMES, cyclic=False, **each) for each in asked]
    for other in tasks[1:]:
        _same(tasks[0], other)


def test_what_is_asked_of_one_joint_by_name_leaves_the_other_free():
    task = Task.of(SERVO, PATH, names=NAMES, limits={"knee": (-0.5, 0.5)}, max_step={"hip": 0.1})
    assert task.limits == (None, (-0.5, 0.5))
    np.testing.assert_array_equal(task.max_step, [0.1, np.inf])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"limits": {"knees": (0, 1)}}, InvalidInput, r"no joint 'knees' \(did you mean 'knee'"),
        ({"limits": {"knee": (1, 0)}}, Infeasible, "the lower one, 1 rad, is above"),
        ({"limits": {"knee": (0.0, 0.5)}}, Infeasible, "beyond the angles"),
        ({"max_step": {"knee": 0.0}}, InvalidInput, "max_step: got 0.0, expected an angle above 0"),
        ({"start": {"knee": np.nan}, "cyclic": False}, InvalidInput, "start: got nan"),
        ({"load": {"knee": [1.0, 2.0]}}, InvalidInput, r"load: got shape \(2,\)"),
    ],
)
def test_what_is_wrong_with_one_joint_is_said_of_it(options, error, message):
    with pytest.raises(error, match=message) as raised:
        plan(SERVO, PATH, names=NAMES, **options)
    assert getattr(raised.value, "__notes__", []) in ([], ["knee"])
    assert "knee" in f"{raised.value}{getattr(raised.value, '__notes__', '')}"


def test_a_path_of_two_rows_is_refused():
    with pytest.raises(InvalidTrajectory, match="desired: got 2 samples, expected at least 3"):
        plan(SERVO, PATH[:2])


def test_the_joints_of_a_plan_joined_again_are_the_plan():
    made = plan([SERVO, [SERVO, replace(SERVO, lag=0.05)]], PATH, names=NAMES, load=[0.0, 0.2])
    again = joined([made.joint(j) for j in range(2)])
    _same(made.task, again.task)
    for name in ("requests", "predicted", "error", "lower_bounds", "nominal_requests"):
        np.testing.assert_array_equal(getattr(made, name), getattr(again, name))
    for each, errors in zip(made.inversions, again.errors_of_models, strict=True):
        np.testing.assert_array_equal(each.errors_of_models, errors)


def test_a_view_with_other_requests_or_options_is_that_of_another_plan():
    walk = reference_walk()
    made = plan(SERVO, PATH, names=NAMES)
    one = made.inversions[1]
    late = replace(one, requests=np.roll(one.requests, 3), max_step=0.2, limits=(-0.6, 0.6))
    assert late.rms > one.rms
    assert (late.max_step, late.limits) == (0.2, (-0.6, 0.6))
    assert (one.max_step, one.limits) == (None, None)
    np.testing.assert_array_equal(late.desired, PATH[:, 1])
    foot = invert_foot(JointModel.ers210a(), walk.leg, walk.desired_foot[::4], smoothness=0.0)
    up = replace(foot, weights=np.array([0.0, 0.0, 1.0]), norm="max")
    assert up.error == pytest.approx(np.max(np.abs((foot.foot - foot.desired_foot)[:, 2])))


def test_a_task_that_was_copied_is_read_only():
    task = invert_optimal(SERVO, PATH[:, 0], limits=(-1.0, 1.0)).plan.task
    again = pickle.loads(pickle.dumps(task))
    _same(task, again)
    for field in fields(Task):
        value = getattr(again, field.name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable, field.name


def test_the_desired_angles_sent_as_they_are_begin_where_the_plan_does():
    phase = 2.0 * np.pi * np.arange(60) / 60
    desired = 0.3 * np.sin(phase)
    made = invert_optimal(JointModel.ers210a(), desired, cyclic=False, start=0.5)
    expected = simulate(JointModel.ers210a(), desired, cyclic=False, start=0.5)
    np.testing.assert_array_equal(made.plan.direct[:, 0], expected)
