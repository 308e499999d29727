"""What is asked of a plan is said in one of several ways, and checked once."""

from dataclasses import fields, replace

import numpy as np
import pytest

from planner import Infeasible, InvalidInput, JointModel, invert_foot, plan, reference_walk
from planner.planning.task import Task

AIBO = JointModel.ers210a()
SERVO = replace(AIBO, compliance=0.02)
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
    held = Task.of(SERVO, np.full((4, 1), 0.3), limits=(0.3, 0.3))
    assert held.limits == ((0.3, 0.3),)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"limits": {"knees": (0, 1)}}, InvalidInput, r"no joint 'knees' \(did you mean 'knee'"),
        ({"limits": {"knee": (1, 0)}}, Infeasible, "the lower one, 1 rad, is above"),
        ({"limits": (-1.0, [1.0, np.nan])}, InvalidInput, r"got \(-1.0, nan\), expected \(lower"),
        ({"load": {"knee": [1.0, 2.0]}}, InvalidInput, r"load: got \[1\.0, 2\.0\]"),
    ],
)
def test_what_is_wrong_with_one_joint_is_said_of_it(options, error, message):
    with pytest.raises(error, match=message) as raised:
        plan(SERVO, PATH, names=NAMES, **options)
    assert getattr(raised.value, "__notes__", []) in ([], ["knee"])
    assert "knee" in f"{raised.value}{getattr(raised.value, '__notes__', '')}"


def test_a_view_with_other_requests_or_options_is_that_of_another_plan():
    walk = reference_walk()
    made = plan(SERVO, PATH, names=NAMES)
    one = made.inversions[1]
    late = replace(one, requests=np.roll(one.requests, 3), norm="max")
    assert late.error == late.max_error > one.max_error
    assert (late.norm, one.norm) == ("max", "rms")
    np.testing.assert_array_equal(late.desired, PATH[:, 1])
    foot = invert_foot(AIBO, walk.leg, walk.desired_foot[::4], smoothness=0.0)
    up = replace(foot, weights=np.array([0.0, 0.0, 1.0]), norm="max")
    off = foot.foot - foot.plan.task.desired_foot
    assert up.error == pytest.approx(np.max(np.abs(off[:, 2])))


def test_the_load_of_the_first_sample_decides_where_a_joint_may_rest_before():
    """The joint rests at 0.3 + 0.02 tau at most: a torque of 5 N m lifts it to 0.4."""
    loads = np.array([5.0, *np.full(39, 0.0)])
    options = {"names": ("knee",), "limits": (-0.3, 0.3), "cyclic": False}
    path = np.full((40, 1), 0.1)
    task = Task.of(SERVO, path, start=0.39, load=loads[:, np.newaxis], **options)
    assert task.starts == (0.39,)
    for load, start in ((loads, 0.41), (loads[::-1], 0.39), (-loads, 0.25)):
        with pytest.raises(Infeasible, match=r"^start: it is"):
            Task.of(SERVO, path, start=start, load=load[:, np.newaxis], **options)


def test_a_joint_reaches_beyond_its_limits_by_its_dead_band_and_short_of_them_by_a_small_sag():
    """The joint stays that little short of the limit; a sag of more has to fit within."""
    sticky = replace(AIBO, dead_band=0.05, offset=-0.1)
    for reached in (0.249, -0.449):
        desired = np.array([[0.0], [reached], [0.0]])
        Task.of(sticky, desired, limits=(-0.3, 0.3))
        beyond = desired * (np.abs(reached) + 0.011) / np.abs(reached)
        with pytest.raises(Infeasible, match=r"beyond the angles -0\.45 to 0\.25 rad") as raised:
            Task.of(sticky, beyond, limits=(-0.3, 0.3))
        assert "sample 1 is" in str(raised.value)
        assert ", 0.01 rad beyond" in str(raised.value)
    for sag, fits in ((0.0009, True), (0.0012, False)):
        sagging = replace(AIBO, offset=-sag)
        desired = np.array([[0.0], [0.3], [0.0]])
        if fits:
            assert Task.of(sagging, desired, limits=(-0.3, 0.3)).limits == ((-0.3, 0.3),)
            continue
        with pytest.raises(Infeasible, match="sample 1"):
            Task.of(sagging, desired, limits=(-0.3, 0.3))


def test_requests_keep_a_task_up_to_rounding_and_across_the_boundary_of_a_cycle():
    rows = np.array([[0.0], [0.1], [0.2], [0.3]])
    options = {"limits": (-0.5, 0.3), "max_step": 0.1}
    once = Task.of(SERVO, 0.0 * rows, cyclic=False, **options)
    assert once.keeps(rows, rounding=1e-9)
    assert not Task.of(SERVO, 0.0 * rows, **options).keeps(rows, rounding=1e-9)
    assert once.keeps(rows + 1e-6, rounding=1e-5)
    assert once.keeps(rows - 0.5 - 1e-6, rounding=1e-5)
    assert not once.keeps(rows - 0.5 - 1e-6, rounding=1e-7)
    assert not once.keeps(rows + 1e-6, rounding=1e-7)
    assert not once.keeps(rows * (1.0 + 1e-4) - 0.1, rounding=1e-6)
    assert once.keeps(rows * (1.0 + 1e-4) - 0.1, rounding=1e-4)
    both = Task.of(SERVO, np.zeros((4, 2)), cyclic=False, max_step=[0.05, 0.1])
    assert both.keeps(rows * [0.5, 1.0], rounding=1e-9)
    assert not both.keeps(rows * [1.0, 0.5], rounding=1e-9)


def test_a_joint_with_one_model_has_it_beside_every_model_of_the_others():
    late = replace(SERVO, lag=0.05)
    slow = replace(SERVO, v_max=2.0)
    task = Task.of([[SERVO, late, slow], SERVO], PATH, names=NAMES)
    assert task.scenarios == ((SERVO, SERVO), (late, SERVO), (slow, SERVO))
    assert task.nominal == (SERVO, SERVO)
    assert (task.joint(0).robust, task.joint(1).robust) == ("mean", None)
    alone = task.with_models((late, SERVO))
    assert (alone.models, alone.robust) == (((late,), (SERVO,)), None)


def test_a_load_is_kept_where_any_model_of_a_joint_feels_it():
    plain = AIBO
    load = np.column_stack([np.arange(40.0), np.full(40, 0.5)]) / 100.0
    task = Task.of([[plain, SERVO], [plain, plain]], PATH, names=NAMES, load=load)
    np.testing.assert_array_equal(task.loads[0], load[:, 0])
    assert task.loads[1] is None
    assert not np.any(task.loads_on(task.nominal))
    np.testing.assert_array_equal(task.loads_on(task.scenarios[1])[0], load[:, 0])
    np.testing.assert_array_equal(task.load, load * [1.0, 0.0])
    assert not task.under(load).load_of_pose
    assert task.under(load, of_pose=True).load_of_pose
    unloaded = Task.of(plain, PATH).under(load, of_pose=True)
    assert (unloaded.load, unloaded.load_of_pose) == (None, False)


def test_from_rest_a_leg_begins_as_near_to_the_first_point_as_its_limits_let_it_rest():
    walk = reference_walk()
    nearest = Task.of(SERVO, walk.desired_foot[::8], leg=walk.leg).desired[0]
    limits = nearest - np.array([0.1, -0.2, 1.0]), nearest + np.array([0.2, 0.5, -0.3])
    own = Task.of(SERVO, walk.desired_foot[::8], leg=walk.leg)
    np.testing.assert_array_equal([own.lower, own.upper], walk.leg.limits)
    load = np.zeros((11, 3))
    load[0] = 2.0  # lifts each joint by 0.04
    options = {"leg": walk.leg, "limits": limits, "load": load, "cyclic": False}
    task = Task.of(SERVO, walk.desired_foot[::8], **options)
    np.testing.assert_allclose(task.start - nearest, [0.0, 0.24, -0.26])


def test_joined_tasks_have_what_any_of_them_has():
    load = np.column_stack([np.arange(40.0), np.zeros(40)]) / 100.0
    models = [[SERVO], [AIBO, replace(AIBO, lag=0.05)]]
    options = {"cyclic": False, "start": [0.1, 0.2], "max_step": [0.1, 0.2], "robust": "worst"}
    task = Task.of(
        models, PATH, names=NAMES, limits={"knee": (-1.0, 2.0)}, load=load, **options
    ).under(load, of_pose=True)
    task = replace(task, disturbance=0.1 * PATH)
    again = Task.joined([task.joint(0), task.joint(1)])
    _same(task, again)
    unposed = replace(task.joint(0), load_of_pose=False)
    assert Task.joined([unposed, task.joint(1)]).load_of_pose
    assert again.load_of_pose
    assert again.robust == "worst"
    single = task.joint(1)
    assert (single.names, single.limits, single.starts) == (("knee",), ((-1.0, 2.0),), (0.2,))
    np.testing.assert_array_equal(single.max_step, [0.2])
    np.testing.assert_array_equal(single.disturbance, 0.1 * PATH[:, 1:])


def test_deviations_of_joints_move_a_foot_in_its_weighted_norm():
    walk = reference_walk()
    task = Task.of(AIBO, walk.desired_foot[::8], leg=walk.leg, weights=(1.0, 4.0, 0.0))
    squares = 0.0
    for off in 1e-5 * np.eye(3):
        moved = walk.leg.foot_positions(task.desired + off) - walk.leg.foot_positions(task.desired)
        squares += np.mean(np.sum((moved * [0.5, 1.0, 0.0]) ** 2, axis=1))
    made = task.error_made_by(np.full(3, 1e-5), task.desired)
    assert made == pytest.approx(np.sqrt(squares), rel=1e-3)
