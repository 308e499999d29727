"""A stream plans from what is known nearly as well as the whole is planned, within its bounds."""

import copy
import math
import pickle
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import planner
from planner.arrays import reversals, rms
from planner.model.joint import acting_requests
from planner.model.law import State
from planner.planning import tick
from planner.planning.tick import EXCEEDING, JOINT, RESTING, SAMPLE, Problem
from tests.from_python import from_python
from tests.instances import ERS210A, attainable, joint_of, random_model, saturating
from tests.model.rounded_periods import rounded_periods

pytestmark = pytest.mark.filterwarnings("ignore:preview:UserWarning")  # short ones are quick
PREVIEW = 25

NO_ROWS = ("another shape", "one row", "no row", "ragged", "nothing", "text")

cost, gauss_newton_step = from_python(tick.cost), from_python(tick.gauss_newton_step)
SAMPLES, RADIUS, DAMPING = 30, 0.2, 1e-3
LOWER, UPPER, RATE, SMOOTHING = -0.3, 0.4, 0.4, 2e-3


def stretches(path, preview=PREVIEW):
    """What is known at every tick; at the end of the path its last row is held."""
    return [path[k : k + preview] for k in range(len(path))]


def streamed(models, path, preview=PREVIEW, **options):
    """The requests along a path (n, k)."""
    stream = planner.Stream(models, preview=preview, **options)
    return np.array([stream.step(rows) for rows in stretches(path, preview)])


def smooth_path(samples=200, joints=1):
    time = 0.008 * np.arange(samples)[:, np.newaxis]
    return 0.4 - 0.4 * np.cos(2.0 * np.pi * (1.0 + 0.2 * np.arange(joints)) * time)


def random_joint(seed):
    """A random joint, with friction, an offset and speeds that differ at every other seed."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, whole=False, hold=1 + seed % 3, offset=bool(seed % 2))
    if seed % 2:
        model = replace(
            model,
            dead_band=model.theta_0 * rng.uniform(0.05, 0.3),
            v_offset=model.v_max * rng.uniform(-0.3, 0.3),
        )
    return rng, model


@pytest.mark.parametrize("rows", [2, 10])
def test_a_preview_no_longer_than_lag_and_acceleration_time_is_warned_of(rows):
    models = {"hip": replace(ERS210A, lag=0.0), "knee": ERS210A, "toe": replace(ERS210A, lag=0.008)}
    told = rf"preview: got {rows} rows, .* of knee take 10 rows of 8 ms: .* 200 ms are 25$"
    with pytest.warns(UserWarning, match=told):
        planner.Stream(models, preview=rows)
    planner.Stream(models, preview=11)


def test_rows_beyond_the_preview_have_no_effect_and_the_last_of_too_few_is_held():
    one, two = (planner.Stream(ERS210A, preview=20) for _ in range(2))
    path = smooth_path(80)
    for k in range(30):
        assert np.array_equal(one.step(path[k : k + 20]), two.step(path[k : k + 45]))
    padded = np.concatenate([path[30:42], np.repeat(path[41:42], 8, axis=0)])
    assert np.array_equal(one.step(path[30:42]), two.step(padded))  # the last row is held


@pytest.mark.parametrize("seed", range(4))
def test_with_the_whole_path_in_view_a_stream_is_as_good_as_the_whole_plan(seed):
    rng, model = random_joint(2 * seed)
    make = saturating if seed % 2 else attainable
    path = make(rng, model, samples=60)
    whole = planner.invert_optimal(model, path, cyclic=False)
    sent = streamed(model, path[:, np.newaxis], preview=60)[:, 0]
    angles = planner.simulate(model, sent, cyclic=False)
    assert rms(angles - path) <= 1.05 * whole.rms + 2e-3 * model.theta_0


def whole_and_streamed(joint, path, cycles):
    """Root mean square errors of whole plans, and of streams that expect these cycles [rad]."""
    errors = []
    for cycle in cycles:
        sent = streamed([joint] * path.shape[1], path, cycle=cycle)
        angles = [planner.simulate(joint, each, cyclic=False) for each in sent.T]
        errors.append(rms(np.transpose(angles) - path))
    whole = [planner.invert_optimal(joint, each, cyclic=False).rms for each in path.T]
    return rms(np.array(whole)), *errors


def walked(phase):
    """The reference walk at phases in cycles [rad], shape (n, 3)."""
    desired = planner.reference_walk().desired
    rows = (phase % 1.0) * len(desired)
    every = np.arange(len(desired) + 1)
    return np.transpose([np.interp(rows, every, np.append(each, each[0])) for each in desired.T])


def test_a_walk_at_top_speed_is_followed_as_the_whole_plan_where_its_cycle_is_known():
    path = walked(np.arange(4 * 88) / 88.0)
    whole, without, exact, guessed = whole_and_streamed(ERS210A, path, (None, 88, 80))
    assert without >= 1.12 * whole
    assert exact <= 1.1 * whole
    assert guessed <= 1.1 * whole


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), cycle=st.sampled_from([None, 6]))
def test_limits_and_steps_are_kept_to_the_last_bit(seed, cycle):
    rng = np.random.default_rng(seed)
    models = [random_joint(int(rng.integers(8)))[1] for _ in range(2)]
    models[1] = models[1].requested_every(models[0].period)
    lower = rng.uniform(-1.0, -0.1, 2)
    upper = lower + rng.uniform(0.0, 1.5, 2)
    step = rng.uniform(0.001, 0.3, 2)
    stream = planner.Stream(models, preview=8, limits=(lower, upper), max_step=step, cycle=cycle)
    last = None
    for k in range(25):
        path = rng.normal(size=(int(rng.integers(1, 12)), 2)) * rng.choice([0.1, 1.0, 50.0])
        if rng.random() < 0.1:
            path[-1, 0] = rng.choice([np.nan, np.inf, 1e300])
        measured = rng.normal(size=2) if rng.random() < 0.5 else None
        if k == 0:
            measured = np.zeros(2)
        sent = stream.step(path, measured, missed=int(rng.integers(0, 3)))
        assert np.all(sent >= lower)
        assert np.all(sent <= upper)
        if last is not None:
            assert np.all(np.abs(sent - last) <= step)
        last = sent


def test_the_largest_step_is_planned_for_and_not_only_cut():
    model, path = ERS210A, smooth_path(200)
    path[100:] = path[100]  # a corner
    free, bound = (streamed(model, path, max_step=each)[:, 0] for each in (None, np.radians(3.0)))
    assert np.max(np.abs(np.diff(free))) > np.radians(4.0)
    error = rms(planner.simulate(model, bound, cyclic=False) - path[:, 0])
    assert error <= 1.3 * rms(planner.simulate(model, free, cyclic=False) - path[:, 0]) + 1e-3


BAD = {
    "not finite": (np.full((5, 2), np.nan), ("held", "held")),
    "one joint not finite": (np.array([[0.1, np.nan]] * 5), ("planned", "held")),
    "infinite": (np.array([[0.1, np.inf]] * 5), ("planned", "held")),
    "no angle": (np.full((5, 2), 1e12), ("held", "held")),
    "another shape": (np.zeros((5, 3)), ("held", "held")),
    "one row": (np.zeros(2), ("held", "held")),
    "no row": (np.zeros((0, 2)), ("held", "held")),
    "ragged": ([[0.1], [0.1, 0.2]], ("held", "held")),
    "nothing": (None, ("held", "held")),
    "text": ("straight on", ("held", "held")),
    "beyond the limits": (np.array([[0.1, 3.0]] * 5), ("planned", "unreachable")),
}


@pytest.mark.parametrize("bad", BAD)
def test_what_cannot_be_used_is_held_and_said(bad):
    desired, status = BAD[bad]
    models = [ERS210A] * 2
    stream = planner.Stream(models, preview=10, limits=(-1.0, 1.0))
    strict = planner.Stream(models, preview=10, limits=(-1.0, 1.0), on_bad="raise")
    path = smooth_path(60, 2)
    for rows in stretches(path[:20], 10):
        last = stream.step(rows)
        strict.step(rows)
    assert stream.status == ("planned", "planned")
    assert stream.problem == ""
    sent = stream.step(desired)
    assert stream.status == status
    assert "desired" in stream.problem
    assert ("of shape (10, 2)" in stream.problem) == (bad in NO_ROWS)
    held = np.array([each == "held" for each in status])
    assert np.array_equal(sent[held], last[held])
    assert np.all(np.abs(sent) <= 1.0)
    with pytest.raises(planner.InvalidInput, match="desired"):
        strict.step(desired)
    for k in range(20, 40):  # it goes on, and finds back
        stream.step(path[k : k + 10])
    assert stream.status == ("planned", "planned")


def test_nothing_is_sent_before_anything_is_known_and_the_first_request_holds_the_joints():
    stream = planner.Stream(ERS210A, preview=10)
    for bad in (np.nan, np.inf, 1e200):
        assert np.isnan(stream.step(np.full((10, 1), bad))).all()
        assert stream.status == ("held",)
    assert np.array_equal(stream.step(np.full((10, 1), np.nan), [0.2]), [0.2])
    assert np.array_equal(planner.Stream(ERS210A, preview=10).step([0.3]), [0.3])
    model = replace(ERS210A, offset=0.05)
    stream = planner.Stream(model, preview=10)
    assert stream.step(np.ones((10, 1)), [0.2])[0] == pytest.approx(0.15, abs=1e-15)
    assert stream.angles[0] == 0.2


@pytest.mark.parametrize("cycle", [None, 20])
def test_missed_ticks_are_simulated_with_the_last_request_held(cycle):
    model, path = ERS210A, smooth_path(120)
    stream, sent, k = planner.Stream(model, preview=PREVIEW, cycle=cycle), [], 0
    for missed in [0] * 30 + [3] + [0] * 20 + [7] + [0] * 20:
        k += missed
        sent += [sent[-1]] * missed if sent else []
        sent.append(stream.step(path[k : k + PREVIEW], missed=missed)[0])
        k += 1
    angles = planner.simulate(model, sent, cyclic=False)
    assert stream.angles[0] == pytest.approx(angles[-1], abs=1e-12)
    stream.step(path[:PREVIEW], missed=10**400)
    assert stream.angles[0] == pytest.approx(sent[-1], abs=1e-9)


def test_predicted_angles_are_those_of_the_exact_models():
    models = [random_joint(seed)[1].requested_every(0.02) for seed in range(4)]
    path = smooth_path(60, 4)
    stream, sent, angles = planner.Stream(models, preview=12), [], []
    for rows in stretches(path, 12):
        sent.append(stream.step(rows))
        angles.append(stream.angles)
    for j, model in enumerate(models):
        exact = planner.simulate(model, np.array(sent)[:, j], cyclic=False, start=path[0, j])
        assert np.max(np.abs(np.array(angles)[:, j] - exact)) <= 1e-12


def test_a_dead_band_is_not_crossed_for_noise():
    band = math.radians(2.0)
    model = joint_of(5.0, 0.3, 0.02, 0.05, tick=0.005, hold=4, dead_band=band)
    rng = np.random.default_rng(0)
    held = 0.3 + rng.normal(0.0, 0.05 * band, 200)
    sent = streamed(model, held[:, np.newaxis], preview=10)[:, 0]
    assert np.sum(np.abs(np.diff(sent))) <= 20.0 * band  # 100 crossings would be 200
    stream = planner.Stream(model, preview=10)
    counted = [  # a joint that rests where its encoder flickers between two counts
        stream.step([[0.3]], [0.3 + 0.0015 * (rng.random() < 0.5)])[0] for _ in range(200)
    ]
    assert np.ptp(counted) <= 0.5 * band
    slow = 0.3 * np.sin(2.0 * np.pi * np.arange(300) / 150.0)
    sent = streamed(model, slow[:, np.newaxis], preview=10)[:, 0]
    angles = planner.simulate(model, sent, cyclic=False)
    assert rms(angles - slow) <= 0.1 * band
    assert reversals(sent, cyclic=False) <= 20


def test_a_load_at_every_step_is_planned_for():
    model = replace(ERS210A, compliance=0.1, speed_per_torque=0.8, dead_band=0.01)
    path = smooth_path(200)
    torques = 0.8 * np.sin(path)
    stream, rows = (
        planner.Stream(model, preview=PREVIEW),
        zip(stretches(path), stretches(torques), strict=True),
    )
    sent = [stream.step(known, load=load)[0] for known, load in rows]
    angles = planner.simulate(model, sent, cyclic=False, load=torques[:, 0], start=path[0, 0])
    assert stream.angles[0] == pytest.approx(angles[-1], abs=1e-12)
    whole = planner.invert_optimal(model, path[:, 0], cyclic=False, load=torques[:, 0])
    assert rms(angles - path[:, 0]) <= 1.1 * whole.rms + 1e-3
    last = stream.step(path[:PREVIEW], load=0.5)
    assert stream.status == ("planned",)
    for load in (1e6, math.nan, math.inf, "heavy"):
        assert np.array_equal(stream.step(path[:PREVIEW], load=load), last)
        assert stream.status == ("held",)
        assert "load" in stream.problem


def test_a_load_is_one_number_one_for_each_joint_or_one_for_each_row():
    model = replace(ERS210A, compliance=0.1, speed_per_torque=0.8, dead_band=0.01)
    one, two, three = (planner.Stream([ERS210A, model], preview=PREVIEW) for _ in range(3))
    alone = planner.Stream(model, preview=PREVIEW)
    for rows in stretches(smooth_path(60, 2)):
        sent = one.step(rows, load=0.3)
        assert np.array_equal(sent, two.step(rows, load=[0.3, 0.3]))
        assert np.array_equal(sent, three.step(rows, load=np.full(rows.shape, 0.3)))
        assert sent[1] == alone.step(rows[:, 1:], load=0.3)[0]  # beside one that feels no load
    assert np.array_equal(one.step(rows), two.step(rows, load=0.0))  # a load ends with its step
    assert one.status == two.status == ("planned", "planned")


def test_an_angle_that_friction_holds_is_within_reach_of_the_limits():
    model = replace(ERS210A, dead_band=0.05)
    stream = planner.Stream(model, preview=PREVIEW, limits=(-1.0, 1.0))
    for angle, status in ((1.04, "planned"), (-1.04, "planned"), (1.06, "unreachable")):
        stream.step([angle])
        assert stream.status == (status,)


@pytest.mark.parametrize("hold", [1, 4])
def test_a_measured_angle_far_off_moves_the_predicted_one_by_what_the_joint_turns_in_a_period(hold):
    model = replace(ERS210A, hold=hold)
    stream = planner.Stream(model, preview=10)
    for measured in (0.4, 0.4, 2.4):
        stream.step([[0.4]], [measured])
    before = stream.angles[0]
    stream.step([[0.4]], [2.4])  # counts from the second time on
    assert stream.angles[0] - before == pytest.approx(model.v_max * model.period, rel=1e-9)


def measuring(path, readings):
    """Requests along a path, and problems, where the encoder reads ``readings(tick, angle)``."""
    joint = ERS210A
    slower = replace(joint, v_max=0.95 * joint.v_max)  # the joint is not quite its model
    stream = planner.Stream(joint, preview=PREVIEW)
    sent, problems = [], []
    for k, rows in enumerate(stretches(path)):
        angle = planner.simulate(slower, sent, cyclic=False)[-1] if len(sent) > 1 else path[0, 0]
        sent.append(float(stream.step(rows, [readings(k, angle)])[0]))
        problems.append(stream.problem)
    return np.array(sent), problems


def test_an_encoder_that_starts_again_by_a_turn_does_not_move_the_requests():
    path = smooth_path(120) + 6.0
    sound, _ = measuring(path, lambda _, angle: angle)
    wrapped, problems = measuring(path, lambda _, angle: angle % (2.0 * np.pi))
    np.testing.assert_allclose(wrapped, sound, rtol=0.0, atol=1e-9)
    assert not any(problems)
    again, _ = measuring(path, lambda k, angle: angle - 4.0 * np.pi * (k > 50))
    np.testing.assert_allclose(again, sound, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("jump", [0.6, -2.5, 3.4])
def test_a_measured_angle_that_no_joint_could_have_reached_is_missing_and_said(jump):
    path = smooth_path(120)
    missing, _ = measuring(path, lambda k, angle: math.nan if k in (40, 80) else angle)
    jumping, problems = measuring(path, lambda k, angle: angle + jump * (k in (40, 80)))
    assert np.array_equal(jumping, missing)
    assert [k for k, problem in enumerate(problems) if problem] == [40, 80]
    assert problems[40].startswith("measured: joint_1 is ")
    assert problems[40].endswith("8 ms before, which no joint can be: taken as missing")


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda stream: pickle.loads(pickle.dumps(stream))]
)
@pytest.mark.parametrize(
    "options", [{"on_bad": "raise"}, {"cycle": 50, "max_step": 0.1, "limits": (-1.0, 1.0)}]
)
def test_a_copy_of_a_stream_goes_on_alike_and_on_its_own(copied, options):
    joint, path = ERS210A, smooth_path(140)
    stream = planner.Stream({"knee": joint}, preview=PREVIEW, **options)
    rows = stretches(path)
    for each in rows[:80]:
        stream.step(each)
    again = copied(stream)
    assert again.names == ("knee",)
    told = [again.step(each) for each in rows[80:]]
    np.testing.assert_array_equal(told, [stream.step(each) for each in rows[80:]])
    for each in (stream, again):
        with pytest.raises(planner.InvalidInput) if "on_bad" in options else nullcontext():
            each.step(np.full((PREVIEW, 1), np.nan))


@pytest.mark.parametrize("cycle", [None, 30])
def test_a_stream_that_was_reset_is_as_new(cycle):
    _, model = random_joint(1)
    path = smooth_path(90)
    new, used = (planner.Stream(model, preview=PREVIEW, cycle=cycle) for _ in range(2))
    for k, rows in enumerate(stretches(path)):
        used.step(rows, path[k] if k < 5 else None, missed=k % 2)
    used.reset()
    for k, rows in enumerate(stretches(path + 0.3)):
        read = path[k] + 0.3 + 2.0 * (k in (1, 40))
        np.testing.assert_array_equal(used.step(rows, read), new.step(rows, read))
        assert (used.status, used.problem) == (new.status, new.problem)
        assert ("taken as missing" in new.problem) == (k in (1, 40))


def joint(number):
    """A joint: plain, with friction, with inertia; the fifth with one request between samples."""
    rng = np.random.default_rng(number)
    model = random_model(rng, whole=False, offset=True)
    if number == 4:
        return replace(model, lag=0.0, acceleration_time=0.004)
    if number % 2:
        model = replace(model, dead_band=0.1 * model.theta_0, compliance=0.02, hold=3)
    if number > 1:
        model = replace(model, time_constant=0.02)
    return replace(model, max_acceleration=40.0 * model.v_max) if number == 3 else model


class Plan:
    """A plan that reaches limits and the largest step, at angles that its goal is not at."""

    def __init__(self, model, seed, *, begins=False):
        rng = np.random.default_rng(seed)
        self.model, self.begins = model, begins
        self.past = max(acting_requests(model).width - 1, 1)
        self.angle, self.speed = rng.normal(0.0, 0.1), rng.normal(0.0, 0.005)
        self.load = rng.uniform(-0.5, 0.5, SAMPLES)
        self.samples = np.zeros(SAMPLES, dtype=SAMPLE)
        self.samples["load_sag"] = model.compliance * self.load
        self.samples["faster"] = model.faster_per_tick(self.load)
        self.samples["goal"] = 2.0 * np.cos(0.2 * np.arange(SAMPLES))
        self.samples["count"] = np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.0, 0.3)
        self.samples["rounded"] = (model.law.gain * RADIUS * model.theta_0) ** 2
        self.resting = self.samples["goal"] - model.sag(self.load)
        self.samples["resting"] = self.resting
        self.requests = np.clip(rng.normal(0.0, 0.4, self.past + SAMPLES), LOWER, UPPER)
        joints = np.zeros(1, dtype=JOINT)
        joints["lower"], joints["upper"] = LOWER, UPPER
        joints["max_step"], joints["smoothing"] = RATE, SMOOTHING
        before, weights = State(self.angle, self.speed), acting_requests(model).weights[0]
        problem = Problem(joints[0], model.law, weights, self.samples, before, begins)
        self.step = np.zeros(SAMPLES)
        self.cost = gauss_newton_step(problem, self.requests, DAMPING, self.step)
        self.exact_cost = cost(problem, self.requests, np.inf)


def linearised(plan):
    """Exact angles under its requests, and their derivatives by those of the plan."""
    ages = acting_requests(plan.model)
    acting = np.arange(SAMPLES)[:, np.newaxis] - np.arange(ages.width)
    windows = plan.requests[plan.past + acting]

    def period(i, state, radius):
        at, during = slice(i, i + 1), plan.load[i : i + 1]
        angle, speed = state[np.newaxis].T
        return rounded_periods(plan.model, angle, windows[at], radius, moving=speed, load=during)

    state, slope = np.array([plan.angle, plan.speed]), np.zeros((2, SAMPLES))
    angles, slopes = np.empty(SAMPLES), np.empty((SAMPLES, SAMPLES))
    for i in range(SAMPLES):
        rounded = period(i, state, RADIUS)
        slope = rounded.by_state[0] @ slope
        for j in range(ages.width):
            if acting[i, j] >= 0:
                slope[:, acting[i, j]] += rounded.by_request[0, :, j]
        state = period(i, state, 0.0).states[0]
        angles[i], slopes[i] = state[0], slope[0]
    return angles, slopes


def normal_equations(plan, angles, slopes):
    """Cost, gradient and damped Gauss-Newton matrix, dense."""
    requests, weights = plan.requests[plan.past :], plan.samples["count"]
    difference = np.eye(SAMPLES) - np.eye(SAMPLES, k=-1)
    changes = np.diff(plan.requests[plan.past - 1 :])
    excess = changes - np.clip(changes, -RATE, RATE)
    errors, away = angles - plan.samples["goal"], requests - plan.resting
    cost = np.sum(weights * errors**2) + SMOOTHING * np.sum(changes**2)
    cost += EXCEEDING * np.sum(excess**2) + RESTING * np.sum(away**2)
    forces = SMOOTHING * changes + EXCEEDING * excess
    gradient = slopes.T @ (weights * errors) + difference.T @ forces + RESTING * away
    per_change = SMOOTHING + EXCEEDING * (excess != 0.0)
    matrix = slopes.T @ (weights[:, np.newaxis] * slopes)
    matrix += difference.T @ (per_change[:, np.newaxis] * difference)
    matrix += (RESTING + DAMPING) * np.eye(SAMPLES)
    return cost, gradient, matrix


@pytest.mark.parametrize("begins", [False, True])
@pytest.mark.parametrize("number", range(5))
def test_the_step_solves_the_normal_equations_of_the_requests_that_limits_leave_free(
    number, begins
):
    fixed = 0
    for seed in range(3):
        plan = Plan(joint(number), seed, begins=begins)
        cost, gradient, matrix = normal_equations(plan, *linearised(plan))
        assert plan.cost == pytest.approx(cost, rel=1e-10)
        assert plan.exact_cost == plan.cost  # to the last bit: equal plans are equally good
        requests = plan.requests[plan.past :]
        free = ~((requests == LOWER) & (gradient > 0.0) | (requests == UPPER) & (gradient < 0.0))
        fixed += np.count_nonzero(~free)
        free[0] &= not begins
        step = np.zeros(SAMPLES)
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], gradient[free])
        assert np.max(np.abs(plan.step - step)) <= 1e-9 * np.max(np.abs(step))
    assert fixed
