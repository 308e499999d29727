"""`planner.plan`: several joints, each as the inversion of its own would plan it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import planner
from planner.exceptions import Infeasible, InvalidFile, InvalidInput
from planner.files.paths import read_joint_path

AIBO = planner.JointModel.ers210a()
SLOW = planner.JointModel(v_max=2.0, theta_0=0.1, lag=0.03, acceleration_time=0.05)
PHASE = 2.0 * np.pi * np.arange(60) / 60
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE)])


@pytest.fixture(scope="module")
def plan():
    return planner.plan({"hip": AIBO, "knee": SLOW}, DESIRED, limits=(-0.5, 0.5))


def test_each_joint_is_planned_as_by_itself(plan):
    for j, model in enumerate((AIBO, SLOW)):
        alone = planner.invert_optimal(model, DESIRED[:, j], limits=(-0.5, 0.5))
        np.testing.assert_array_equal(plan.requests[:, j], alone.requests)
        np.testing.assert_array_equal(plan.predicted[:, j], alone.predicted)
        assert plan.rms[j] == alone.rms
        assert plan.inversions[j].lower_bound == alone.lower_bound
    np.testing.assert_array_equal(plan.desired, DESIRED)
    assert (plan.names, plan.models) == (("hip", "knee"), (AIBO, SLOW))


@pytest.mark.parametrize(
    "models", [(AIBO, SLOW), {"knee": SLOW, "": AIBO, "elbow": SLOW}, {"knee": SLOW, "hip": AIBO}]
)
def test_models_are_one_for_each_joint_or_a_dict_by_joint(models):
    made = planner.plan(models, DESIRED, names=["hip", "knee"], method="closed_form")
    assert made.models == (AIBO, SLOW)
    assert made.inversions[0].method == "closed_form"


def test_one_model_is_that_of_every_joint_and_one_column_is_one_joint():
    assert planner.plan(AIBO, DESIRED, method="closed_form").models == (AIBO, AIBO)
    made = planner.plan({"": AIBO}, DESIRED[:, 0], method="closed_form", segments=4)
    assert (made.names, made.requests.shape) == (("joint_1",), (60, 1))
    assert made.inversions[0].approximation.segments == 4


def test_limits_and_starts_by_joint_are_those_of_that_joint():
    limits, start = {"knee": (-0.25, 0.25)}, {"hip": 0.1}
    made = planner.plan(
        AIBO, DESIRED, names=["hip", "knee"], cyclic=False, limits=limits, start=start
    )
    hip, knee = made.inversions
    assert (hip.limits, knee.limits) == (None, (-0.25, 0.25))
    assert (hip.start, knee.start) == (0.1, 0.2)
    each = planner.plan(AIBO, DESIRED, cyclic=False, limits=(-1.0, [0.4, 0.5]), start=[0.1, 0.2])
    assert [joint.limits for joint in each.inversions] == [(-1.0, 0.4), (-1.0, 0.5)]
    assert [joint.start for joint in each.inversions] == [0.1, 0.2]


LOADED = dataclasses.replace(AIBO, compliance=0.05, dead_band=0.01)
TORQUES = np.column_stack([0.3 * np.cos(PHASE), 0.1 + 0.0 * PHASE])


@pytest.mark.parametrize("load", [TORQUES, {"hip": TORQUES[:, 0], "knee": 0.1}], ids=["rows", "by"])
@pytest.mark.parametrize("method", ["optimal", "closed_form"])
def test_a_load_is_that_of_each_joint(load, method):
    made = planner.plan(LOADED, DESIRED, names=["hip", "knee"], load=load, method=method)
    invert = planner.invert_optimal if method == "optimal" else planner.invert_closed_form
    for j in range(2):
        alone = invert(LOADED, DESIRED[:, j], load=TORQUES[:, j])
        np.testing.assert_array_equal(made.requests[:, j], alone.requests)


def test_a_load_that_does_not_change_is_a_number_or_one_for_each_joint():
    for load in (0.1, [0.1, 0.1]):
        made = planner.plan(LOADED, DESIRED, load=load, method="closed_form")
        alone = planner.invert_closed_form(LOADED, DESIRED[:, 1], load=0.1)
        np.testing.assert_array_equal(made.requests[:, 1], alone.requests)
    one = planner.plan(LOADED, DESIRED[:, 0], load=TORQUES[:, 0], method="closed_form")
    alone = planner.invert_closed_form(LOADED, DESIRED[:, 0], load=TORQUES[:, 0])
    np.testing.assert_array_equal(one.requests[:, 0], alone.requests)


def test_a_saved_plan_is_read_as_it_was(tmp_path, plan):
    plan.save(tmp_path / "requests.csv")
    read = read_joint_path(tmp_path / "requests.csv")
    assert read.names == plan.names
    np.testing.assert_allclose(read.angles, plan.requests, rtol=0.0, atol=1e-13)  # 12 decimals
    np.testing.assert_allclose(np.diff(read.times), AIBO.period, rtol=1e-9)


def test_what_comes_back_cannot_be_written_to(plan):
    for array in (plan.requests, plan.predicted, plan.desired):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("models", "options", "message"),
    [
        ("x", {}, "models: got 1 of them for 2 joints"),
        ([AIBO] * 3, {}, "models: got 3 of them for 2 joints"),
        ({"hip": AIBO}, {}, "desired: got 2 columns for the models of hip"),
        ({"hip": AIBO}, {"names": ["hip", "knee"]}, "models: none for joint 'knee'; got hip"),
        (AIBO, {"names": ["hip", "hip"]}, "names: got .* expected 2 different names"),
        (AIBO, {"names": "ab"}, "names: got 'ab'"),
        (AIBO, {"method": "direct"}, "method: got 'direct', expected 'optimal' or 'closed_form'"),
        (AIBO, {"limits": (1.0, [1, 2, 3])}, "limits: got .* one for each of the columns of"),
        (AIBO, {"limits": {"jaw": (0, 1)}}, "limits: no joint 'jaw'; joints: joint_1, joint_2"),
        (
            AIBO,
            {"load": [1.0, 2.0, 3.0]},
            r"load: got .* of shape \(60, 2\) or \(2,\)",
        ),
        (AIBO, {"load": {"jaw": 1.0}}, "load: no joint 'jaw'"),
        (AIBO, {"start": "a", "cyclic": False}, "start: got 'a'"),
        (AIBO, {"limits": (0, 1), "method": "closed_form"}, "limits: without effect"),
    ],
)
def test_arguments_that_do_not_fit_are_named(models, options, message):
    with pytest.raises(InvalidInput, match=f"^{message}"):
        planner.plan(models, DESIRED, **options)


def test_an_error_about_one_joint_carries_its_name():
    with pytest.raises(Infeasible) as caught:
        planner.plan(AIBO, DESIRED, limits={"joint_2": (-0.1, 0.1)})
    assert caught.value.__notes__ == ["joint_2"]


def test_models_read_back_are_the_models_written(tmp_path):
    SLOW.to_toml(tmp_path / "slow.toml")
    assert planner.JointModel.from_toml(tmp_path / "slow.toml") == SLOW
    assert planner.read_models(tmp_path / "slow.toml") == {"": SLOW}
    tables = "[hip]\nv_max = 2.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n"
    (tmp_path / "hip.toml").write_text(tables)
    assert planner.JointModel.from_toml(tmp_path / "hip.toml") == SLOW
    assert planner.JointModel.from_toml(tmp_path / "hip.toml", "hip") == SLOW
    (tmp_path / "both.toml").write_text(tables + tables.replace("hip", "knee"))
    assert planner.read_models(tmp_path / "both.toml") == {"hip": SLOW, "knee": SLOW}
    with pytest.raises(InvalidFile, match="holds models of hip, knee, expected one; name the"):
        planner.JointModel.from_toml(tmp_path / "both.toml")
