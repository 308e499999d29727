"""Tables of servos in model files: read as they are, or refused with the line that is wrong."""

from __future__ import annotations

import math

import pytest

from planner import InvalidFile
from planner.files.joint_model import read_servos
from planner.robot.arm import Servo

SERVO = {
    "id": "7",
    "zero_tick": "2000",
    "direction": "-1",
    "ticks_per_turn": "1228.8",
    "limits": "[-0.5, 1.5]",
    "p_gain": "16",
}


def written(tmp_path, **changes):
    """A model file whose joint ``knee`` has a servo; None leaves a key out."""
    keys = {name: value for name, value in (SERVO | changes).items() if value is not None}
    table = "\n".join(f"{name} = {value}" for name, value in keys.items())
    file = tmp_path / "arm.toml"
    file.write_text(f"v_max = 5.0\n\n[knee.servo]\n{table}\n")
    return file


@pytest.mark.parametrize(
    ("changes", "line", "message"),
    [
        ({"id": None}, 3, r"\[knee.servo\] has no id"),
        ({"id": "253"}, None, "got the identifier 253, expected 0 to 252"),
        ({"direction": "0"}, None, "direction: got 0, expected 1 or -1"),
        ({"id": "1.5"}, 4, "id: got 1.5, expected a whole number"),
        ({"id": "true"}, 4, "id: got True, expected a whole number"),
        ({"zero_tick": '"left"'}, 5, "zero_tick: got 'left', expected a whole number"),
        ({"ticks_per_turn": "true"}, 7, "ticks_per_turn: got True, expected a number"),
        ({"limits": "[-inf, inf]"}, 8, "limits: got .*, expected two angles"),
        ({"limits": "[0.1]"}, 8, "limits: got .*, expected two angles"),
        ({"limits": "0.5"}, 8, "limits: got 0.5, expected two angles"),
        ({"p_gain": "1.5"}, 9, "p_gain: got 1.5, expected a whole number"),
        ({"p_gian": "3"}, 10, "unknown key 'p_gian' .did you mean 'p_gain'"),
        ({"limits": "[1.5, -0.5]"}, None, "limits: got .*, expected the lower one first"),
    ],
)
def test_a_servo_that_is_none_is_refused(tmp_path, changes, line, message):
    with pytest.raises(InvalidFile, match=message) as error:
        read_servos(written(tmp_path, **changes))
    assert error.value.line == line


def test_a_file_without_servos_says_what_is_missing(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text("v_max = 5.0\n\n[knee]\nlag = 0.03\n")
    assert read_servos(file, optional=True) == {}
    with pytest.raises(InvalidFile, match="no table of a servo; expected tables such as"):
        read_servos(file)


def test_counts_and_angles_of_a_servo_are_each_others_inverse():
    servo = Servo(id=1, zero_tick=2000, direction=-1, ticks_per_turn=4096)
    assert servo.angle(2000) == 0.0
    assert servo.angle(2000 + 1024) == pytest.approx(-math.pi / 2.0)
    assert [servo.count(servo.angle(count)) for count in (0, 1999, 4095)] == [0, 1999, 4095]
