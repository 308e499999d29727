"""What may be said about a log, what the page says of it, and recordings of real servos."""

import re
from pathlib import Path

import numpy as np
import pytest

from planner import LogOptions, joints_in, read_logs
from planner.arrays import MOST_TURNS
from planner.files import columns
from planner.files.logs import csv_log, rows
from planner.files.logs.bag import ACTUAL_TYPES, REQUEST_TYPES
from planner.identification.log import SLOWEST

BAD = {
    "an unknown unit": {"unit": "radd"},
    "an unknown unit of one joint": {"unit": "rad,Jaw=inch"},
    "no ticks": {"ticks_per_turn": 0},
    "ticks in words": {"ticks_per_turn": "4096"},
    "a joint by its place": {"joint": 3},
    "episodes backwards": {"episodes": "3-1"},
    "episodes in words": {"episodes": "first"},
    "more episodes than there can be": {"episodes": "0-999999999"},
}

DIGITS = 1e-5  # the CSV copies of BAM's recordings keep six digits of about 1 [rad, s]


def test_options_that_fit_no_log_are_refused(snapshot):
    snapshot.refusals("log_options", lambda options: LogOptions(**options), BAD)


PAGE = (Path(__file__).parents[3] / "docs" / "logs.md").read_text(encoding="utf-8")


def test_the_page_has_a_command_for_every_format():
    commands = re.findall(r"^    request-planner identify (\S+)", PAGE, re.MULTILINE)
    for ending in ("csv", "parquet", "json", "mcap", "bag", "my_dataset", "my_bag"):
        assert any(path.endswith(ending) for path in commands)


def test_the_page_names_every_unit_and_type():
    for unit in sorted(set(columns.ANGLE_NAMES.values())):
        assert f"| `{unit}` |" in PAGE
    for kind in {*ACTUAL_TYPES, *REQUEST_TYPES}:
        assert f"| `{kind.replace('/msg/', '/')}` |" in PAGE


def test_every_word_that_the_page_says_is_guessed_is_known():
    bullets = dict(re.findall(r"^- (\S+ \S+)(.*?)(?:;|\.)$", PAGE, re.MULTILINE | re.DOTALL))
    known = {
        "the time": columns.WORDS | {f"_{unit}" for unit in columns.SECONDS},
        "requested angles": columns.ROLE_WORDS["requested"],
        "actual angles": columns.ROLE_WORDS["actual"] | columns.ROLE_WORDS["position"],
        "the torque,": {*csv_log.TORQUES},
    }
    for bullet, words in known.items():
        told = re.findall(r"`(\w+)`", bullets[bullet])
        assert told
        assert set(told) <= words


def test_the_numbers_of_the_page_are_the_codes():
    assert f"more than {MOST_TURNS:.0f} turns in radians" in PAGE
    assert f"less than {rows.LEAST_DEG:.0f} degrees" in PAGE
    assert f"more than {SLOWEST:.0f} s or less than {rows.FASTEST * 1e6:.0f} µs" in PAGE
    assert f"asks from {rows.SPARSE:g} s on" in PAGE
    assert f"beyond {rows.MOST_SHARE:.0f} either way" in PAGE


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
