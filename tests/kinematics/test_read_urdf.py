"""What a URDF must hold for a leg, and what is said when it does not."""

import numpy as np
import pytest

from kinematics import Leg, UnsupportedLeg
from tests.kinematics.made_up_robots import Joint, X, Y, made_up_leg, urdf_text

KNEE = Joint((0.0, 0.0, -0.2), Y)
TIP = (0.0, 0.0, -0.2)
VALID = urdf_text([Joint((0, 0, 0), X), KNEE], TIP)


def leg_of(folder, text, *, base="link_0", foot="tip", **options):
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return Leg.from_urdf(path, base=base, foot=foot, **options)


def jointed(*joints):
    """A leg that begins with other joints."""
    return urdf_text([*joints, KNEE], TIP)


FILES = {
    "empty": "",
    "cut short": VALID[:200],
    "binary": "\0\x01 binary",
    "a mesh": "<mesh/>",
    "xacro": '<xacro:x xmlns:xacro="http://ros.org/xacro"/>',
    "no link": '<robot name="r"/>',
    "an axis in letters": VALID.replace("1.0 0.0 0.0", "a b c"),
    "an axis that is none": VALID.replace('xyz="1.0 0.0 0.0"', 'xyz="nan 0 0"'),
    "limits upside down": VALID.replace('lower="-2.5"', 'lower="3.0"'),
    "a parent that is not there": VALID.replace('parent link="link_1"', 'parent link="hand"'),
    "a prismatic joint": jointed(Joint((0, 0, 0), X, kind="prismatic")),
    "a floating joint": jointed(Joint((0, 0, 0), X, kind="floating")),
    "a planar joint": jointed(Joint((0, 0, 0), X, kind="planar")),
    "a joint without an axis": jointed(Joint((0, 0, 0), (0, 0, 0))),
    "a joint that mimics": jointed(Joint((0, 0, 0), X, extra='<mimic joint="arm_joint"/>')),
}
FRAMES = (
    *(("pelvis", "tip"), ("link_0", ""), ("tip", "link_0"), ("arm", "tip"), ("link_2", "tip")),
    ("tip", "tip"),
)


def test_what_is_no_leg_is_refused_in_words_of_ours_alone(tmp_path, snapshot, capfd):
    cases = {name: {"text": text} for name, text in FILES.items()}
    cases |= {
        f"from {base} to {foot}": {"text": VALID, "base": base, "foot": foot}
        for base, foot in FRAMES
    }
    for kind in ("revolute", "prismatic"):  # a position beyond its range has its unit
        text = jointed(Joint((0, 0, 0), X, kind=kind))
        cases[f"a {kind} joint at 3"] = {"text": text, "locked": {"joint_1": 3.0}}
        leg_of(tmp_path, text, locked={"joint_1": 2.5 + 1e-10})  # rounded
    snapshot.refusals("robots", lambda case: leg_of(tmp_path, **case), cases, FOLDER=tmp_path)
    assert capfd.readouterr() == ("", "")  # the parser's own complaints are in the message


def test_a_joint_that_is_locked_or_elsewhere_needs_no_range_and_one_must_be_left(tmp_path):
    fixed = urdf_text([Joint((0, 0, 0), X, lower=0.0, upper=0.0), KNEE, KNEE], TIP)
    for options in ({"base": "link_1"}, {"locked": {"joint_1": 0.0}}):
        assert leg_of(tmp_path, fixed, **options).joint_names == ("joint_2", "joint_3")
    with pytest.raises(UnsupportedLeg, match="every joint between 'link_0' and 'tip' is locked"):
        leg_of(tmp_path, VALID, locked={"joint_1": 0.1, "joint_2": 0.2})


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
