"""Lower bounds: below every plan, valid whatever multipliers prove them, and the QP's optimum."""

import math
from dataclasses import replace

import clarabel
import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

import planner
from planner.arrays import error_norm
from planner.exceptions import InvalidInput, NoSteadyCycle, SolverFailed
from planner.model.joint import JointModel
from planner.model.response import load_by_period, motion_under, simulate
from planner.planning.bounds.certify import certify, lower_bound
from planner.planning.bounds.cvxpy_statement import stated_bound
from planner.planning.bounds.multipliers import bound_of, certified_error, nearest_motion
from planner.planning.bounds.reachable_set import reachable_set
from planner.planning.task import NORMS
from tests.instances import ERS210A, REFERENCE_JOINTS, random_model, saturating
from tests.plans import joint_task
from tests.strategies import INTEGRALS, models, trajectories

ROUNDING = 1e-9
"""Rounding of a bound on angles of a few radians, and the 1e-12 of the steady cycle [rad]."""

LINEAR_LEVELS = ("slope", "envelope")  # the levels that are proved by multipliers
ANY_MODEL = st.one_of(
    models(),
    models(friction=True),
    models(friction=True, inertia=True),
    models(friction=True, poses=True),
    models(friction=True, inertia=True, poses=True),
    models(friction=True, inertia=True, poses=True, integrals=INTEGRALS[1:]),
    models(friction=True, poses=True, overcome=True),
)

OPTIMAL = 1e-6  # how close the solver's multipliers come to the best ones [relative to the range]


def set_of(model, samples, *, cyclic, level, start=None, load=None):
    """The conditions of a level, whatever is desired."""
    task = joint_task(model, np.zeros(samples), cyclic=cyclic, start=start, load=load)
    return reachable_set(task, level)


def loads_of(model, samples, seed):
    """Torques within ±1 N m, constant, slow or different at every sample; or none."""
    rng = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.arange(samples) / samples
    kinds = [None, np.full(samples, rng.uniform(-1, 1)), np.sin(phase), rng.uniform(-1, 1, samples)]
    return kinds[rng.integers(4)] if model.feels_load else None


@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_the_bounds_on_the_reference_walk_are_the_known_ones(joint):
    known = {"slope": joint.slope_bound_deg, "envelope": joint.envelope_bound_deg}
    for level, bound in known.items():
        found = lower_bound(ERS210A, joint.desired, level=level)
        assert math.degrees(found) == pytest.approx(bound, abs=2e-4)


def at_every_tick(model, requests, load, *, cyclic, start=None):
    """Angles of every tick, each of its own sample: the load of a period acts in all its ticks."""
    torques = load_by_period(load, cyclic=cyclic)
    if torques is not None:
        torques = np.roll(np.repeat(torques, model.hold), 1 - model.hold)
    ticks, sent = replace(model, hold=1), np.repeat(requests, model.hold)
    return motion_under(ticks, sent, cyclic=cyclic, start=start, torques=torques)[0]


@pytest.mark.parametrize("kind", ["cyclic", "from rest", "from a start"])
@settings(max_examples=40)
@given(model=ANY_MODEL, requests=trajectories(least=4), seed=st.integers(0, 2**32 - 1))
def test_every_response_meets_the_conditions_of_every_level(kind, model, requests, seed):
    """The derivation itself, tick by tick, on requests that switch hard."""
    rng, cyclic = np.random.default_rng(seed), kind == "cyclic"
    load, start = loads_of(model, len(requests), seed), None
    if kind == "from a start":  # anywhere in the dead band
        held = requests[0] + rng.uniform(-1.0, 1.0) * model.dead_band
        start = float(model.rest(held, 0.0 if load is None else load[0]))
    elif rng.random() < 0.5:
        requests = np.sign(requests) * 2.0 * model.theta_0 + rng.normal(size=len(requests)) * 0.01
    every_tick = at_every_tick(model, requests, load, cyclic=cyclic, start=start)
    for level in LINEAR_LEVELS:
        asked = {"cyclic": cyclic, "level": level, "start": start, "load": load}
        reachable = set_of(model, len(requests), **asked)
        angles = every_tick[: reachable.matrix.shape[1]]
        assert angles.shape == (reachable.matrix.shape[1],)
        assert np.max(reachable.matrix @ angles - reachable.limits) <= 1e-10


def test_a_motor_meets_the_conditions_where_friction_stops_it_and_may_attain_its_bound():
    """It loses its speed in a tick in which the drive does not fall."""
    model = replace(ERS210A, acceleration_time=0.072, time_constant=0.08, dead_band=0.04)
    angles = simulate(model, np.repeat([0.0, 0.3], [5, 40]), cyclic=False)
    reachable = set_of(model, 45, cyclic=False, level="envelope")
    assert np.max(reachable.matrix @ angles - reachable.limits) <= 1e-10
    motor = replace(ERS210A, acceleration_time=0.008, time_constant=0.04)
    square = np.repeat([-0.3, 0.3], 20)
    plan = planner.invert_optimal(motor, square, smoothness=0.0)
    assert plan.lower_bound == lower_bound(motor, square)
    assert plan.rms <= 1.005 * plan.lower_bound


@pytest.mark.parametrize(
    "terms",
    [
        {"dead_band": 0.02},
        {"sag_cos": 0.02},
        {"time_constant": 0.02},
        {"max_acceleration": 300.0},
    ],
)
def test_the_answer_says_that_envelope_is_proved_of_a_joint_with_friction_gravity_or_inertia(terms):
    certificate = certify(replace(ERS210A, **terms), np.sin(np.arange(20.0)), level="exact")
    assert certificate.level == "envelope"


def test_no_bound_is_proved_of_a_joint_whose_speed_loop_has_an_integral():
    """It overshoots: its speed exceeds v_max, and its acceleration what condition 2a allows."""
    model = replace(ERS210A, time_constant=0.03, integral_rate=20.0)
    step = np.repeat([0.0, 2.0], 40)
    speeds = np.diff(planner.simulate(model, step, cyclic=False)) / model.period
    assert np.max(speeds) > 1.01 * model.v_max
    for level in ("slope", "envelope", "exact"):
        certificate = certify(model, step, level=level)
        assert certificate.bound == 0.0


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("level", LINEAR_LEVELS)
@pytest.mark.parametrize("cyclic", [True, False])
@settings(max_examples=20)
@given(
    model=st.one_of(models(offsets=False), models(friction=True, poses=True, overcome=True)),
    requests=trajectories(least=4, most=12),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_multipliers_of_linearised_conditions_prove_a_bound(
    norm, level, cyclic, model, requests, seed
):
    rng = np.random.default_rng(seed)
    n = len(requests)
    load = loads_of(model, n, seed)
    try:
        angles = simulate(model, requests, cyclic=cyclic, load=load)
    except NoSteadyCycle:  # gravity may turn a joint that it overcomes for ever
        reject()
    desired = angles * rng.uniform(1.0, 1.5) + rng.normal(size=n) * 10.0 ** rng.uniform(-3, 0)
    problem = joint_task(model, desired, cyclic=cyclic, norm=norm, load=load)
    reachable = reachable_set(problem, level, linearised=True)
    rows = len(reachable.limits)
    for sparsity in (1.0, 0.2, 1.0 / rows):
        multipliers = rng.exponential(size=rows) * (rng.random(rows) < sparsity)
        if reachable.curvature > 0.0 and rng.random() < 0.5:
            multipliers[: -2 * reachable.steps.shape[0]] = 0.0
        proved = certified_error(reachable, problem, multipliers)
        assert 0.0 <= proved <= error_norm(angles - desired, norm) + ROUNDING


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize(("seed", "hold", "least"), [(0, 1, 0.98), (0, 3, 0.85), (1, 3, 0.85)])
def test_the_best_plan_of_a_joint_that_sags_by_its_pose_is_near_its_bound(seed, hold, least, norm):
    rng = np.random.default_rng(seed)
    phase, share = rng.uniform(-math.pi, math.pi), rng.uniform(0.2, 0.8)
    sags = share * ERS210A.theta_0 * np.array([math.cos(phase), math.sin(phase)])
    model = replace(ERS210A, hold=hold, sag_sin=float(sags[0]), sag_cos=float(sags[1]))
    n = 100 if hold == 1 else 41
    desired = rng.uniform(0.6, 1.0) * np.sin(2.0 * np.pi * np.arange(n) / n) ** 3
    for cyclic, start in ((True, None), (False, 0.0)):
        plan = planner.invert_optimal(model, desired, cyclic=cyclic, norm=norm, smoothness=0.0)
        bound = lower_bound(model, desired, cyclic=cyclic, norm=norm, start=start)
        assert least * plan.error <= bound <= plan.error


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("kind", ["cyclic", "from rest", "from a start"])
@pytest.mark.parametrize(
    ("level", "inertia"),
    [
        ("slope", {}),
        ("envelope", {}),
        ("envelope", {"time_constant": 0.03, "dead_band": 0.02}),
        ("envelope", {"time_constant": 0.01, "max_acceleration": 100.0, "dead_band": 0.01}),
    ],
    ids=["slope", "envelope", "T", "T and A"],
)
@pytest.mark.parametrize("loaded", [False, True])
def test_the_bound_is_the_optimum_of_the_statement_in_cvxpy(loaded, level, inertia, kind, norm):
    rng = np.random.default_rng(len(kind))
    model = random_model(rng, whole=False, hold=3 if loaded else 1, offset=True)
    model = replace(model, **inertia)
    desired = saturating(rng, model, samples=15)
    start = float(desired[0] + 0.2) if kind == "from a start" else None
    load = None
    if loaded:
        load = rng.uniform(-1.0, 1.0, 15)
        v_max = model.v_max
        model = replace(model, v_offset=0.3 * v_max, speed_per_torque=0.5 * v_max, compliance=0.02)
        model = replace(model, sag_sin=0.1, sag_cos=-0.2)
    problem = joint_task(model, desired, cyclic=kind == "cyclic", norm=norm, start=start, load=load)
    stated = stated_bound(problem, level)
    of_set = bound_of(reachable_set(problem, level), problem)
    assert of_set == pytest.approx(stated, abs=OPTIMAL * np.ptp(desired))
    options = {"cyclic": kind == "cyclic", "norm": norm, "level": level}
    bound = lower_bound(model, desired, start=start, load=load, **options)
    assert bound == of_set if not loaded or model.has_inertia else bound >= of_set


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize(
    "bursts",
    [
        [],  # within reach, but not from rest
        [(0, 7, 0.1)],  # at the start, where a cycle closes
        [(30, 7, 0.05), (150, 7, -0.6)],
        [(90, 60, 2.5)],  # steps for which what is left free at first has no room
    ],
)
def test_a_long_path_that_is_out_of_reach_in_places_has_the_bound_of_all_of_it(
    bursts, cyclic, norm
):
    model = JointModel(v_max=4.0, theta_0=0.15, lag=0.024, acceleration_time=0.04, hold=3)
    desired = 0.3 * np.sin(2.0 * np.pi * np.arange(200) / 200)
    for at, count, height in bursts:
        desired[at : at + count] += height
    start = None if cyclic else float(desired[0])
    problem = joint_task(model, desired, cyclic=cyclic, norm=norm, start=start)
    bound = lower_bound(model, desired, cyclic=cyclic, norm=norm, start=start)
    assert bound == pytest.approx(stated_bound(problem, "envelope"), rel=1e-5, abs=1e-9)
    assert bound == 0.0 if cyclic and not bursts else bound > 1e-5


@pytest.mark.parametrize("norm", NORMS)
def test_the_bound_of_a_long_motion_with_inertia_is_attained_by_a_motion_of_the_set(norm):
    """3,000 ticks: in the angles alone the solver stopped at 0.69 of the distance in rms."""
    four = {"v_max": 5.0, "theta_0": 0.2, "lag": 0.01, "acceleration_time": 0.004}
    terms = {"dead_band": 0.008, "time_constant": 0.03, "max_acceleration": 40.0}
    model = JointModel(**four, **terms, tick=0.001, hold=20)
    phase = 2.0 * np.pi * 0.8 * model.period * np.arange(150)
    desired = 0.6 * np.sin(phase) + 0.3 * np.sin(2.4 * phase)
    problem = joint_task(model, desired, cyclic=False, norm=norm)
    reachable = reachable_set(problem, "envelope")
    motion = nearest_motion(reachable, problem).unknowns
    angles, speeds = motion[:150], model.v_max_per_tick * motion[150:]
    np.testing.assert_allclose(np.diff(angles), speeds.reshape(-1, 20).sum(axis=1), atol=ROUNDING)
    assert np.max(reachable.of_speeds @ speeds - reachable.limits) <= ROUNDING
    bound = lower_bound(model, desired, cyclic=False, norm=norm)
    assert bound == pytest.approx(error_norm(angles - desired, norm), rel=OPTIMAL)


def test_a_solver_without_an_answer_is_an_error(monkeypatch):
    class Nothing:
        x, z = np.full(6, np.nan), np.full(15, np.nan)  # angles and speeds; three equations
        status, iterations = "NumericalError", 0

    monkeypatch.setattr(clarabel.DefaultSolver, "solve", lambda _: Nothing)
    with pytest.raises(SolverFailed, match=r"lower bound: the solver stopped.*NumericalError"):
        lower_bound(ERS210A, [0.0, 1.0, 0.0])


def test_the_exact_level_is_refused_under_a_load_that_changes():
    model = replace(ERS210A, compliance=0.01)
    with pytest.raises(InvalidInput, match=r"level 'exact': .* a load that changes; use 'envel"):
        lower_bound(model, [0.0, 0.1, 0.0], level="exact", load=[0.1, 0.2, 0.1])
    assert lower_bound(model, [0.0, 0.1, 0.0], level="exact", load=0.1, time_limit=0.1) >= 0.0


@pytest.mark.parametrize("norm", NORMS)
def test_a_bound_that_a_joint_in_motion_attains_ends_the_search_and_leaves_an_infinite_gap(
    norm, caplog
):
    """Already in motion the joint follows exactly; from rest no plan moves it before the lag."""
    caplog.set_level("DEBUG", logger="planner.planning.bounds")
    share = ERS210A.gain * ERS210A.tick  # of the way to one request, at each tick
    desired = 0.1 * (1.0 - (1.0 - share) ** np.arange(3))
    options = {"cyclic": False, "norm": norm, "level": "exact", "time_limit": 1.0}
    certificate = certify(ERS210A, desired, **options)
    assert certificate.bound == 0.0
    assert certificate.solver_gap == math.inf
    assert "exact bound: closed" in caplog.text


def test_the_bound_for_every_start_is_that_of_the_best_start():
    """Within the lag one request drives the joint: the best start and request are found on a grid.

    The joint is in motion when the path begins, so all of the window is that request.
    """
    joint, desired = JointModel.ers210a(), np.array([0.0, 0.04, 0.08])
    starts, ahead = np.meshgrid(np.linspace(-0.01, 0.01, 401), np.linspace(0.0, 0.2, 2001))
    angles = [starts]
    for _ in desired[1:]:
        error = starts + ahead - angles[-1]
        angles.append(angles[-1] + joint.v_max_per_tick * np.minimum(error / joint.theta_0, 1.0))
    errors = np.abs(np.stack(angles) - desired[:, None, None])
    for norm, each in (("max", errors.max(0)), ("rms", np.sqrt((errors**2).mean(0)))):
        bound = lower_bound(joint, desired, cyclic=False, norm=norm, level="exact", time_limit=2.0)
        assert each.min() - 1e-4 < bound <= each.min()
