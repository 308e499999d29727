"""A sag by the joint's own angle: in the law, in every plan, and in what is identified."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.model.joint import MOST_POSE_SAG, JointModel
from planner.model.response import load_columns, of_joints, path_speeds, simulate
from tests.strategies import INTEGRALS, models

PAPER = JointModel.ers210a()

HANGING = replace(PAPER, sag_sin=-0.06, sag_cos=0.02)
"""A joint with a link that hangs down near the angle 0."""

PATH = np.radians(25.0) * np.cos(2.0 * np.pi * np.arange(250) / 250)
"""Slow enough to be followed, from rest, too [rad]."""


@given(
    models(friction=True, poses=True, inertia=True, integrals=INTEGRALS),
    st.floats(-7.0, 7.0),
    st.floats(-1.0, 1.0),
)
def test_a_request_holds_the_angle_at_rest(model, request_, load):
    angle, torque = float(model.rest(request_, load)), [np.array([load])]
    assert abs(request_ + float(model.sag(load) + model.pose_sag(angle)) - angle) <= 1e-12
    held = of_joints(JointModel.request_at, [model], np.array([[angle]]), torque)
    assert held.item() == pytest.approx(request_, abs=1e-12)
    assert of_joints(JointModel.rest, [model], held, torque).item() == pytest.approx(
        angle, abs=1e-12
    )
    still = simulate(model, np.full(5, request_), cyclic=False, load=load)
    np.testing.assert_allclose(still, angle, rtol=0.0, atol=1e-12)


def test_joints_rest_each_by_its_own_angle_and_load():
    angles, loads = np.array([[0.4, -0.7], [1.0, 0.2]]), [None, np.array([1.0, -2.0])]
    models = [PAPER, replace(HANGING, compliance=0.1)]
    held = of_joints(JointModel.request_at, models, angles, loads)
    np.testing.assert_array_equal(held[:, 0], angles[:, 0])
    second = angles[:, 1] - models[1].pose_sag(angles[:, 1]) - 0.1 * loads[1]
    np.testing.assert_allclose(held[:, 1], second, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(
        of_joints(JointModel.rest, models, held, loads), angles, rtol=0.0, atol=1e-12
    )
    np.testing.assert_array_equal(load_columns(loads, 2), [[0.0, 1.0], [0.0, -2.0]])
    assert load_columns([None, None], 2) is None
    ends = np.array([[-math.inf], [math.inf]])
    np.testing.assert_array_equal(of_joints(JointModel.rest, [HANGING], ends), ends)


@pytest.mark.parametrize("angle", [-1.1, 0.3, 1.4])
@pytest.mark.parametrize("changes", [{}, {"dead_band": 0.02, "v_offset": 0.5}])
def test_a_joint_is_faster_downhill_than_uphill_by_twice_what_its_sag_would_move(changes, angle):
    model = replace(HANGING, **changes)
    steps = np.array([angle - 2.0, angle + 2.0])
    down, up = (
        simulate(model, np.append(request, np.full(20, request)), cyclic=False, start=angle)[-2:]
        for request in steps
    )
    here = (down[0], up[0])
    speeds = [(each[1] - each[0]) / model.tick for each in (down, up)]
    for limit, at, speed in zip((0, 1), here, speeds, strict=True):
        assert model.speed_limits(angle=at)[limit] == pytest.approx(speed, rel=1e-9)
        assert model.speed(4.0 * limit - 2.0, angle=at) == pytest.approx(speed, rel=1e-9)


def test_a_path_is_too_fast_where_gravity_slows_the_joint_down():
    path = 0.5 * math.pi + 0.97 * PAPER.v_max * PAPER.period * np.arange(-10.0, 11.0)
    hanging = replace(PAPER, sag_sin=-0.1 * PAPER.theta_0)
    assert not path_speeds(PAPER, path, cyclic=False).too_fast.any()
    assert path_speeds(hanging, path, cyclic=False).too_fast.all()
    assert not path_speeds(hanging, path[::-1], cyclic=False).too_fast.any()
    assert not path_speeds(hanging, 1.1 * path[::-1], cyclic=False).too_fast.any()


def test_a_joint_that_gravity_overcomes_falls_and_no_speed_lifts_it():
    model = replace(PAPER, sag_sin=-1.5 * PAPER.theta_0)
    angles = simulate(model, np.full(400, 1.5), cyclic=False, start=1.5)
    assert np.all(np.diff(angles[1:]) <= 0.0)
    held = float(angles[-1])  # where all its torque holds it
    assert abs(model.pose_sag(held)) == pytest.approx(model.theta_0, rel=1e-6)
    rising = path_speeds(model, 1.5 + 1e-3 * np.arange(9.0), cyclic=False)
    assert rising.too_fast.all()
    assert planner.invert_optimal(model, 1.4 + 0.1 * PATH).rms > 0.1
    assert planner.certify(model, 1.4 + 0.1 * PATH).bound > 0.1


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_the_largest_sag_has_an_angle_at_rest_for_every_request(share):
    turned = 0.5 * math.pi * share
    sags = 0.999 * MOST_POSE_SAG * np.array([math.sin(turned), -math.cos(turned)])
    model = replace(PAPER, sag_sin=float(sags[0]), sag_cos=float(sags[1]))
    requests = np.linspace(-7.0, 7.0, 2001)
    angles = model.rest(requests)
    np.testing.assert_allclose(requests + model.pose_sag(angles), angles, rtol=0.0, atol=1e-12)
    assert np.all(np.diff(angles) > 0.0)
