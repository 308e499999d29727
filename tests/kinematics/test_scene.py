"""What a robot looks like is where its kinematics say, and of the shapes that its URDF says."""

import coal
import numpy as np
import pinocchio
import pytest

from kinematics import Leg, urdf_path
from kinematics.scene import Scene

SAME = 1e-12  # two ways to the same position [m], or the same cosine

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


def places(scene, angles, names):
    """Where named shapes are in the base frame [m] by Pinocchio's own placements, (n, 3) each."""
    model, shapes, found = scene.robot.model, scene.moving, []
    data, of_shapes = model.createData(), shapes.createData()
    for pose in map(scene.robot.configuration, angles):
        pinocchio.updateGeometryPlacements(model, data, shapes, of_shapes, pose)
        to_base = pinocchio.SE3(scene.to_base)
        found.append(
            [(to_base * of_shapes.oMg[shapes.getGeometryId(name)]).translation for name in names]
        )
    return np.swapaxes(np.array(found), 0, 1)


def shapes_of(file):
    scene = Scene.from_urdf(file, base="base", foot="foot")
    return [shape for shape in scene.moving.geometryObjects if "knee" not in shape.name]


@pytest.mark.parametrize(("urdf", "base", "foot"), LEGS.values(), ids=LEGS)
def test_the_foot_that_is_seen_is_where_the_leg_has_it(urdf, base, foot):
    scene = Scene.from_urdf(urdf_path(urdf), base=base, foot=foot)
    leg = Leg.from_urdf(urdf_path(urdf), base=base, foot=foot)
    assert scene.robot.joint_names == leg.joint_names
    angles = ANGLES[:, : len(leg.joint_names)]
    (seen,) = places(scene, angles, [f"{foot}_0"])
    assert np.max(np.abs(seen - leg.foot_positions(angles))) <= SAME
    last = [shape.name for shape in scene.moving.geometryObjects].index(f"{foot}_0")
    for row, position in zip(angles, seen, strict=True):
        assert scene.places(row)[scene.still.ngeoms + last] == pytest.approx(position, abs=SAME)


def test_a_leg_without_shapes_is_drawn_as_bones_from_joint_to_foot(tmp_path):
    file = _robot(tmp_path, "")
    scene = Scene.from_urdf(file, base="base", foot="foot")
    leg = Leg.from_urdf(file, base="base", foot="foot")
    angles = np.array([[0.0], [0.4]])
    ball, middle = places(scene, angles, ["knee ball", "knee bone"])
    assert np.allclose(ball, [0.0, 0.0, 0.5], rtol=0.0, atol=SAME)
    assert np.allclose(2.0 * middle - ball, leg.foot_positions(angles), rtol=0.0, atol=SAME)
    bone = scene.moving.geometryObjects[scene.moving.getGeometryId("knee bone")]
    assert bone.geometry.halfLength == pytest.approx(0.5 * np.hypot(0.1, 0.2))
    along = bone.placement.rotation[:, 2]
    assert np.allclose(along, np.array([0.1, 0.0, -0.2]) / np.hypot(0.1, 0.2))


@pytest.mark.parametrize("name", ["package://my_robot/meshes/t.stl", "meshes/t.stl"])
def test_meshes_are_found_below_the_package_and_scaled(tmp_path, name):
    package = tmp_path / "my_robot"
    (package / "urdf" / "meshes").mkdir(parents=True)
    (package / "meshes").mkdir()
    for folder in (package / "meshes", package / "urdf" / "meshes"):
        (folder / "t.stl").write_text(TETRAHEDRON)
    visual = _visual(f'<mesh filename="{name}" scale="1 2 0.5"/>')
    (shape,) = shapes_of(_robot(package / "urdf", visual))
    assert isinstance(shape.geometry, coal.BVHModelBase)
    assert shape.geometry.num_tris == 4
    assert np.allclose(shape.geometry.vertices().max(axis=0), [1.0, 2.0, 0.5])
    assert np.all(shape.meshScale == 1.0)


def test_what_cannot_be_drawn_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr("kinematics.scene.MOST_BYTES", len(TETRAHEDRON) - 1)
    (tmp_path / "large.stl").write_text(TETRAHEDRON)
    (tmp_path / "broken.stl").write_bytes(b"solid \xff no mesh")
    (tmp_path / "mesh.step").write_text(TETRAHEDRON)
    geometries = [
        '<mesh filename="missing.stl"/>',
        '<mesh filename="large.stl"/>',
        '<mesh filename="broken.stl"/>',
        '<mesh filename="mesh.step"/>',
    ]
    file = _robot(tmp_path, "".join(_visual(each) for each in geometries))
    assert shapes_of(file) == []


def test_what_hangs_on_a_locked_joint_alone_stays():
    settings = {"base": "body", "foot": "front_left_ball"}
    file = urdf_path("ers210a.urdf")
    free = Scene.from_urdf(file, **settings)
    first, *others = free.robot.joint_names
    scene = Scene.from_urdf(file, **settings, locked={first: 0.4})
    assert list(scene.robot.joint_names) == others
    assert 0 < scene.moving.ngeoms < free.moving.ngeoms
    assert scene.still.ngeoms + scene.moving.ngeoms == free.still.ngeoms + free.moving.ngeoms
