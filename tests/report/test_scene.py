"""The page with the moving robot: what the viewer in it is told, without a browser."""

import base64
import json
import re

import numpy as np
import pytest

from kinematics import Leg, urdf_path
from kinematics.scene import Scene
from planner.report.meshcat_scene import scene_page

PERIOD = 0.008
ROUNDING = 1e-12  # positions of some decimetres [m]


@pytest.fixture(scope="module")
def scene():
    return Scene.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")


@pytest.fixture(scope="module")
def leg():
    return Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")


def _shown(leg, samples=40):
    phase = 2.0 * np.pi * np.arange(samples)[:, None] / samples
    desired = np.array([0.1, 0.3, 1.0]) + 0.3 * np.sin(phase + np.array([0.0, 1.0, 2.0]))
    each = [desired, 0.8 * desired, 0.95 * desired]
    feet = [leg.foot_positions(angles) for angles in each]
    feet[1] = feet[1] - np.array([0.0, 0.0, 0.02])
    return each, feet


def _page(scene, shown, **settings):
    pytest.importorskip("meshcat", reason="needs the extra meshcat")
    return scene_page(scene, *shown, **{"period": PERIOD, "cyclic": True, "title": "t", **settings})


def _commands(page):
    umsgpack = pytest.importorskip("umsgpack", reason="needs the extra meshcat")
    (listed,) = re.findall(r"const commands = (\[.*?\]);", page)
    return [umsgpack.unpackb(base64.b64decode(each)) for each in json.loads(listed)]


@pytest.fixture(scope="module")
def commands(scene, leg):
    return _commands(_page(scene, _shown(leg)))


def test_the_foot_is_animated_along_its_path_in_real_time_and_for_ever(commands, leg):
    (told,) = [each for each in commands if each["type"] == "set_animation"]
    assert told["options"] == {"play": True, "repetitions": float("inf")}
    clips = {each["path"]: each["clip"] for each in told["animations"]}
    assert len(clips) == 3 * 5
    clip = clips["/meshcat/planned/visuals/front_left_ball_0"]
    assert clip["fps"] == 1.0 / PERIOD
    keys = {track["name"]: track["keys"] for track in clip["tracks"]}
    foot = _shown(leg)[1][2]
    (root,) = [
        each["matrix"]
        for each in commands
        if each["type"] == "set_transform" and each["path"] == "/meshcat/planned"
    ]
    to_base = np.array(root).reshape(4, 4).T
    values = np.array([key["value"] for key in keys[".position"]]) @ to_base[:3, :3].T
    values += to_base[:3, 3]
    assert [key["time"] for key in keys[".position"]] == list(range(41))
    assert np.max(np.abs(values - np.concatenate([foot, foot[:1]]))) <= ROUNDING
    assert len(keys[".quaternion"]) == 41
