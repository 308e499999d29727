"""Plans whose load follows from the pose: the load at hand is that of the prediction."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import planner
from kinematics import Leg, urdf_path
from planner.exceptions import SolverFailed
from planner.gait.stride import stride
from planner.planning.inversion import settled

FOUR = {"v_max": 4.8, "theta_0": 0.33, "lag": 0.01, "acceleration_time": 0.06}
SOFT = planner.JointModel(**FOUR, tick=0.02, dead_band=0.03, compliance=0.11, speed_per_torque=1.7)
"""A servo that sags by 0.06 rad under the load below."""

PHASE = 2.0 * np.pi * np.arange(40) / 40
PATH = 0.9 + 0.5 * np.sin(PHASE)
TOO_FAST = 0.9 + 1.2 * np.sin(3.0 * PHASE)
ROUNDING = 1e-8  # the simulation has settled to 1e-9 rad; the slope of the load is below 1 N m/rad


def pendulum(angles):
    return -0.6 * np.sin(angles)


@pytest.fixture(scope="module")
def too_fast():
    """A plan for a path that the joint cannot follow."""
    return planner.plan(SOFT, TOO_FAST, load=pendulum)


@pytest.mark.parametrize("kind", ["attainable", "from rest", "too fast", "closed form"])
def test_the_load_is_that_of_the_predicted_angles(kind, too_fast):
    made, cyclic = too_fast, kind != "from rest"
    if kind != "too fast":
        method = "closed_form" if kind == "closed form" else "optimal"
        made = planner.plan(SOFT, PATH, load=pendulum, method=method, cyclic=cyclic)
    load = pendulum(made.predicted[:, 0])
    np.testing.assert_allclose(made.task.loads[0], load, rtol=0.0, atol=ROUNDING)
    start = None if cyclic else made.task.starts[0]
    simulated = planner.simulate(SOFT, made.requests[:, 0], load=load, cyclic=cyclic, start=start)
    np.testing.assert_allclose(simulated, made.predicted[:, 0], rtol=0.0, atol=ROUNDING)


def test_a_load_settles_with_one_more_plan_for_the_angles_that_the_joint_reaches(too_fast):
    calls = []
    made = planner.plan(SOFT, PATH, load=pendulum, progress=calls.append)
    under_desired = planner.plan(SOFT, PATH, load=pendulum(PATH))
    assert len(calls) <= 2
    assert made.rms[0] <= under_desired.rms[0] + 1e-4
    load = too_fast.task.loads[0]
    fixed, naive = (planner.plan(SOFT, TOO_FAST, load=each) for each in (load, pendulum(TOO_FAST)))
    assert too_fast.rms[0] <= 1.01 * fixed.rms[0]  # rounding decides between local minima
    assert too_fast.rms[0] < naive.under(load[:, np.newaxis]).rms[0]


def test_a_load_of_the_pose_has_no_lower_bound(too_fast):
    (inversion,) = too_fast.inversions
    assert inversion.plan.task.load_of_pose
    assert inversion.lower_bound == 0.0 < inversion.rms
    stiff = replace(SOFT, compliance=0.0, speed_per_torque=0.0)
    (unloaded,) = planner.plan(stiff, TOO_FAST, load=pendulum).inversions
    assert unloaded.lower_bound > 0.0  # it does not feel the load


def test_a_leg_carries_itself():
    leg = Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")
    foot_path = stride(leg).foot
    model = replace(planner.JointModel.ers210a(), compliance=0.3, speed_per_torque=0.5)
    joints = planner.plan(model, leg.joint_angles(foot_path), load=leg.load_torques)
    foot = planner.invert_foot(model, leg, foot_path, load=leg.load_torques)
    for plan in (joints, foot.plan):
        loads, expected = np.column_stack(plan.task.loads), leg.load_torques(plan.predicted)
        np.testing.assert_allclose(loads, expected, rtol=0.0, atol=ROUNDING)
    assert foot.lower_bound == 0.0


@dataclass(frozen=True)
class Swinging:
    """A joint on a fast path: half as much again as its load deviates, to the other side."""

    torques: np.ndarray

    @property
    def predicted(self):
        return 1.0 - 1.5 * (self.torques - 0.2)

    def under(self, torques):
        return Swinging(torques)


def test_a_pose_that_swings_is_settled_by_smaller_moves_or_is_an_error():
    desired = np.ones((5, 1))
    made = settled(Swinging, lambda angles: angles, desired)
    np.testing.assert_allclose(made.predicted, made.torques, rtol=0.0, atol=ROUNDING)
    steep = replace(SOFT, compliance=1.0, speed_per_torque=0.0)
    with pytest.raises(SolverFailed, match=r"the prediction still moves by .* after 50"):
        planner.plan(steep, PATH, load=lambda angles: 4.0 * np.cos(8.0 * angles))
