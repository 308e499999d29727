"""The loop of a stream keeps its times, measures before it sends, and says what it missed."""

from __future__ import annotations

import numpy as np
import pytest

import planner
from tests.test_play import TICK, Robot

pytestmark = pytest.mark.filterwarnings("ignore:preview:UserWarning")  # short ones are quick

JOINT = planner.JointModel(
    v_max=5.0, theta_0=0.15, lag=2.0 * TICK, acceleration_time=3.0 * TICK, tick=TICK
)
PATH = 0.2 - 0.2 * np.cos(np.linspace(0.0, 6.0, 60))[:, np.newaxis]


class Following(Robot):
    """A robot whose angles can be read, and what was asked of it."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.stream = planner.Stream(JOINT, preview=12)
        self.asked = []

    def follow(self, desired=PATH, **settings):
        return planner.follow(
            self.stream,
            desired,
            send=self.send,
            on_stop=self.stop,
            now=self.now,
            sleep=self.sleep,
            **settings,
        )

    def measure(self):
        self.asked.append(len(self.rows))
        return [np.nan]


def test_every_tick_is_planned_and_sent_at_its_time():
    robot = Following()
    report = robot.follow(measure=robot.measure)
    assert robot.times == [100.0 + k * TICK for k in range(60)]
    stream = planner.Stream(JOINT, preview=12)
    assert np.array_equal(robot.rows, [stream.step(PATH[k:]) for k in range(60)])
    assert report == planner.Playback(sent=60)
    assert robot.asked == list(range(60))
    assert robot.time == 100.0 + 60 * TICK
    assert robot.stops == 1


def test_missed_ticks_are_left_out_and_the_stream_is_told():
    robot = Following()
    robot.stall_at, robot.stall = 20, 3.5 * TICK
    report = robot.follow()
    assert (report.sent, report.skipped, report.overruns) == (58, 2, 1)
    assert robot.times[21] == 100.0 + 23.5 * TICK  # late, and in step with the clock
    assert robot.times[22] == 100.0 + 24 * TICK
    held = [*robot.rows[:21], *[robot.rows[20]] * 2, *robot.rows[21:]]
    angles = planner.simulate(JOINT, np.array(held)[:, 0], cyclic=False)
    assert robot.stream.angles[0] == pytest.approx(angles[-1], abs=1e-9)


def test_a_function_gives_stretches_until_it_ends_and_bad_ones_are_counted():
    robot = Following()

    def desired(tick):
        return None if tick == 30 else np.full((5, 1), np.nan) if tick == 10 else PATH[tick:]

    report = robot.follow(desired)
    assert (report.sent, report.held) == (30, 1)
    assert str(report).endswith("0 skipped, 1 held")
    assert np.array_equal(robot.rows[10], robot.rows[9])


def test_what_is_not_known_yet_is_not_sent():
    robot = Following()
    report = robot.follow(lambda tick: np.full((5, 1), np.nan) if tick < 4 else None)
    assert robot.rows == []
    assert (report.sent, report.held) == (0, 4)


class TwoJoints:
    """A stream of two joints that knows nothing of one at its second tick, and then holds it."""

    period = TICK

    def __init__(self):
        self.answers = [
            ([0.1, 0.2], ("planned", "planned")),
            ([0.1, np.nan], ("planned", "held")),
            ([0.1, 0.2], ("held", "planned")),
        ]
        self.status = ()

    def step(self, desired, measured=None, *, missed=0):  # noqa: ARG002
        requests, self.status = self.answers.pop(0)
        return np.array(requests)


def test_a_row_with_one_unknown_request_is_not_sent_and_one_held_joint_counts():
    robot = Following()
    robot.stream = TwoJoints()
    report = robot.follow(np.zeros((3, 2)))
    assert np.array_equal(robot.rows, [[0.1, 0.2], [0.1, 0.2]])
    assert (report.sent, report.held) == (2, 2)


def test_ctrl_c_and_errors_end_it_as_they_end_the_player():
    robot, reports = Following(), []
    robot.fail_at, robot.failure = 5, KeyboardInterrupt()
    assert robot.follow().interrupted
    robot.fail_at, robot.failure = 8, OSError("the bus is gone")
    with pytest.raises(OSError, match="the bus is gone"):
        robot.follow(report=reports.append)
    assert reports[0].failed
    assert robot.stops == 2
