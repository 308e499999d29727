"""The compiled search: errors, costs and steps against dense routes."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from planner import reference_walk
from planner.model.response import load_by_period, motion_under
from planner.planning import gauss_newton
from planner.planning.gauss_newton import (
    MOST_TOGETHER,
    SPEED_TERM,
    Search,
    Stage,
    allocated,
    work_of,
)
from planner.planning.problem import problem_of
from planner.planning.task import Task
from tests.from_python import from_python
from tests.instances import ERS210A, TICK, random_model, saturating
from tests.plans import track

evaluate = from_python(gauss_newton.evaluate)
set_step = from_python(gauss_newton.set_step)
STEP = 1e-6  # step of the central differences [rad]
AGREEMENT = 1e-5
"""A step from derivatives by differences and a dense matrix of condition 1e6 [relative]."""

DAMPING = 1e-2  # Levenberg-Marquardt weight, which counts in the cost of a step
MOST_DAMPING = 1.0  # within this the active limits of every step are found
CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
SMOOTHING = pytest.mark.parametrize("smoothing", [True, False], ids=["smoothing", "nearby"])
SAME = 1e-9  # agreement of the compiled run and the simulation: cycles are closed to 1e-11 [rad]


def joint(seed, *, cyclic, samples=10, inertia=False, friction=False, scenarios=1, **options):
    """One joint, or several that it may be, and the problem to follow a path that saturates it."""
    rng = np.random.default_rng([seed, samples, scenarios])
    model = random_model(rng, whole=False, hold=1 + seed % 3)
    desired = saturating(rng, model, samples=samples)
    terms = {"dead_band": 0.3 * model.theta_0} if friction else {}
    terms |= {"time_constant": 2.0 * TICK} if inertia else {}
    start = None if cyclic else float(np.median(desired)) + 0.01
    problem = track(replace(model, **terms), desired, cyclic=cyclic, start=start, **options)
    speeds = [model.v_max * (1.0 + 0.1 * c) for c in range(scenarios)]
    candidates = tuple(replace(model, v_max=speed, **terms) for speed in speeds)
    shares = (1.0 / scenarios,) * scenarios
    return replace(problem, models=(candidates,), robust="mean", shares=shares)


def leg_problem():
    """A leg of which every joint lags, along axes that count differently."""
    walk, weights = reference_walk(), (9.0, 5.0, 7.0)
    return problem_of(Task.of(ERS210A, walk.desired_foot[::6], leg=walk.leg, weights=weights))


def point_at(problem, stage, unit=1.0):
    """Requests and states near the desired angles, evaluated."""
    rng = np.random.default_rng(0)
    point = allocated(problem.spec, smoothing=stage.smoothing)
    noise = rng.normal(size=point.requests.shape)
    angles = np.tile(problem.desired, len(problem.scenarios))
    point.states[:, : angles.shape[1]] = angles
    states = point.states + 0.05 * rng.normal(size=point.states.shape)
    requests = problem.admissible(problem.desired + 0.05 * noise)
    return evaluated(problem, stage, requests, states, unit)


def within_a_unit(problem, stage, unit):
    """A point whose errors are of about a unit, where no weight is at its least."""
    rng = np.random.default_rng(1)
    angles = np.tile(problem.desired, len(problem.scenarios))
    angles += unit * rng.choice([-1.0, 1.0], angles.shape) * rng.uniform(0.6, 1.2, angles.shape)
    return evaluated(problem, stage, problem.desired, angles, unit)


def evaluated(problem, stage, requests, states, unit=1.0):
    """Both costs and the defects at requests and states."""
    point = allocated(problem.spec, smoothing=stage.smoothing)
    point.requests[:], point.states[:] = requests, states
    evaluate(problem.spec, stage, unit, point)
    return point


def step_at(problem, stage, point, damping=DAMPING):
    """The step from a point, as changes of requests and states, what it predicts, and its damping.

    Where its active limits are not found there is more of it, as in the search.
    """
    work = work_of(problem.spec, smoothing=stage.smoothing)
    search = Search(
        point.requests.copy(),
        point.states.copy(),
        np.zeros_like(point.states),
        np.zeros((2, *point.requests.shape), dtype=np.int64),
        np.array([damping]),
        work,
    )
    step = np.zeros(len(work.pattern.position))
    found, predicted = set_step(problem.spec, stage, point, search, step)
    if not found:
        assert damping < MOST_DAMPING
        return step_at(problem, stage, point, 3.0 * damping)
    return step[: point.requests.size + point.states.size], predicted, damping


def unknowns_of(point):
    return np.concatenate([point.requests.ravel(), point.states.ravel()])


def split(unknowns, point):
    requests, states = np.split(unknowns, [point.requests.size])
    return requests.reshape(point.requests.shape), states.reshape(point.states.shape)


def terms_of(problem, point, damping):
    """What counts beside the cost: requests by the damping, speeds a little."""
    speeds = np.zeros(point.states.shape)
    speeds[:, len(problem.drives) :] = SPEED_TERM
    return np.concatenate([np.full(point.requests.size, damping), speeds.ravel()])


def dense(problem, stage, point):
    """Cost, its gradient and Hessian, and the derivative of the defects, all by differences."""

    def at(unknowns):
        return evaluated(problem, stage, *split(unknowns, point))

    here = unknowns_of(point)
    size, cost = len(here), point.costs[1]
    singly = np.array([at(here + unit).costs[1] for unit in np.eye(size)])
    backwards = np.array([at(here - unit).costs[1] for unit in np.eye(size)])
    hessian = np.diag(singly + backwards - 2.0 * cost)
    for i in range(size):
        for j in range(i):
            both = at(here + np.eye(size)[i] + np.eye(size)[j]).costs[1]
            hessian[i, j] = hessian[j, i] = both - singly[i] - singly[j] + cost
    defects = [
        (at(here + move).defects - at(here - move).defects).ravel() / (2.0 * STEP)
        for move in STEP * np.eye(size)
    ]
    return (singly - backwards) / 2.0, hessian, np.column_stack(defects)


CASES = [
    {"seed": 0},
    {"seed": 1, "samples": 4},
    {"seed": 2, "inertia": True},
    {"seed": 3, "friction": True},
    {"seed": 4, "inertia": True, "friction": True},
    {"seed": 5, "scenarios": 3, "samples": 7},
    {"seed": 6, "scenarios": 2, "inertia": True, "samples": 6},
]


def constrained(problem, stage, point, damping):
    """The step by a convex solver: dense, its derivatives by differences."""
    gradient, hessian, slopes = dense(problem, stage, point)
    count = point.requests.size
    terms = 2.0 * terms_of(problem, point, damping)
    z = cp.Variable(len(gradient))
    requests = point.requests.ravel() + z[:count]
    conditions = [slopes @ z == -point.defects.ravel()]
    if not problem.cyclic:
        conditions.append(requests[0] == problem.first_requests[0])
    first = 0 if problem.cyclic else 1
    conditions += [requests[first:] >= problem.lower[0], requests[first:] <= problem.upper[0]]
    if np.isfinite(problem.max_step[0]):
        changes = cp.diff(requests)
        if problem.cyclic:
            changes = cp.hstack([changes, requests[0] - requests[-1]])
        conditions.append(cp.abs(changes) <= problem.max_step[0])
    matrix = cp.psd_wrap(hessian + np.diag(terms))
    cost = gradient @ z + cp.quad_form(z, matrix) / 2.0
    solver = cp.Problem(cp.Minimize(cost), conditions)
    solver.solve(solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
    return z.value, hessian, gradient, terms


def assert_solves_the_dense_problem(step, problem, stage, point, terms):
    """Its conditions of optimality, with these terms on the diagonal of half the Hessian."""
    gradient, hessian, slopes = dense(problem, stage, point)
    conditions, right = [slopes], [-point.defects.ravel()]
    if not problem.cyclic:
        conditions.append(np.eye(1, len(gradient)))
        right.append(problem.first_requests - point.requests[0])
    matrix = np.concatenate(conditions)
    rows = len(matrix)
    kkt = np.block([[hessian + 2.0 * np.diag(terms), matrix.T], [matrix, np.zeros((rows, rows))]])
    expected = np.linalg.solve(kkt, np.concatenate([-gradient, *right]))[: len(gradient)]
    scale = max(1.0, float(np.max(np.abs(expected))))
    np.testing.assert_allclose(step, expected, rtol=0.0, atol=AGREEMENT * scale)


@SMOOTHING
@CYCLIC
@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_step_is_the_dense_solution_of_the_linearised_problem(case, cyclic, smoothing):
    problem = joint(cyclic=cyclic, **case)
    stage = Stage(0.3, 0.01, 2.0, 1, smoothing)
    point = point_at(problem, stage)
    step, predicted, damping = step_at(problem, stage, point)
    assert damping == DAMPING
    terms = terms_of(problem, point, DAMPING)
    assert_solves_the_dense_problem(step, problem, stage, point, terms)
    requests, states = split(unknowns_of(point) + step, point)
    reached = evaluated(problem, stage, requests, states)
    assert predicted == pytest.approx(reached.costs[1], rel=1e-9)


@SMOOTHING
@CYCLIC
@pytest.mark.parametrize(("limited", "max_step"), [(True, np.inf), (True, 0.04), (False, 0.04)])
@pytest.mark.parametrize("seed", range(2))
def test_the_step_within_limits_is_that_of_a_convex_solver(
    seed, limited, max_step, cyclic, smoothing
):
    problem = joint(seed, cyclic=cyclic, max_step=max_step)
    if limited:
        low, high = np.quantile(problem.desired, [0.3, 0.7])
        problem = replace(problem, lower=np.array([low]), upper=np.array([high]))
    stage = Stage(0.3, 0.01, 2.0, 1, smoothing)
    point = point_at(problem, stage)
    step, _, damping = step_at(problem, stage, point)
    expected, hessian, gradient, terms = constrained(problem, stage, point, damping)

    def cost(z):
        return gradient @ z + z @ (hessian + np.diag(terms)) @ z / 2.0

    requests = point.requests.ravel() + step[: point.requests.size]
    changes = np.abs(np.diff(requests, append=requests[:1] if cyclic else requests[-1:]))
    assert np.max(changes) <= max_step + 1e-7
    free = requests if cyclic else requests[1:]
    assert np.all((free >= problem.lower - 1e-7) & (free <= problem.upper + 1e-7))
    assert cost(step) == pytest.approx(cost(expected), rel=1e-4, abs=1e-7)


@pytest.mark.parametrize("power", [2.0, 4.0, 16.0])
@pytest.mark.parametrize("kind", ["joint", "models", "leg"])
def test_the_gradient_is_half_the_slope_of_the_cost(kind, power):
    problem = leg_problem() if kind == "leg" else joint(1, cyclic=True, scenarios=2)
    if kind == "models":
        problem = replace(problem, norm="max", shares=(0.4, 0.6))
    stage, unit = Stage(0.3, 0.0, power), 0.1
    point = within_a_unit(problem, stage, unit)
    count = point.quadratic.shape[2]
    gradient = point.quadratic[..., count].reshape(len(point.states), -1)
    scale = float(np.max(np.abs(gradient)))
    for k, a in np.ndindex(gradient.shape):
        move = np.zeros_like(point.states)
        move[k, a] = STEP
        high, low = (
            evaluated(problem, stage, point.requests, point.states + way, unit).costs[0]
            for way in (move, -move)
        )
        slope = (high - low) / (2.0 * STEP)
        assert 2.0 * gradient[k, a] == pytest.approx(slope, abs=1e-5 * scale)


@CYCLIC
def test_all_periods_of_a_long_path_lead_where_its_simulation_does(cyclic):
    problem = joint(3, cyclic=cyclic, samples=MOST_TOGETHER + 10)
    requests = problem.admissible(problem.resting)
    angles = problem.exact_angles(requests)
    point = evaluated(problem, Stage(1e-150, 0.0), requests, angles)
    np.testing.assert_allclose(point.defects, 0.0, atol=1e-12)
    assert np.all(point.slopes[0, 0, 0, 1:] > 0.0)  # also the last ones are filled


@CYCLIC
@pytest.mark.parametrize("case", [{"seed": 0}, {"seed": 2, "inertia": True}], ids=str)
def test_where_the_lagrangian_curves_upwards_at_the_corners_the_step_is_damped(case, cyclic):
    """E and Delta of (11), where multipliers are known: of an angle and of a request each."""
    problem = joint(cyclic=cyclic, **case)
    spec, stage = problem.spec, Stage(0.3, 0.01)
    point = point_at(problem, stage)
    work = work_of(problem.spec, smoothing=False)
    samples, width = len(point.requests), spec.weights.shape[2]
    multipliers = np.random.default_rng(5).normal(size=point.states.shape)
    held = np.zeros((2, *point.requests.shape), dtype=np.int64)
    search = Search(point.requests, point.states, multipliers, held, np.array([DAMPING]), work)
    step = np.zeros(len(work.pattern.position))
    found, _ = set_step(spec, stage, point, search, step)
    assert found

    terms = terms_of(problem, point, DAMPING)
    count = point.requests.size
    angles = count + np.arange(point.states.size).reshape(point.states.shape)
    bends = np.moveaxis(point.slopes[0, :, spec.parts + width :], -1, 0)  # (n, s, width)
    curvature = -np.einsum("ks,ksj->kj", multipliers, bends)
    assert np.any(curvature > 0.0)
    for k in range(samples):
        for j, bend in enumerate(np.maximum(curvature[k], 0.0)):
            number = k - problem.acting.youngest - j
            if cyclic or k > 0:
                terms[angles[k - 1, 0]] += bend
            if cyclic or number >= 0:
                terms[number % samples] += bend
    assert_solves_the_dense_problem(step[: len(terms)], problem, stage, point, terms)


def test_what_cycles_have_added_is_taken_off_the_desired_angles_within_the_limits():
    desired = np.array([[0.3], [0.25], [0.1]])
    added = np.array([[0.05], [-0.1], [0.2]])
    task = Task.of([replace(ERS210A, offset=0.02)], desired, limits=(-0.05, 0.3))
    found = problem_of(replace(task, disturbance=added)).desired
    np.testing.assert_allclose(found, [[0.25], [0.32], [-0.03]])


@CYCLIC
@pytest.mark.parametrize(
    ("inertia", "integral", "position"),
    [(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.03, 12.0, 0.0), (0.03, 0.0, 4.0)],
)
def test_a_joint_whose_load_makes_it_sag_and_slower_goes_where_its_simulation_does(
    inertia, integral, position, cyclic
):
    """Each period has a torque of its own; the top speeds of the two directions differ, too."""
    terms = {"sag_sin": -0.04, "sag_cos": 0.02, "compliance": 0.05, "v_offset": 0.6}
    terms |= {"speed_per_torque": 0.8, "dead_band": 0.01, "time_constant": inertia}
    rates = {"integral_rate": integral, "position_integral_rate": position}
    model = replace(ERS210A, **terms, **rates)
    requests = 0.8 * np.sin(2.0 * np.pi * np.arange(60) / 30)
    torques = np.cos(0.3 * np.arange(60))
    start = None if cyclic else 0.1
    problem = track(model, requests, cyclic=cyclic, start=start, load=torques)
    acting_load = load_by_period(torques, cyclic=cyclic)
    motion = motion_under(model, requests, cyclic=cyclic, start=start, torques=acting_load)
    moving = problem.spec.drives[:, gauss_newton.COASTING] * motion[1 : problem.spec.parts].T
    states = np.column_stack([motion[0], moving])
    point = evaluated(problem, Stage(1e-12, 1.0, 2.0, 1, False), requests[:, np.newaxis], states)
    np.testing.assert_allclose(point.defects, 0.0, rtol=0.0, atol=SAME)
    exact = problem.exact_angles(requests[:, np.newaxis])
    np.testing.assert_array_equal(exact[:, 0], motion[0])
