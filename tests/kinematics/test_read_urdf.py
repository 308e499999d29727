"""What a URDF must hold for a leg, and what is said when it does not."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_robots import Joint, X, Y, made_up_leg, reference_leg, urdf_text

from kinematics import InvalidInput, KinematicsError, Leg, UnsupportedLeg
from kinematics import urdf_path as shipped

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


LIMIT = '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/>'


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ("", "joints 'joint_1', 'joint_2' without <limit>; write <limit lower=.* for each"),
        ('<limit effort="1" velocity="1"/>', "joints 'joint_1', 'joint_2' cannot turn: .* equal"),
        ('<limit lower="0.3" upper="0.3" effort="1" velocity="1"/>', "'joint_2' cannot turn"),
    ],
    ids=["no element", "no lower and upper", "equal"],
)
def test_revolute_joints_without_limits_are_named_with_what_to_write(limit, message, tmp_path):
    with pytest.raises(InvalidInput, match=message) as error:
        leg_of(tmp_path, VALID.replace(LIMIT, limit))
    assert 'type="continuous"' in str(error.value)


def test_of_many_joints_without_limits_six_are_named(tmp_path):
    joints = [Joint((0, 0, 0), X, kind=kind) for kind in ("prismatic", *["revolute"] * 6)]
    text = urdf_text(joints, TIP)
    with pytest.raises(InvalidInput, match=r"joints 'joint_1', .* 'joint_6' and 1 more without"):
        leg_of(tmp_path, text.replace(LIMIT, ""))
    with pytest.raises(InvalidInput, match=r"joints 'joint_1', .* 'joint_6' without"):
        leg_of(tmp_path, text.replace(LIMIT, "", 6))


def test_a_joint_that_is_locked_or_elsewhere_needs_no_range(tmp_path):
    fixed = urdf_text([Joint((0, 0, 0), X, lower=0.0, upper=0.0), KNEE, KNEE], TIP)
    assert leg_of(tmp_path, fixed, base="link_1").joint_names == ("joint_2", "joint_3")
    leg = Leg.from_urdf(tmp_path / "robot.urdf", base="link_0", foot="tip", locked={"joint_1": 0.0})
    assert leg.joint_names == ("joint_2", "joint_3")


def test_standard_error_works_again_after_a_bad_file(tmp_path, capfd):
    import os

    with pytest.raises(InvalidInput):
        leg_of(tmp_path, '<robot name="r"/>')
    os.write(2, b"still here")
    assert capfd.readouterr().err == "still here"


@pytest.mark.parametrize(
    ("base", "foot", "message"),
    [
        ("pelvis", "tip", "base: frame 'pelvis' is not in the URDF; frames: .*link_0.*tip"),
        ("link_0", "", "foot: frame '' is not in the URDF"),
    ],
)
def test_an_unknown_frame_is_an_error_that_lists_the_frames(base, foot, message, tmp_path):
    with pytest.raises(InvalidInput, match=message) as error:
        leg_of(tmp_path, VALID, base=base, foot=foot)
    assert all(each in str(error.value) for each in ("link_0", "link_1", "link_2", "tip", "arm"))


@pytest.mark.parametrize(
    ("base", "foot", "message"),
    [
        ("tip", "link_0", "base 'tip' is not above foot 'link_0'.*swapped"),
        ("arm", "tip", "base 'arm' is not above foot 'tip'.*different limbs"),
        ("link_2", "tip", "no joint lies between base 'link_2' and foot 'tip'"),
        ("tip", "tip", "no joint lies between"),
    ],
)
def test_frames_that_are_not_the_ends_of_a_leg_are_refused(base, foot, message, tmp_path):
    with pytest.raises(UnsupportedLeg, match=message):
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


def test_such_joints_elsewhere_in_the_robot_do_no_harm(tmp_path):
    slide = Joint((0, 0, 0), X, kind="prismatic")
    mimic = Joint((0, 0, 0), X, extra='<mimic joint="arm_joint"/>')
    text = urdf_text([slide, mimic, Joint((0, 0, 0), X), KNEE], TIP)
    assert leg_of(tmp_path, text, base="link_2").joint_names == ("joint_3", "joint_4")


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


def test_a_joint_frame_and_a_link_frame_of_the_same_name_are_one(tmp_path):
    text = VALID.replace('name="tip_mount"', 'name="tip"')
    assert leg_of(tmp_path, text).joint_names == ("joint_1", "joint_2")


def test_meshes_need_not_exist(tmp_path):
    mesh = '<link name="link_1"><visual><geometry><mesh filename="package://no/where.stl"/>'
    text = VALID.replace('<link name="link_1"/>', f"{mesh}</geometry></visual></link>")
    assert len(leg_of(tmp_path, text).joint_names) == 2


def test_a_description_may_be_named_by_a_string_and_hold_any_text(tmp_path):
    text = VALID.replace('name="made_up"', 'name="Hündchen"')
    path = tmp_path / "hündchen.urdf"
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>{text}', encoding="utf-8")
    assert Leg.from_urdf(str(path), base="link_0", foot="tip").base == "link_0"


def test_whole_numbers_and_lists_are_paths():
    leg = reference_leg()
    np.testing.assert_array_equal(
        leg.foot_positions([[0, 0, 0]]), leg.foot_positions(np.zeros((1, 3), dtype=np.float32))
    )


def test_every_error_is_of_the_tree_and_a_value_error(tmp_path):
    for call in (
        lambda: Leg.from_urdf(tmp_path, base="a", foot="b"),
        lambda: Leg.from_urdf(shipped("reference_leg.urdf"), base="a", foot="b"),
        lambda: reference_leg().joint_angles([[0, 0, 1]]),
        lambda: shipped("x"),
    ):
        with pytest.raises(KinematicsError) as error:
            call()
        assert isinstance(error.value, ValueError)
