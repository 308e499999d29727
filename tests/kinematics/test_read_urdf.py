"""What a URDF must hold for a leg, and what is said when it does not."""

import numpy as np
import pytest

from kinematics import InvalidInput, KinematicsError, Leg, UnsupportedLeg
from tests.kinematics.made_up_robots import Joint, X, Y, made_up_leg, urdf_text

KNEE = Joint((0.0, 0.0, -0.2), Y)
TIP = (0.0, 0.0, -0.2)


def leg_of(folder, text, *, base="link_0", foot="tip"):
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return Leg.from_urdf(path, base=base, foot=foot)


VALID = urdf_text([Joint((0, 0, 0), X), KNEE], TIP)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not XML .no element found.*expected a URDF file"),
        (VALID[:200], "is not XML"),
        ("\0\x01 binary", "is not XML"),
        ("<mesh/>", "the root element is <mesh>, expected <robot>"),
        ('<xacro:x xmlns:xacro="http://ros.org/xacro"/>', "expand xacro files first"),
        ('<robot name="r"/>', "is not a valid URDF: No link elements"),
        (VALID.replace("1.0 0.0 0.0", "a b c"), r"is not a valid URDF: .*axis.*\[joint_1\]"),
        (VALID.replace('xyz="1.0 0.0 0.0"', 'xyz="nan 0 0"'), "is not a valid URDF: .*axis"),
        (VALID.replace('lower="-2.5"', 'lower="3.0"'), "'joint_1' has the limits 3 and 2.5"),
        (VALID.replace('parent link="link_1"', 'parent link="hand"'), "hand"),
    ],
)
def test_a_file_that_is_no_robot_is_an_error_that_says_why(text, message, tmp_path, capfd):
    with pytest.raises(InvalidInput, match=message) as error:
        leg_of(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'robot.urdf'}: ")
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")  # the parser's own complaints are in the message


def test_a_joint_that_is_locked_or_elsewhere_needs_no_range_and_one_must_be_left(tmp_path):
    fixed = urdf_text([Joint((0, 0, 0), X, lower=0.0, upper=0.0), KNEE, KNEE], TIP)
    assert leg_of(tmp_path, fixed, base="link_1").joint_names == ("joint_2", "joint_3")
    leg = Leg.from_urdf(tmp_path / "robot.urdf", base="link_0", foot="tip", locked={"joint_1": 0.0})
    assert leg.joint_names == ("joint_2", "joint_3")
    (tmp_path / "robot.urdf").write_text(VALID)
    locked = {"joint_1": 0.1, "joint_2": 0.2}
    with pytest.raises(UnsupportedLeg, match="every joint between 'link_0' and 'tip' is locked"):
        Leg.from_urdf(tmp_path / "robot.urdf", base="link_0", foot="tip", locked=locked)


@pytest.mark.parametrize(
    ("base", "foot", "message"),
    [
        ("pelvis", "tip", "base: frame 'pelvis' .* URDF; frames: .*link_0.*link_1.*link_2.*tip"),
        ("link_0", "", "foot: frame '' is not in the URDF; frames: .*link_0.*link_1.*link_2.*tip"),
        ("tip", "link_0", "base 'tip' is not above foot 'link_0'.*swapped"),
        ("arm", "tip", "base 'arm' is not above foot 'tip'.*different limbs"),
        ("link_2", "tip", "no joint lies between base 'link_2' and foot 'tip'"),
        ("tip", "tip", "no joint lies between"),
    ],
)
def test_frames_that_are_not_the_ends_of_a_leg_are_refused(base, foot, message, tmp_path):
    with pytest.raises(KinematicsError, match=message):
        leg_of(tmp_path, VALID, base=base, foot=foot)


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (Joint((0, 0, 0), X, kind="prismatic"), "'joint_1' has no axis to turn about"),
        (Joint((0, 0, 0), X, kind="floating"), "'joint_1' has no axis to turn about"),
        (Joint((0, 0, 0), X, kind="planar"), "'joint_1' has no axis to turn about"),
        (Joint((0, 0, 0), (0, 0, 0)), "'joint_1' has no axis to turn about"),
        (Joint((0, 0, 0), X, extra='<mimic joint="arm_joint"/>'), "'joint_1' .*mimics another"),
    ],
    ids=["prismatic", "floating", "planar", "no axis", "mimic"],
)
def test_joints_that_do_not_simply_turn_are_refused(joint, message, tmp_path):
    with pytest.raises(UnsupportedLeg, match=message):
        made_up_leg(tmp_path, [joint, KNEE], TIP)


def test_a_continuous_joint_has_no_limits_and_neither_has_one_with_huge_ones(tmp_path):
    joints = [
        Joint((0, 0, 0), X, kind="continuous"),
        Joint((0, 0, 0), Y, lower=-1.1e6, upper=1e16),
        Joint((0, 0, 0), Y, lower=-0.9e6, upper=0.9e6),
        KNEE,
    ]
    limits = made_up_leg(tmp_path, joints, TIP).limits
    np.testing.assert_array_equal(limits.lower, [-np.inf, -np.inf, -0.9e6, -2.5])
    np.testing.assert_array_equal(limits.upper, [np.inf, np.inf, 0.9e6, 2.5])


def test_meshes_need_not_exist(tmp_path):
    mesh = '<link name="link_1"><visual><geometry><mesh filename="package://no/where.stl"/>'
    text = VALID.replace('<link name="link_1"/>', f"{mesh}</geometry></visual></link>")
    assert len(leg_of(tmp_path, text).joint_names) == 2


def test_a_chain_that_disagrees_with_pinocchio_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("kinematics.leg._axis", lambda *_: np.array([0.0, 0.6, 0.8]))
    with pytest.raises(UnsupportedLeg, match=r"disagrees with Pinocchio by .* m; please report"):
        made_up_leg(tmp_path, [Joint((0, 0, 0), X), KNEE], TIP)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("revolute", "'joint_1' at 3 rad, expected -2.5 to 2.5 rad, its range"),
        ("prismatic", "'joint_1' at 3 m, expected -2.5 to 2.5 m, its range"),
    ],
)
def test_a_position_beyond_the_range_of_a_locked_joint_has_its_unit(tmp_path, kind, message):
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text([Joint((0, 0, 0), X, kind=kind), KNEE], TIP))
    with pytest.raises(InvalidInput, match=message):
        Leg.from_urdf(path, base="link_0", foot="tip", locked={"joint_1": 3.0})
    Leg.from_urdf(path, base="link_0", foot="tip", locked={"joint_1": 2.5 + 1e-10})  # rounded
