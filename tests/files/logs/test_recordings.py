"""Recordings of real servos come through as their publishers describe them."""

from __future__ import annotations

import numpy as np
import pytest

from planner import LogOptions, joints_in, read_logs

DIGITS = 1e-5
"""The CSV copies of BAM's recordings keep six digits of about 1 [rad, s]."""

RUNS = {
    "2024-10-26_12h23m27": "sin_sin",
    "2024-10-26_12h23m42": "lift_and_drop",
    "2024-10-26_12h24m55": "sin_time_square",
    "2024-10-26_12h27m27": "up_and_down",
}
"""BAM's recordings of the STS3250 and their CSV copies."""


def test_all_joints_of_the_so101_are_read_the_jaw_as_a_share(recordings):
    file = recordings / "so101" / "prbs_excitation.csv"
    joints = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")
    assert joints_in(file) == joints
    logs = read_logs(file, options=LogOptions(joint="all", unit="rad,Jaw=range"))
    assert tuple(log.joint for log in logs) == joints
    assert [log.unit for log in logs] == ["rad"] * 5 + ["1"]
    for log in logs:
        assert len(log.times) == 6000
        assert log.period == pytest.approx(0.02006, abs=1e-5)
    raw = [np.sqrt(np.mean((log.requests - log.angles)[3000:] ** 2)) for log in logs]
    np.testing.assert_allclose(raw, [0.069, 0.067, 0.068, 0.063, 0.048, 0.0645], rtol=0.05)


@pytest.mark.parametrize("run", RUNS)
def test_bams_json_and_its_csv_copy_are_the_same_log(recordings, run):
    (log,) = read_logs(recordings / "bam_json" / f"{run}.json")
    (copy,) = read_logs(recordings / "sts3250" / f"sts3250_kp32_{RUNS[run]}.csv")
    np.testing.assert_allclose(log.times, copy.times, atol=DIGITS)
    np.testing.assert_allclose(log.requests, copy.requests, atol=DIGITS)
    np.testing.assert_allclose(log.angles, copy.angles, atol=DIGITS)
    np.testing.assert_array_equal(log.torque_on, copy.torque_on)


def test_the_g1_is_read_by_the_names_of_its_joints(recordings):
    folder = recordings / "lerobot_g1"
    joints = joints_in(folder)
    assert len(joints) == 26
    options = LogOptions(joint="kRightElbow", unit="rad")
    logs = read_logs(folder, options=options)
    assert [log.name.rpartition(", ")[2] for log in logs] == ["episode 0", "episode 61"]
    for log in logs:
        assert log.period == pytest.approx(1 / 30, abs=1e-5)
        assert np.corrcoef(log.requests, log.angles)[0, 1] > 0.9
    single = folder / "data" / "chunk-000" / "episode_000061.parquet"
    (alone,) = read_logs(single, options=options)
    np.testing.assert_array_equal(alone.angles, logs[1].angles)
