"""Model files: what they say of joints, legs, bus and servos is read, written and read again."""

import tomllib
from math import inf

import pytest
from hypothesis import given

from planner import InvalidFile, JointModel, read_models
from planner.files.joint_model import (
    models_text,
    read_bus,
    read_legs,
    read_model_file,
    read_servos,
)
from tests.strategies import models

ROBOT = """# an arm and two legs
bus = "feetech"
port = "/dev/ttyUSB0"
v_max = 5.0
theta_0 = 0.1
lag = 0.03
acceleration_time = 0.05
expected_error = 0.01
tested_speed = 3.0
tested_load = 0.5
tested_angles = [-0.5, 0.25]
error_by_acceleration = [[1.0, 0.01], [20.0, 0.03]]
delay_error = 0.004
error_spread = [0.5, 1.5]
error_over_delay = 0.6
verdict = "usable"
verdict_reason = 'it "misses" 4 % of the motion'

[knee]
lag = 0.02
v_max_interval = [4.5, inf]
gain_interval = [50.00000000001, 51.5]
correlations = [[1.0, -0.5], [-0.5, 1.0]]
expected_error = 0.02
[knee.servo]
id = 7
zero_tick = 2000
direction = -1
ticks_per_turn = 1228.8
limits = [-0.5, 1.5]
p_gain = 16

["wrist roll".servo]
id = 0
["wrist roll"]
dead_band = 0.02

[leg.front]
urdf = "../robot.urdf"
base = "body"
foot = "ball"
near_deg = { knee = 90, "hip yaw" = -45.0 }
[leg."rear left"]
lock_deg = { tail = 180.0 }
base = "torso"
urdf = "robots/other.urdf"
foot = "tip \\"2\\""
"""


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(ROBOT)
    return file


@pytest.mark.parametrize("name", ["hüfte", "🦾", 'left "knee"', "a.b"])
def test_joints_may_have_any_name(name, tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(models_text({name: JointModel.ers210a()}), "utf-8")
    assert set(read_models(file)) == {name}


def test_a_file_of_a_robot_is_read_written_and_read_again(tmp_path, file, snapshot):
    models, servos = read_models(file), read_servos(file)
    bus, legs = read_bus(file), read_legs(file)
    about = {"": {"": "any joint\nof all"}, "knee": {"lag": "[s] by hand"}}
    remarks = ["measured\ttwice", "and\nagain"]
    text = models_text(models, beside=file, remarks=remarks, about=about, servos=servos, bus=bus)
    again = tmp_path / "again.toml"
    again.write_text(text)
    assert read_models(again) == models
    assert [model.evidence for model in read_models(again).values()] == [
        model.evidence for model in models.values()
    ]
    assert read_servos(again) == servos
    assert read_bus(again) == bus == {"bus": "feetech", "port": "/dev/ttyUSB0"}
    assert read_legs(again) == legs
    intervals = {"v_max": (4.5, inf), "gain": (50.00000000001, 51.5)}
    assert models["knee"].evidence.intervals == intervals
    places = "".join(f"{name}: {leg}\n" for name, leg in legs.items())
    snapshot.check("robot", text + places.replace(str(tmp_path), "FOLDER"))


BAD = {
    "a negative error": ("expected_error = 0.01", "expected_error = -0.01"),
    "one angle": ("[-0.5, 0.25]", "-0.5"),
    "a pair for pairs": ("[[1.0, 0.01], [20.0, 0.03]]", "[1.0, 0.01]"),
    "two intervals of one": ("gain_interval", "theta_0_interval = [0.0, 1.0]\ngain_interval"),
    "a value above its interval": ("[4.5, inf]", "[4.5, 4.9]"),
    "a value below its interval": ("[50.00000000001, 51.5]", "[50.1, 51.5]"),
    "an interval upside down": ("[4.5, inf]", "[inf, 4.5]"),
    "a number for an interval": ("[4.5, inf]", "5.0"),
    "an unknown verdict": ('"usable"', '"good"'),
    "times of another unit": ("lag = 0.03", "lag = 9.96"),
    "degrees beside inherited intervals": (
        "[knee]\nlag = 0.02\nv_max_interval = [4.5, inf]\ngain_interval = [50.00000000001, 51.5]\n"
        "correlations = [[1.0, -0.5], [-0.5, 1.0]]\n",
        "theta_0_interval = [0.05, 0.2]\n[knee]\ntheta_0 = 3.15\n",
    ),
    "an unknown key of a joint": ("dead_band", "deadband"),
}

BAD_LEGS = {
    "no base and no foot": ('base = "body"\nfoot = "ball"\n', ""),
    "a number for a file": ('"../robot.urdf"', "3"),
    "an unknown key": ("lock_deg", "locked_deg"),
    "angles in a list": ('{ knee = 90, "hip yaw" = -45.0 }', "[90, -45.0]"),
    "an angle in words": ("tail = 180.0", "tail = 'left'"),
}

BAD_BUS = {
    "a number for a port": ('"/dev/ttyUSB0"', "3"),
    "an unknown bus": ('"feetech"', '"feetec"'),
    "an unknown kind": ('"feetech"', '"virtual:sts"'),
    "a rate of bits that is none": ('port = "/dev/ttyUSB0"', "baud_rate = 1e6"),
}

BAD_SERVOS = {
    "no identifier": ("id = 7\n", ""),
    "an identifier beyond all": ("id = 7", "id = 253"),
    "no direction": ("direction = -1", "direction = 0"),
    "one limit": ("[-0.5, 1.5]", "[0.1]"),
    "a number for limits": ("[-0.5, 1.5]", "0.5"),
    "limits upside down": ("[-0.5, 1.5]", "[1.5, -0.5]"),
    "half a gain": ("p_gain = 16", "p_gain = 1.5"),
    "an unknown key": ("p_gain", "p_gian"),
}


@pytest.mark.parametrize(
    ("name", "reads", "cases"),
    [
        ("models", [read_model_file], BAD),
        ("legs", [read_legs], BAD_LEGS),
        ("bus", [read_bus, read_model_file], BAD_BUS),
        ("servos", [read_servos], BAD_SERVOS),
    ],
)
def test_what_cannot_be_known_of_a_robot_is_refused(file, snapshot, name, reads, cases):
    for read in reads:

        def changed(change, read=read):
            file.write_text(ROBOT.replace(*change))
            read(file)

        snapshot.refusals(name, changed, cases, FILE=file)


def test_joints_may_be_called_leg_and_port_and_a_file_without_servos_says_so(file, tmp_path):
    model = "v_max = 5.0\ntheta_0 = 0.1\nlag = 0.03\nacceleration_time = 0.05\n"
    file.write_text(f"[leg]\n{model}[port]\n{model}")
    assert read_legs(file) == read_bus(file) == {}
    assert list(read_model_file(file).models) == ["leg", "port"]
    file = tmp_path / "model.toml"
    file.write_text("v_max = 5.0\n\n[knee]\nlag = 0.03\n")
    assert read_servos(file, optional=True) == {}
    with pytest.raises(InvalidFile, match="no table of a servo; expected tables such as"):
        read_servos(file)


@given(models(friction=True, inertia=True, poses=True))
def test_a_model_file_keeps_inertia_and_sag_and_leaves_them_out_where_there_are_none(
    tmp_path_factory, model
):
    file = tmp_path_factory.getbasetemp() / "any.toml"
    model.to_toml(file)
    assert JointModel.from_toml(file) == model
    keys = tomllib.loads(file.read_text()).keys()
    without = {"time_constant": 0.0, "max_acceleration": inf, "sag_sin": 0.0, "sag_cos": 0.0}
    assert {name for name, none in without.items() if getattr(model, name) != none} == {
        *(keys & without.keys())
    }
