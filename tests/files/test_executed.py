"""Histories of learning: one that is not of this path, or damaged, is refused with its place."""

import json

import numpy as np

from planner import JointModel, Learning, Trial
from planner.files.executed import read_history, write_history

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
        sensor_delays=(),
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
