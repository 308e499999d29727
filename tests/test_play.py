"""The player keeps its times, says how well, and stops safely; on a clock of its own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.robot.play import ramp
from tests.instances import joint_of

TICK = 1.0 / 128.0
"""A period whose multiples floating point has exactly [s], so that times can be compared."""

ROUNDING = 1e-12  # sums of a few thousand such times [s], and of angles of some rad
WALK = np.array([[0.0, 1.0], [0.1, 0.9], [0.2, 0.8], [0.1, 0.9]])
pytestmark = pytest.mark.filterwarnings("ignore:preview:UserWarning")  # short ones are quick
JOINT = joint_of(5.0, 0.15, 2.0 * TICK, 3.0 * TICK, tick=TICK)
PATH = 0.2 - 0.2 * np.cos(np.linspace(0.0, 6.0, 60))[:, np.newaxis]


class Robot:
    """A clock that only sleeping and sending advance, and a record of what came when."""

    sending = oversleep = stall = 0.0
    stall_at = fail_at = failure = None

    def __init__(self, **settings):
        self.time, self.rows, self.times, self.stops = 100.0, [], [], 0
        vars(self).update(settings)

    def now(self):
        return self.time

    def sleep(self, duration):
        assert duration > 0.0
        self.time += duration + self.oversleep

    def send(self, row):
        if self.fail_at == len(self.rows):
            raise self.failure
        self.rows.append(row)
        self.times.append(self.time)
        self.time += self.stall if self.stall_at == len(self.rows) - 1 else self.sending

    def stop(self):
        self.stops += 1

    def own(self, settings):
        own = {"send": self.send, "on_stop": self.stop, "now": self.now, "sleep": self.sleep}
        return own | settings

    def play(self, **settings):
        return planner.play(WALK, period=TICK, **self.own(settings))


def test_every_request_is_sent_at_its_time_and_the_last_is_held_for_its_period():
    robot = Robot()
    report = robot.play(cycles=3)
    assert robot.times == [100.0 + k * TICK for k in range(12)]
    assert np.array_equal(robot.rows, np.tile(WALK, (3, 1)))
    assert robot.time == 100.0 + 12 * TICK
    assert report == planner.Playback(sent=12)
    assert robot.stops == 1


def test_lateness_does_not_add_up():
    robot = Robot(sending=0.3 * TICK, oversleep=0.1 * TICK)
    report = robot.play(cycles=1000)
    assert report.sent == 4000
    assert report.skipped == report.overruns == 0
    assert report.latest == pytest.approx(0.1 * TICK, abs=ROUNDING)
    assert report.mean_lateness == pytest.approx(0.1 * TICK * 3999 / 4000, abs=ROUNDING)
    assert robot.times[-1] - 100.0 == pytest.approx(3999.1 * TICK, abs=1e-9)


def test_what_is_overdue_is_skipped_but_for_the_last_and_the_rest_is_in_step_with_the_clock():
    robot = Robot(stall_at=2, stall=3.5 * TICK)
    report = robot.play(cycles=3)
    assert report.skipped == 2  # requests 3 and 4: by then request 5 is due
    assert report.overruns == 1
    assert report.latest == 0.5 * TICK
    numbers = [0, 1, 2, 5, 6, 7, 8, 9, 10, 11]
    assert np.array_equal(robot.rows, [WALK[k % 4] for k in numbers])
    assert robot.times[4:] == [100.0 + k * TICK for k in numbers[4:]]
    assert report.mean_lateness == pytest.approx(0.05 * TICK)  # over the ten that were sent
    robot = Robot(stall_at=0, stall=99.0)
    report = robot.play(cycles=1)
    assert np.array_equal(robot.rows, WALK[[0, 3]])
    assert report.skipped == 2
    assert report.latest == 99.0 - 3 * TICK


def test_ctrl_c_ends_a_walk_for_ever_and_is_reported():
    robot = Robot(fail_at=41, failure=KeyboardInterrupt())
    report = robot.play()
    assert (report.interrupted, report.failed, report.sent) == (True, False, 41)
    assert str(report).startswith("interrupted after 41 requests: 0.00 ms late on average")
    assert robot.stops == 1


def test_errors_of_sending_and_stopping_leave_a_report_of_what_was_sent():
    robot, told = Robot(fail_at=2, failure=OSError("the cable is out")), []
    with pytest.raises(OSError, match="the cable is out"):
        robot.play(cycles=1, report=lambda playback: told.append((playback, robot.stops)))
    assert told == [(planner.Playback(sent=2, failed=True), 1)]
    assert str(told[0][0]).startswith("failed after 2 requests")
    assert np.array_equal(robot.rows, WALK[:2])  # nothing is sent after an error
    robot, told = Robot(), []

    def stop():
        raise OSError("no answer")

    with pytest.raises(OSError, match="no answer"):
        robot.play(cycles=1, on_stop=stop, report=told.append)
    assert told == [planner.Playback(sent=4)]


def test_a_robot_is_led_to_the_first_request_no_faster_than_the_limit():
    robot, speed = Robot(), 0.5
    report = robot.play(cycles=1, current=[0.1, 0.7], speed=speed)
    rows = np.vstack([[0.1, 0.7], robot.rows[:-4], WALK[0]])
    assert np.max(np.abs(np.diff(rows, axis=0))) <= speed * TICK + ROUNDING
    assert len(rows) == 1 + int(np.ceil(0.3 / (speed * TICK)))
    assert np.array_equal(robot.rows[-4:], WALK)
    assert robot.times == [100.0 + k * TICK for k in range(len(robot.times))]
    assert report.sent == len(robot.rows)


@given(
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.floats(0.01, 10.0),
    st.sampled_from([0.002, 0.008, 0.02]),
)
def test_a_ramp_is_even_keeps_its_speed_and_wastes_no_time(start, goal, speed, period):
    rows = ramp([start, 0.0], np.array([goal, 0.0]), speed=speed, period=period)
    steps = np.diff(np.concatenate([[start], rows[:, 0], [goal]]))
    assert np.allclose(steps, steps[0], rtol=0.0, atol=ROUNDING)
    assert np.max(np.abs(steps)) <= speed * period + ROUNDING
    assert len(rows) <= abs(goal - start) / (speed * period) + ROUNDING < len(rows) + 1 + 1e-9
    assert not rows[:, 1].any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"current": [0.0, 0.0], "speed": 1e-6},
            "speed: got 1e-06 rad/s, for a ramp of 1e+06 s; expected a faster one",
        ),
        *(({name: None}, f"{name}: got None, expected a function") for name in ("now", "sleep")),
    ],
)
def test_nothing_is_sent_where_the_input_is_wrong(changes, message):
    robot = Robot()
    with pytest.raises(planner.InvalidInput) as caught:
        robot.play(**{"cycles": 1, **changes})
    assert str(caught.value) == message
    assert robot.rows == []


class Following(Robot):
    """A robot whose angles can be read, and what was asked of it."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.stream, self.asked = planner.Stream(JOINT, preview=12), []

    def follow(self, desired=PATH, **settings):
        return planner.follow(self.stream, desired, **self.own(settings))

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
    robot = Following(stall_at=20, stall=3.5 * TICK)
    report = robot.follow()
    assert (report.sent, report.skipped, report.overruns) == (58, 2, 1)
    assert robot.times[21] == 100.0 + 23.5 * TICK  # late, and in step with the clock
    assert robot.times[22] == 100.0 + 24 * TICK
    held = [*robot.rows[:21], *[robot.rows[20]] * 2, *robot.rows[21:]]
    angles = planner.simulate(JOINT, np.array(held)[:, 0], cyclic=False)
    assert robot.stream.angles[0] == pytest.approx(angles[-1], abs=1e-9)


@pytest.mark.parametrize(("stall_at", "skipped"), [(57, 2), (58, 1), (59, 0)])
def test_no_tick_beyond_the_end_of_a_path_is_skipped(stall_at, skipped):
    report = Following(stall_at=stall_at, stall=20.5 * TICK).follow()
    assert (report.sent, report.skipped) == (60 - skipped, skipped)


def test_a_function_gives_stretches_until_it_ends_and_bad_ones_are_counted():
    robot = Following()

    def desired(tick):
        return None if tick == 30 else np.full((5, 1), np.nan) if tick == 10 else PATH[tick:]

    report = robot.follow(desired)
    assert (report.sent, report.held) == (30, 1)
    assert str(report).endswith("0 skipped, 1 held")
    assert np.array_equal(robot.rows[10], robot.rows[9])


class TwoJoints:
    """A stream of two joints that knows nothing of one at its second tick, and then holds it."""

    def __init__(self):
        self.period, self.status = TICK, ()
        self.answers = [
            ([0.1, 0.2], ("planned", "planned")),
            ([0.1, np.nan], ("planned", "held")),
            ([0.1, 0.2], ("held", "planned")),
        ]

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
    robot, reports = Following(fail_at=5, failure=KeyboardInterrupt()), []
    assert robot.follow().interrupted
    robot.fail_at, robot.failure = 8, OSError("the bus is gone")
    with pytest.raises(OSError, match="the bus is gone"):
        robot.follow(report=reports.append)
    assert reports[0].failed
    assert robot.stops == 2
