"""Load torques against a pendulum by hand and against energy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics import Leg, UnsupportedLeg
from kinematics.leg import GRAVITY
from tests.kinematics.made_up_robots import LEGS, Joint, Y, ers210a_leg, made_up_leg

ROUNDING = 1e-12  # two routes to the same torque agree to this [N m]; the torques are of order 1

DIFFERENCES = 1e-7
"""Central differences of the energy with a step of 1e-5 rad are right to this [N m]."""

G = 9.80665
LENGTHS, CENTRES, MASSES, INERTIAS = (0.3, 0.2), (0.11, 0.13), (0.8, 0.5), (0.004, 0.003)
PENDULUM = f"""<robot name="pendulum"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 {-CENTRES[0]}"/><mass value="{MASSES[0]}"/>
<inertia ixx="0.001" iyy="{INERTIAS[0]}" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 {-CENTRES[1]}"/><mass value="{MASSES[1]}"/>
<inertia ixx="0.001" iyy="{INERTIAS[1]}" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
<origin xyz="0 0 {-LENGTHS[0]}"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="mount" type="fixed"><parent link="lower"/><child link="tip"/>
<origin xyz="0 0 {-LENGTHS[1]}"/></joint></robot>"""
"""Two links that hang down at 0 and swing forward (x) by positive angles."""


@pytest.fixture
def pendulum(tmp_path: Path) -> Leg:
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM, encoding="utf-8")
    return Leg.from_urdf(path, base="base", foot="tip")


def by_hand(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """What two hinged links put on their joints [N m]: the textbook's equations of motion."""
    (length, _), (c1, c2), (m1, m2), (i1, i2) = LENGTHS, CENTRES, MASSES, INERTIAS
    both = q[:, 0] + q[:, 1]
    coupling = m2 * length * c2 * np.cos(q[:, 1])
    lower = i2 + m2 * c2**2
    upper = i1 + m1 * c1**2 + m2 * length**2 + lower + 2.0 * coupling
    turning = m2 * length * c2 * np.sin(q[:, 1])
    first = upper * a[:, 0] + (lower + coupling) * a[:, 1]
    first -= turning * (2.0 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    first += (m1 * c1 + m2 * length) * G * np.sin(q[:, 0]) + m2 * c2 * G * np.sin(both)
    second = (lower + coupling) * a[:, 0] + lower * a[:, 1] + turning * v[:, 0] ** 2
    second += m2 * c2 * G * np.sin(both)
    return -np.column_stack([first, second])


def swing(count: int) -> np.ndarray:
    phase = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([0.7 * np.sin(phase), 0.5 * np.cos(2.0 * phase) - 0.3])


def test_gravity_returns_a_pendulum_as_the_formula_by_hand_says_also_on_its_head(
    pendulum: Leg,
) -> None:
    poses = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 2))
    expected = by_hand(poses, np.zeros_like(poses), np.zeros_like(poses))
    np.testing.assert_allclose(pendulum.load_torques(poses), expected, rtol=0, atol=ROUNDING)
    lifted = pendulum.load_torques([[0.5, 0.0]])
    assert (lifted < 0.0).all()  # positive angles lift both links, and gravity lowers them
    hanging = pendulum.load_torques(swing(10), gravity=(0.0, 0.0, G))
    np.testing.assert_allclose(hanging, -pendulum.load_torques(swing(10)), rtol=0, atol=ROUNDING)
    assert not pendulum.load_torques(swing(10), gravity=(0.0, G, 0.0)).any()  # along the axes


@pytest.mark.parametrize("cyclic", [True, False])
def test_the_dynamics_of_a_pendulum_are_those_by_hand_at_central_differences(
    pendulum: Leg, cyclic: bool
) -> None:
    path, period = swing(60), 0.02
    before = np.roll(path, 1, axis=0) if cyclic else np.vstack([path[:1], path[:-1]])
    after = np.roll(path, -1, axis=0) if cyclic else np.vstack([path[1:], path[-1:]])
    speeds, accelerations = (after - before) / 0.04, (after - 2.0 * path + before) / 0.02**2
    found = pendulum.load_torques(path, dynamics=True, period=period, cyclic=cyclic)
    expected = by_hand(path, speeds, accelerations)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", LEGS)
def test_the_torque_of_gravity_is_the_slope_of_the_potential_energy(name: str) -> None:
    import pinocchio

    leg = ers210a_leg(name)
    assert leg.robot is not None
    model = leg.robot.model
    model.gravity.linear = np.array(GRAVITY)
    data = model.createData()

    def energy(pose: np.ndarray) -> float:
        coordinates = leg.robot.configuration(pose)
        return float(pinocchio.computePotentialEnergy(model, data, coordinates))

    poses = np.random.default_rng(2).uniform(*leg.limits.central, (10, 3))
    step = 1e-5 * np.eye(3)
    slopes = [[(energy(q + d) - energy(q - d)) / 2e-5 for d in step] for q in poses]
    np.testing.assert_allclose(leg.load_torques(poses), -np.array(slopes), rtol=0, atol=DIFFERENCES)


def test_joints_that_are_locked_or_beyond_the_leg_load_the_others(
    tmp_path: Path, pendulum: Leg
) -> None:
    bent = Leg.from_urdf(tmp_path / "pendulum.urdf", base="base", foot="tip", locked={"elbow": 0.9})
    both = pendulum.load_torques([[0.4, 0.9]])
    np.testing.assert_allclose(bent.load_torques([[0.4]]), both[:, :1], rtol=0, atol=ROUNDING)
    ranges = PENDULUM.split('lower="-3"')
    bent = f'{ranges[0]}lower="-3"{ranges[1]}lower="0.9"{ranges[2]}'
    (tmp_path / "bent.urdf").write_text(bent, encoding="utf-8")
    shoulder = Leg.from_urdf(tmp_path / "bent.urdf", base="base", foot="upper")
    both = pendulum.load_torques([[0.4, 0.9]])
    np.testing.assert_allclose(shoulder.load_torques([[0.4]]), both[:, :1], rtol=0, atol=ROUNDING)


def test_a_urdf_without_masses_is_refused(tmp_path: Path) -> None:
    leg = made_up_leg(tmp_path, [Joint((0.0, 0.0, 0.1), Y)], (0.0, 0.0, 0.1))
    with pytest.raises(UnsupportedLeg, match="no link beyond joint 'joint_1' has a mass"):
        leg.load_torques([[0.1]])
    with pytest.raises(UnsupportedLeg, match=r"Leg\.from_urdf"):
        replace(leg, robot=None).load_torques([[0.1]])
