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


def test_the_foot_is_animated_along_its_path_in_real_time_and_for_ever():
    pytest.importorskip("meshcat", reason="needs the extra meshcat")
    umsgpack = pytest.importorskip("umsgpack", reason="needs the extra meshcat")
    place = {"base": "body", "foot": "front_left_ball"}
    scene, leg = (of.from_urdf(urdf_path("ers210a.urdf"), **place) for of in (Scene, Leg))
    phase = 2.0 * np.pi * np.arange(40)[:, None] / 40
    desired = np.array([0.1, 0.3, 1.0]) + 0.3 * np.sin(phase + np.array([0.0, 1.0, 2.0]))
    shown = [share * desired for share in (1.0, 0.8, 0.95)]
    feet = [leg.foot_positions(angles) for angles in shown]
    page = scene_page(scene, shown, feet, period=PERIOD, cyclic=True, title="t")
    (listed,) = re.findall(r"const commands = (\[.*?\]);", page)
    commands = [umsgpack.unpackb(base64.b64decode(each)) for each in json.loads(listed)]
    (told,) = [each for each in commands if each["type"] == "set_animation"]
    assert told["options"] == {"play": True, "repetitions": float("inf")}
    clips = {each["path"]: each["clip"] for each in told["animations"]}
    assert len(clips) == 3 * 5
    clip = clips["/meshcat/planned/visuals/front_left_ball_0"]
    assert clip["fps"] == 1.0 / PERIOD
    keys = {track["name"]: track["keys"] for track in clip["tracks"]}
    (root,) = [
        each["matrix"]
        for each in commands
        if each["type"] == "set_transform" and each["path"] == "/meshcat/planned"
    ]
    to_base = np.array(root).reshape(4, 4).T
    values = np.array([key["value"] for key in keys[".position"]]) @ to_base[:3, :3].T
    values += to_base[:3, 3]
    assert [key["time"] for key in keys[".position"]] == list(range(41))
    assert np.max(np.abs(values - np.concatenate([feet[2], feet[2][:1]]))) <= ROUNDING
    assert len(keys[".quaternion"]) == 41
