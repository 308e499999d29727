"""What `request-planner fit` can be asked for beyond a number of lines."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from planner import JointModel


def joint(result, name):
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)["joints"][name]


def test_lines_are_no_faster_than_a_joint_whose_requests_are_held(run, desired):
    """Two ticks to a request: by the tick alone they would be twice as fast."""
    model = JointModel(v_max=1.0, theta_0=0.1, lag=0.01, acceleration_time=0.02, tick=0.004, hold=2)
    model.to_toml("held.toml")
    with Path("held.toml").open("a") as file:
        file.write("[knee]\nv_max = 0.5\n")
    result = run("fit", desired, "--model", "held.toml", "--segments", "4", "--json")
    for name, fastest in (("hip", 1.0), ("knee", 0.5)):
        answer = joint(result, name)
        knots, values = np.array(answer["knots"]), np.radians(answer["values_deg"])
        speeds = np.diff(np.append(values, values[0])) / np.diff(np.append(knots, knots[0] + 88))
        assert np.max(np.abs(speeds)) / 0.008 == pytest.approx(fastest, rel=1e-6)
