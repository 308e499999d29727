"""BAM's JSON: one entry a sample, in radians, with the torque's switch."""

import json
import math

from planner import joints_in, read_logs
from tests.files.logs.told import told

# Time [s], goal and position [rad] of every entry
SAMPLES = [(0.01, 0.0, 0.1), (0.03, 0.5, 0.2), (0.06, 1.0, 0.3), (0.08, 1.5, 0.4)]


def _entries(**changes):
    entries = [
        {
            "position": position,
            "speed": math.nan,
            "load": 0,
            "timestamp": time,
            "goal_position": goal,
            "torque_enable": k != 2,
            **changes.get(f"entry_{k}", {}),
        }
        for k, (time, goal, position) in enumerate(SAMPLES)
    ]
    return {"entries": entries}


READ = {
    "a motor": {"motor": "sts3250", **_entries()},
    **{
        f"a servo that is off, {off}, with the goal {goal}": _entries(
            entry_2={"goal_position": goal, "torque_enable": off}
        )
        for goal in (None, math.nan)
        for off in (False, 0, 0.0)
    },
    "a pendulum": {"mass": 1.2, "length": 0.15, **_entries()},
    "a pendulum and its arm": {"mass": 1.2, "arm_mass": 0.2, "length": 0.15, **_entries()},
    "a mass without a length": {"mass": 1.2, **_entries()},
    "no angle of a pendulum": {
        "mass": 1.2,
        "length": 0.15,
        **_entries(entry_2={"position": None}),
    },
}

BAD = {
    "empty": "",
    "cut short": '{"entries": [\n{"position": 0.0,',
    "another format": {"times": [0, 1], "angles": []},
    "a list": [1, 2],
    "no entry": {"entries": []},
    "an entry that is a number": {"entries": [{"position": 0}, 3]},
    "another key": {"entries": [{"timestamp": 0, "goal_pos": 0, "position": 0}]},
    "text for a number": _entries(entry_1={"position": "0.1"}),
    "torque in words": _entries(entry_0={"torque_enable": "on"}),
    "unsorted": _entries(entry_2={"timestamp": 0.02}),
    **{
        f"a mass of {mass}": {"mass": mass, "length": 0.1, **_entries()}
        for mass in ("a pendulum", True, -1.0, math.nan, 1e300)
    },
}


def _read(file, content):
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_logs(file)


def test_entries_are_rows_and_the_weight_of_a_pendulum_is_the_load(tmp_path, snapshot):
    file = tmp_path / "run.json"
    said = [f"{name}\n{told(_read(file, content))}" for name, content in READ.items()]
    snapshot.check("bam_read", "".join(said))
    assert joints_in(file) == ("",)


def test_what_cannot_be_read_is_reported_with_its_place(tmp_path, snapshot):
    file = tmp_path / "run.json"
    snapshot.refusals("bam", lambda content: _read(file, content), BAD, FILE=file)
