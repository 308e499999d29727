"""What a robot looks like is where its kinematics say, and of the shapes that its URDF says."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics import InvalidUrdf, Leg, UnknownFrame, urdf_path
from kinematics.scene import Scene
from kinematics.shapes import PLAIN, read_shapes

SAME = 1e-12
"""Two ways to the same position [m], or the same cosine."""

LEGS = {
    "reference": ("reference_leg.urdf", "hip", "foot"),
    "front left": ("ers210a.urdf", "body", "front_left_ball"),
    "hind right": ("ers210a.urdf", "body", "hind_right_ball"),
    "below the shoulder": ("ers210a.urdf", "hind_left_shoulder", "hind_left_ball"),
}

ANGLES = np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 0.9], [-0.7, 1.1, 1.8]])

TETRAHEDRON = "\n".join(
    [
        "solid t",
        *(
            f"facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet"
            for a, b, c in (
                ("0 0 0", "0 1 0", "1 0 0"),
                ("0 0 0", "1 0 0", "0 0 1"),
                ("0 0 0", "0 0 1", "0 1 0"),
                ("1 0 0", "0 1 0", "0 0 1"),
            )
        ),
        "endsolid t",
    ]
)


def _robot(tmp_path, visual, *, top="", name="robot.urdf"):
    """A leg of one joint whose link looks like ``visual``."""
    file = tmp_path / name
    file.write_text(
        f'<robot name="r">{top}<link name="base"/><link name="shank">{visual}</link>'
        '<joint name="knee" type="revolute"><parent link="base"/><child link="shank"/>'
        '<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        '<joint name="ankle" type="fixed"><parent link="shank"/><child link="foot"/>'
        '<origin xyz="0.1 0 -0.2"/></joint><link name="foot"/></robot>'
    )
    return file


def _visual(geometry, rest=""):
    return f"<visual>{rest}<geometry>{geometry}</geometry></visual>"


@pytest.mark.parametrize(("urdf", "base", "foot"), LEGS.values(), ids=LEGS)
def test_the_foot_that_is_seen_is_where_the_leg_has_it(urdf, base, foot):
    scene = Scene.from_urdf(urdf_path(urdf), base=base, foot=foot)
    leg = Leg.from_urdf(urdf_path(urdf), base=base, foot=foot)
    assert scene.joint_names == leg.joint_names
    number = [body.name for body in scene.bodies].index(foot)
    angles = ANGLES[:, : len(leg.joint_names)]
    seen = scene.placements(angles)[:, number]
    assert np.max(np.abs(seen[:, :3, 3] - leg.foot_positions(angles))) <= SAME
    assert np.max(np.abs(np.swapaxes(seen[:, :3, :3], 1, 2) @ seen[:, :3, :3] - np.eye(3))) <= SAME


def test_only_the_leg_moves():
    scene = Scene.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")
    moves = np.ptp(scene.placements(ANGLES), axis=0).max(axis=(1, 2)) > SAME
    assert [body.name for body in scene.bodies if body.moves] == [
        f"front_left_{part}" for part in ("shoulder", "upper", "lower", "ball")
    ]
    assert moves.tolist() == [body.moves for body in scene.bodies]


def test_shapes_are_those_of_the_urdf():
    shapes = read_shapes(urdf_path("reference_leg.urdf"))
    assert shapes["hip"] == ()
    (box,) = shapes["upper"]
    assert (box.kind, box.size) == ("box", (0.034, 0.03, 0.078))
    assert box.placement[:3, 3].tolist() == [0.0, 0.0, -0.032]
    assert box.colour == (0.75, 0.76, 0.79, 1.0)
    kinds = [(shape.kind, shape.size) for shape in shapes["lower"]]
    assert kinds == [("cylinder", (0.0135, 0.069)), ("cylinder", (0.0165, 0.032))]


@given(st.tuples(*[st.floats(-7.0, 7.0)] * 3))
def test_shapes_are_turned_as_pinocchio_turns_frames(tmp_path_factory, turn):
    folder = tmp_path_factory.mktemp("turned")
    rpy = " ".join(str(angle) for angle in turn)
    visual = _visual('<sphere radius="1"/>', f'<origin rpy="{rpy}"/>')
    (sphere,) = read_shapes(_robot(folder, visual))["shank"]
    expected = pinocchio.rpy.rpyToMatrix(*turn)
    assert np.max(np.abs(sphere.placement[:3, :3] - expected)) <= SAME


def test_a_leg_without_shapes_is_drawn_as_bones_from_joint_to_foot(tmp_path):
    file = _robot(tmp_path, "")
    scene = Scene.from_urdf(file, base="base", foot="foot")
    leg = Leg.from_urdf(file, base="base", foot="foot")
    ((_, bone),) = [body.shapes for body in scene.bodies]
    angles = np.array([[0.0], [0.4]])
    placed = scene.placements(angles)[:, 0] @ bone.placement
    ends = placed @ np.array([[0, 0, -0.5 * bone.size[1], 1], [0, 0, 0.5 * bone.size[1], 1]]).T
    assert np.allclose(ends[:, :3, 0], [0.0, 0.0, 0.5], rtol=0.0, atol=SAME)
    assert np.allclose(ends[:, :3, 1], leg.foot_positions(angles), rtol=0.0, atol=SAME)


def test_colours_come_from_the_material_or_from_one_of_its_name(tmp_path):
    top = '<material name="red"><color rgba="1 0 0 0.5"/></material>'
    ball = '<sphere radius="1"/>'
    visuals = [
        _visual(ball, '<material name="red"/>'),
        _visual(ball, '<material name="own"><color rgba="0 1 0 1"/></material>'),
        _visual(ball, '<material name="unknown"/>'),
        _visual(ball),
    ]
    shapes = read_shapes(_robot(tmp_path, "".join(visuals), top=top))["shank"]
    assert [shape.colour for shape in shapes] == [(1, 0, 0, 0.5), (0, 1, 0, 1), PLAIN, PLAIN]


@pytest.mark.parametrize("name", ["package://my_robot/meshes/t.stl", "meshes/t.stl"])
def test_meshes_are_found_below_the_package_and_scaled(tmp_path, name):
    package = tmp_path / "my_robot"
    (package / "urdf" / "meshes").mkdir(parents=True)
    (package / "meshes").mkdir()
    for folder in (package / "meshes", package / "urdf" / "meshes"):
        (folder / "t.stl").write_text(TETRAHEDRON)
    visual = _visual(f'<mesh filename="{name}" scale="1 2 0.5"/>')
    (shape,) = read_shapes(_robot(package / "urdf", visual))["shank"]
    assert shape.kind == "mesh"
    corners = shape.surface.vertices[shape.surface.faces]
    assert corners.shape == (4, 3, 3)
    assert np.allclose(corners.reshape(-1, 3).max(axis=0), [1.0, 2.0, 0.5])


def test_what_cannot_be_drawn_is_left_out(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid \xff no mesh")
    (tmp_path / "mesh.step").write_text(TETRAHEDRON)
    geometries = [
        '<mesh filename="missing.stl"/>',
        '<mesh filename="broken.stl"/>',
        '<mesh filename="mesh.step"/>',
        "",
        "<capsule/>",
    ]
    file = _robot(tmp_path, "".join(_visual(each) for each in geometries))
    assert read_shapes(file)["shank"] == ()


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ('<box size="1 2"/>', "<box size='1 2'>: expected 3 numbers separated by spaces"),
        ('<sphere radius="nan"/>', "<sphere radius='nan'>: expected 1 numbers"),
        ('<cylinder radius="1"/>', "<cylinder length=''>: expected 1 numbers"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(tmp_path, geometry, message):
    with pytest.raises(InvalidUrdf) as caught:
        read_shapes(_robot(tmp_path, _visual(geometry)))
    assert message in str(caught.value)


def test_a_scene_is_refused_like_a_leg(tmp_path):
    with pytest.raises(UnknownFrame, match="foot: frame 'toe' is not in the URDF"):
        Scene.from_urdf(urdf_path("reference_leg.urdf"), base="hip", foot="toe")
    with pytest.raises(InvalidUrdf, match="cannot be read"):
        Scene.from_urdf(tmp_path / "missing.urdf", base="hip", foot="foot")
    with pytest.raises(InvalidUrdf, match="cannot be read"):
        read_shapes(tmp_path / "missing.urdf")
