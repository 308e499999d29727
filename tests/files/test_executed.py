"""Histories of learning: one that is not of this path, or damaged, is refused with its place."""

import json

import numpy as np
import pytest

from planner import InvalidFile, JointModel, Learning, Trial
from planner.files.executed import read_executed, read_history, read_measured, write_history

ROWS, JOINTS = 3, ["hip", "knee", "foot"]
DESIRED = np.full((ROWS, 2), 0.5)


def _state(models):
    requests, measured = np.zeros((ROWS, models)), np.zeros((2, ROWS, models))
    trials = (Trial(requests=requests, measured=measured, error=0.1),) * 2
    learning = Learning(
        trials=trials,
        noise=np.zeros(models),
        gain=1.0,
        reidentified=(0,) * models,
        delays=(),
        best=0,
        floor=(0.0, 0.0),
    )
    return (JointModel.ers210a(),) * models, learning


def _trial(content, plan, key, value):
    content["plans"][plan]["learning"]["trials"][1][key] = value


CHANGES = {
    "another format": lambda c: c.update(format="request-planner refine 0"),
    "a plan of another joint": lambda c: c["plans"].update(tail=c["plans"].pop("knee")),
    "a row less": lambda c: c["desired"].pop(),
    "a joint less": lambda c: c.update(desired=[[0.5]] * ROWS),
    "another angle": lambda c: c["desired"][1].__setitem__(1, 0.5 + 1.1e-6),
    "a joint's requests of two": lambda c: _trial(c, "knee", "requests", [[0.0, 0.0]] * ROWS),
    "a foot's angles of one": lambda c: _trial(c, "foot", "measured", [[[0.0]] * ROWS]),
    "angles of a row more": lambda c: _trial(c, "knee", "measured", [[[0.0]] * 4]),
    "a request without end": lambda c: _trial(c, "knee", "requests", [[0.0], [-1e300], [0.0]]),
    "an angle that is none": lambda c: _trial(c, "foot", "measured", [[[0.0, None]] * ROWS]),
    "an error in words": lambda c: _trial(c, "knee", "error", "small"),
    "no gain": lambda c: c["plans"]["knee"]["learning"].pop("gain"),
    "no joint's model": lambda c: c["plans"]["knee"]["models"][0].update(lag=-1.0),
}


def test_a_history_that_is_not_of_this_path_or_damaged_is_refused(tmp_path, snapshot):
    file, other = tmp_path / "FILE", tmp_path / "OTHER"
    write_history(str(file), DESIRED, {"knee": _state(1), "foot": _state(2)})
    content = json.loads(file.read_text())
    content["desired"][1][1] = 0.5 + 0.9e-6  # files carry angles rounded
    file.write_text(json.dumps(content))
    assert list(read_history(str(file), JOINTS, DESIRED)) == ["knee", "foot"]

    def read(change):
        changed = json.loads(file.read_text())
        change(changed)
        other.write_text(json.dumps(changed))
        read_history(str(other), JOINTS, DESIRED)

    snapshot.refusals("learning_history", read, CHANGES, FILE=other)


@pytest.mark.parametrize("columns", ["arm_actual_deg", "requested_deg,actual_deg"])
def test_measured_cycles_in_the_place_of_the_requests_are_refused(columns, tmp_path):
    log, cells = tmp_path / "m.csv", ",1" * (1 + columns.count(","))
    log.write_text(f"t_s,{columns}\n0{cells}\n0.02{cells}\n")
    with pytest.raises(InvalidFile, match=r"REQUESTS come first, MEASURED second$"):
        read_executed(str(log), ["arm"], 2, 0.02)
    log.write_text("t_s,position_deg\n0,1\n0.02,2\n")  # a joint of this name
    assert read_executed(str(log), ["position"], 2, 0.02).names == ("position",)


def test_percent_are_read_of_a_path_in_shares_and_angles_are_not(tmp_path):
    (tmp_path / "requests.csv").write_text("t_s,jaw_range\n0,0.25\n0.02,0.5\n0.04,0.75\n")
    executed = read_executed(str(tmp_path / "requests.csv"), ["jaw"], 3, 0.02)
    about = {"period": 0.02, "cyclic": True, "units": executed.units, "cycles": None}
    log, rows = tmp_path / "log.csv", "\n0,25\n0.02,50\n0.04,75\n"
    log.write_text(f"t_s,jaw_percent{rows}")
    _, angles, _ = read_measured([str(log)], executed, **about)
    assert angles[0] == pytest.approx(executed.values)
    for column, message in (
        ("jaw_deg", "'jaw' is in deg, expected range as in the path"),
        ("claw_percent", "no column jaw_deg or jaw_rad or jaw_percent"),
    ):
        log.write_text(f"t_s,{column}{rows}")
        with pytest.raises(InvalidFile, match=message):
            read_measured([str(log)], executed, **about)
