"""From a task to searches: what each of them is given, and which answer is taken."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cvxpy as cp
import numpy as np
import pytest

from planner.exceptions import SolverFailed
from planner.gait.half_ellipse import reference_walk
from planner.model.evidence import Evidence
from planner.model.joint import JointModel, request_ages
from planner.model.response import simulate
from planner.planning import closed_form
from planner.planning import solve as searches
from planner.planning.problem import problem_of
from planner.planning.result import UNFORESEEN
from planner.planning.search import State, holding
from planner.planning.solve import Solved, below_top_speed, search, solve
from planner.planning.task import Task
from tests.plans import track

ERS210A = JointModel.ers210a()
LATE = replace(ERS210A, lag=0.05)
PHASE = 2.0 * np.pi * np.arange(40) / 40
DESIRED = np.column_stack([0.3 * np.sin(PHASE), 0.2 * np.cos(PHASE), 0.1 * np.sin(2.0 * PHASE)])


@pytest.fixture
def single(monkeypatch):
    """The tasks of the joints that are planned one by one; their plans are the desired angles."""
    given = []

    def record(task, **options):
        given.append((task, options))
        several = len(task.scenarios) > 1
        return Solved(task.desired, task.desired + 1.0 if several else None)

    monkeypatch.setattr(searches, "solve_joint", record)
    return given


@pytest.mark.parametrize("cyclic", [True, False])
def test_each_joint_of_a_leg_is_first_planned_for_where_the_foot_needs_it(
    cyclic, single, monkeypatch
):
    """Exactly, for its nominal model and by itself; limits and loads stay its own."""
    monkeypatch.setattr(searches, "foot_requests", lambda problem, singly, **_: (problem, singly))
    monkeypatch.setattr(searches, "robust_requests", lambda *_, **__: np.zeros((11, 3)))
    walk = reference_walk()
    added = 0.01 * np.arange(33.0).reshape(11, 3)
    sagging = replace(ERS210A, compliance=0.01)
    task = Task.of(
        [[sagging, LATE]] * 3,
        walk.desired_foot[::8],
        leg=walk.leg,
        cyclic=cyclic,
        norm="max",
        max_step=[0.1, 0.2, 0.3],
        smoothness=0.1,
        load=np.tile([0.1, 0.2, 0.3], (11, 1)),
        disturbance=added,
    )
    made = solve(task)
    problem = problem_of(task)
    np.testing.assert_array_equal(made.nominal, problem.desired)
    for j, (alone, _) in enumerate(single):
        np.testing.assert_array_equal(alone.desired[:, 0], problem.desired[:, j])
        assert alone.models == ((sagging,),)
        assert (alone.goal, alone.norm, alone.smoothness) == ("angles", "rms", 0.0)
        assert (alone.disturbance, alone.cyclic) == (None, cyclic)
        assert alone.limits == task.limits[j : j + 1]
        assert alone.max_step == task.max_step[j]
        np.testing.assert_array_equal(alone.load, task.load[:, j : j + 1])
        assert alone.starts == ((None,) if cyclic else (problem.desired[0, j],))


def test_requests_for_the_nominal_models_are_kept_where_any_joint_has_several(single):
    names, told = ("hip", "knee", "toe"), []
    task = Task.of([[ERS210A], [ERS210A, LATE], [ERS210A]], DESIRED, names=names)
    made = solve(task, solver="ipopt", progress=told.append)
    np.testing.assert_array_equal(made.requests, DESIRED)
    np.testing.assert_array_equal(made.nominal, DESIRED + np.array([0.0, 1.0, 0.0]))
    assert told == [*names]
    assert [each.names for each, _ in single] == [("hip",), ("knee",), ("toe",)]
    assert [options["solver"] for _, options in single] == ["ipopt"] * 3
    assert solve(Task.of(ERS210A, DESIRED)).nominal is None


def test_a_share_of_a_measured_disturbance_replaces_what_models_were_known_to_miss(single):
    known = ERS210A.with_evidence(Evidence(0.1))
    task = Task.of([[known, known]] * 3, DESIRED)
    solve(task)
    solve(replace(task, disturbance=np.tile([0.01, -0.02, 0.0], (len(DESIRED), 1))))
    errors = [[model.evidence.error for model in each.models[0]] for each, _ in single]
    shares = [[pytest.approx(UNFORESEEN * size)] * 2 for size in (0.01, 0.02, 0.0)]
    assert errors == [[0.1] * 2] * 3 + shares


def test_models_in_scenarios_get_the_loads_that_they_feel(monkeypatch):
    given = []

    def record(problem, scenarios, loads, requests, **options):
        given.append((scenarios, loads, options | {"smoothness": problem.smoothness}))
        return requests

    monkeypatch.setattr(searches, "robust_requests", record)
    sagging = replace(ERS210A, compliance=0.01)
    task = Task.of([[ERS210A, sagging]], DESIRED[:, :1], load=0.5, robust="worst", smoothness=0.02)
    made = solve(task)
    np.testing.assert_array_equal(made.requests, made.nominal)
    ((scenarios, loads, options),) = given
    assert scenarios == ((ERS210A,), (sagging,))
    assert loads[0] == (None,)
    np.testing.assert_array_equal(loads[1][0], 0.5)
    assert (options["robust"], options["smoothness"]) == ("worst", 0.02)


def test_the_best_of_several_searches_is_taken(monkeypatch):
    """Wide corners only where they gain a five-hundredth, as their requests change more."""
    monkeypatch.setattr(searches, "best_closed_form", lambda each: each.resting)
    problem = track(ERS210A, 3.0 * DESIRED[:, 0], cyclic=True)
    state = State(problem.resting, problem.desired)
    ideal = replace(problem, desired=problem.desired + 0.1)  # an error of 0.1 of the ideal
    for narrow, wide, taken in (
        (0.2, 0.1, "wide"),
        (0.2, 0.1997, "narrow"),
        (0.2, 0.1995, "wide"),
        (0.102, 0.01, "narrow"),  # within three hundredths of the ideal no further one follows
        (0.1035, 0.01, "wide"),
        (0.10305, 0.01, "narrow"),  # nor for less than 5e-4 theta_0 more
        (0.10308, 0.01, "wide"),
    ):
        ends = {
            searches.NARROW: (np.zeros((40, 1)), narrow),
            searches.WIDE: (np.ones((40, 1)), wide),
        }
        monkeypatch.setattr(
            searches, "minimise", lambda _, __, stages, ends=ends, **___: ends[stages]
        )
        answer = search(ideal, state)
        assert float(answer[0, 0]) == (1.0 if taken == "wide" else 0.0)
    monkeypatch.setattr(searches, "minimise", lambda _, state, *__, **___: (state.requests, np.inf))
    with pytest.raises(SolverFailed, match="no requests lead to a steady cycle"):
        search(ideal, state)


def test_joints_that_are_held_rest_where_the_first_sample_has_them():
    desired = np.array([[0.1, 0.2], [0.3, 0.2], [0.2, 0.2]])
    task = Task.of(ERS210A, desired, limits=(-1.0, [0.9, 0.8]))
    problem = replace(
        track(ERS210A, desired[:, 0], cyclic=True),
        models=(ERS210A, ERS210A),
        desired=desired,
        lower=task.lower,
        upper=task.upper,
        max_step=task.max_step,
        loads=(None, None),
    )
    held = holding(problem, np.array([False, True]), problem.resting[0])
    np.testing.assert_array_equal(held.lower, [-1.0, 0.2])
    np.testing.assert_array_equal(held.upper, [0.9, 0.2])


@pytest.mark.parametrize(("rests", "freed"), [(0, True), (40, False)])
def test_of_a_long_path_the_beginning_tells_whether_the_first_request_stays_in_the_middle(
    monkeypatch, rests, freed
):
    """A ramp at once calls for another one; after a rest the window has left it long before."""
    model, lengths = replace(ERS210A, dead_band=0.1), []
    desired = np.minimum(0.02 * np.maximum(np.arange(900.0) - rests, 0.0), 0.6)
    task = Task.of([model], desired, names=("",), cyclic=False)
    problem = problem_of(task)
    column = searches.best_requests(problem, "gauss-newton")

    def counted(problem, solver):
        lengths.append(len(problem.desired))
        return best(problem, solver)

    best = searches.best_requests
    monkeypatch.setattr(searches, "best_requests", counted)
    found = searches.first_request_freed(problem, column, "gauss-newton")
    assert (found[0] is not problem) == freed
    assert lengths.count(900) == freed  # one search of the whole, from the edge that served best
    assert sum(each < 450 for each in lengths) == 3
    monkeypatch.setattr(searches, "BEGINNING", 1e3)
    whole = searches.first_request_freed(problem, column, "gauss-newton")
    np.testing.assert_array_equal(found[1], whole[1])
    assert (found[0].first is None) == (whole[0].first is None) == (not freed)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("several", "smoothness"), [(False, 0.005), (False, 0.0), (True, 0.005)])
def test_the_first_request_leaves_the_middle_of_the_band_for_the_side_of_the_motion(
    way, several, smoothness
):
    """For a single model alone: several may have other bands."""
    sticky = replace(ERS210A, dead_band=0.03)
    steep = way * 0.6 * np.minimum(np.arange(30) / 10.0, 1.0)[:, np.newaxis]
    models = [[sticky, replace(sticky, lag=0.04)]] if several else [sticky]
    made = solve(Task.of(models, steep, cyclic=False, smoothness=smoothness))
    first = float(made.requests[0, 0])
    assert abs(first) < 0.03
    assert first == 0.0 if several else way * first == pytest.approx(0.03, rel=1e-6)


@pytest.mark.parametrize("cyclic", [True, False])
def test_samples_below_the_top_speed_are_counted_whichever_way_it_goes(cyclic):
    model = ERS210A
    shares = np.concatenate([np.zeros(30), np.repeat([1.0, -1.0, 0.5, -0.5], [8, 8, 5, 5])])
    ideal = (model.v_max_per_period * np.cumsum(shares))[:, np.newaxis]
    for way in (1.0, -1.0):
        problem = track(model, way * ideal[:, 0], cyclic=cyclic, start=None if cyclic else 0.0)
        resting = 0 if cyclic else request_ages(model).youngest + 1
        assert below_top_speed(problem, way * ideal) == 40 - resting


@pytest.mark.parametrize(("directly", "through_rms"), [(0.1, 0.2), (0.2, 0.1)])
def test_of_two_searches_for_the_largest_error_of_a_foot_the_better_one_is_taken(
    monkeypatch, directly, through_rms
):
    problem = SimpleNamespace(
        norm="max", desired=DESIRED, admissible=np.copy, exact_angles=lambda requests: requests
    )
    ends = {False: (DESIRED + directly, directly), True: (DESIRED + through_rms, through_rms)}
    found = lambda *_, through_rms=False: ends[through_rms]  # noqa: E731
    monkeypatch.setattr(searches, "minimise", found)
    monkeypatch.setattr(
        searches, "with_stationary_joints", lambda same, best, *_, **__: (same, best)
    )
    monkeypatch.setattr(searches, "smoothed", lambda _, requests, **__: requests)
    _, requests = searches.foot_requests(problem, DESIRED)
    np.testing.assert_allclose(requests - DESIRED, 0.1)


def recorded(monkeypatch, problem, state, *, error):
    """The searches that are made where each leaves this error: stages, beginning, by which norm."""
    early = searches.early_and_late(problem)
    names = {
        "ideal": state.requests,
        "closed form": state.requests + 7.0,
        "early": early[0],
        "as they are": early[1],
    }
    made = []

    def record(_, begun, stages, *, through_rms=False):
        (begins,) = (each for each, rows in names.items() if rows is begun.requests)
        way = {searches.NARROW: "narrow", searches.WIDE: "wide"}[stages]
        made.append(f"{way} from {begins}{' through rms' if through_rms else ''}")
        return begun.requests, error

    monkeypatch.setattr(searches, "minimise", record)
    monkeypatch.setattr(searches, "best_closed_form", lambda _: names["closed form"])
    monkeypatch.setattr(searches, "early_and_late", lambda _: early)
    search(problem, state)
    return made


SLOW = 0.3 * np.sin(2.0 * np.pi * np.arange(40) / 40)
BRIEF = 0.05 * np.sin(2.0 * np.pi * np.arange(21) / 21)
TWO = 2 * request_ages(ERS210A).oldest  # windows
LIMITED = replace(ERS210A, max_acceleration=40.0)
OVERSHOOTING = replace(ERS210A, theta_0=0.9 * ERS210A.v_max_per_tick)


IDEAL, RMS, LINES = "narrow from ideal", "narrow from ideal through rms", "narrow from closed form"
SHIFTED = ["narrow from early", "narrow from as they are"]


def wide(*begins):
    return [f"wide from {each}" for each in begins]


@pytest.mark.parametrize(
    ("model", "desired", "norm", "error", "made"),
    [
        (ERS210A, SLOW, "rms", 1e-5, [IDEAL]),
        (ERS210A, SLOW, "max", 1e-5, [IDEAL, RMS]),
        (ERS210A, SLOW, "rms", 0.1, [IDEAL, *wide("ideal")]),
        (ERS210A, SLOW, "max", 0.1, [IDEAL, RMS, *wide("ideal")]),
        (ERS210A, 20.0 * SLOW, "rms", 0.1, [IDEAL, LINES, *wide("ideal", "closed form")]),
        (ERS210A, np.zeros(16), "rms", 0.0, [IDEAL, LINES]),
        (ERS210A, np.zeros(17), "rms", 0.0, [IDEAL]),
        (LIMITED, SLOW, "rms", 1e-3, [IDEAL, *wide("ideal")]),  # within an encoder's step
        (LIMITED, SLOW, "rms", 0.1, [IDEAL, LINES, *wide("ideal", "closed form")]),
        (LIMITED, 0.1 * SLOW, "rms", 0.1, [IDEAL, *wide("ideal")]),
        (OVERSHOOTING, SLOW, "rms", 0.1, [IDEAL, *SHIFTED, *wide("ideal", "early", "as they are")]),
        (
            ERS210A,
            BRIEF[:TWO],
            "rms",
            0.1,
            [IDEAL, *SHIFTED, *wide("ideal", "early", "as they are")],
        ),
        (ERS210A, BRIEF[: TWO + 1], "rms", 0.1, [IDEAL, *wide("ideal")]),  # more than two windows
    ],
)
def test_further_searches_are_made_where_the_first_leaves_more_than_it_must(
    monkeypatch, model, desired, norm, error, made
):
    """Lines for joints at top speed or at their acceleration, wide corners far from the ideal."""
    problem = track(model, desired, cyclic=True, norm=norm)
    state = State(problem.resting.copy(), problem.desired)
    assert recorded(monkeypatch, problem, state, error=error) == made


STICKY = replace(ERS210A, dead_band=0.05)
NOISY = SLOW + 0.004 * (-1.0) ** np.arange(40)


@pytest.mark.parametrize(
    ("model", "starts"),
    [
        (ERS210A, []),
        (LIMITED, ["smooth"]),
        (STICKY, ["calm"]),
        (replace(STICKY, max_acceleration=400.0), ["calm", "smooth"]),
    ],
)
def test_smoothing_starts_from_a_calmer_path_and_from_smooth_stages_too(monkeypatch, model, starts):
    """The first with dry friction, the second where the acceleration is limited."""
    given, solvers = [], []

    def best(problem, solver):
        solvers.append(solver)
        return problem.desired + 1.0

    def smooth(problem, requests, *, best, candidates):
        assert best is None
        given.append((problem.smoothness, requests, list(candidates)))
        return requests

    def stages(problem, _, used):
        assert used == searches.SMOOTH
        return problem.desired + 2.0, 0.1

    monkeypatch.setattr(searches, "best_requests", best)
    monkeypatch.setattr(searches, "minimise", stages)
    monkeypatch.setattr(searches, "smoothed", smooth)
    task = Task.of([model], NOISY, names=("",), smoothness=0.02)
    made = searches.solve_joint(task, solver="ipopt")
    ((smoothness, requests, candidates),) = given
    np.testing.assert_array_equal(requests, task.desired + 1.0)
    np.testing.assert_array_equal(made.requests, requests)
    assert (made.nominal, smoothness) == (None, 0.02)
    assert solvers == ["ipopt"] * (1 + ("calm" in starts))
    calm = searches.without_small_reversals(NOISY, 0.2 * 0.05, cyclic=True)
    assert np.max(np.abs(calm - NOISY)) > 1e-3
    expected = {"calm": calm[:, np.newaxis] + 1.0, "smooth": task.desired + 2.0}
    assert len(candidates) == len(starts)
    for candidate, start in zip(candidates, starts, strict=True):
        np.testing.assert_array_equal(candidate, expected[start])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_curve_of_more_lines_must_be_better_by_half_a_per_cent(monkeypatch, count):
    monkeypatch.setattr(closed_form, "CurveStack", SimpleNamespace(of=lambda curves: curves[0]))
    monkeypatch.setattr(closed_form, "requests_of", lambda _, error, **__: np.float64(error))
    problem = SimpleNamespace(
        models=(None,), loads=(None,), admissible=lambda each: each, exact_error=lambda error: error
    )
    for errors, taken in (
        ([1.0, 0.996, 0.992], ["1.0", "1.0", "0.992"]),
        ([1.0, 0.994, 0.990], ["1.0", "0.994", "0.994"]),
    ):
        curve, _ = closed_form.inverted(problem, errors[:count], rule="exact", refine=False)
        assert str(curve) == taken[count - 1]


def test_the_closed_form_of_the_rule_that_is_better_within_the_limits_is_taken(monkeypatch):
    """By the paper's rule 2.0, by the exact one 0.7, of 0.9: requests end at 1.0."""
    by_rule = {"paper": np.full((5, 1), 2.0), "exact": np.full((5, 1), 0.7)}
    problem = track(ERS210A, np.full(5, 0.9), cyclic=True, limits=(-1.0, 1.0))
    monkeypatch.setattr(closed_form, "approximations", lambda *_, **__: [])
    monkeypatch.setattr(closed_form, "inverted", lambda *_, rule, **__: (None, by_rule[rule]))
    np.testing.assert_array_equal(closed_form.best_closed_form(problem), np.full((5, 1), 1.0))


@pytest.mark.parametrize(
    ("samples", "cyclic", "segments", "refine", "fitted"),
    [
        (6, True, None, True, [None, 6]),
        (5, True, None, True, [None]),
        (7, False, None, True, [None, 6]),
        (6, False, None, True, [None]),
        (6, True, 4, True, [4]),
        (6, True, None, False, [None]),
    ],
)
def test_two_more_lines_are_tried_where_the_samples_allow_them_and_nothing_is_fixed(
    monkeypatch, samples, cyclic, segments, refine, fitted
):
    asked = []

    def fit(*_, segments, **options):
        asked.append((segments, options))
        return SimpleNamespace(segments=4, slopes=np.zeros(4))

    monkeypatch.setattr(closed_form, "fit_pwl", fit)
    start = None if cyclic else 0.0
    problem = track(ERS210A, np.zeros(samples), cyclic=cyclic, start=start)
    curves = closed_form.approximations(problem, segments=segments, refine=refine)
    assert [each for each, _ in asked] == fitted
    assert len(curves) == len(fitted)
    options = {"v_max": ERS210A.v_max, "tick": ERS210A.period, "cyclic": cyclic}
    assert all(each == options for _, each in asked)


@pytest.mark.parametrize(("steepest", "taken"), [(4.0, 5.5), (4.6, 4.5), (-5.5, 5.5)])
def test_lines_keep_the_larger_top_speed_unless_one_is_too_steep_the_other_way(
    monkeypatch, steepest, taken
):
    """The joint turns upwards at up to 4.5 rad/s, downwards at up to 5.5 rad/s."""
    model = JointModel(
        v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.04, tick=0.02, v_offset=-0.5
    )

    def fit(*_, v_max, **__):
        return SimpleNamespace(
            segments=4, slopes=np.clip([0.0, steepest], -v_max, v_max), v_max=v_max
        )

    monkeypatch.setattr(closed_form, "fit_pwl", fit)
    problem = track(model, np.zeros(9), cyclic=True)
    (curve,) = closed_form.approximations(problem, segments=4, refine=True)
    assert curve.v_max == pytest.approx(taken)


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("loaded", [True, False])
def test_the_ideal_is_the_nearest_trajectory_within_the_speeds_of_either_direction(loaded, cyclic):
    """By a convex solver; each step has the speeds under the torque of the sample where it ends."""
    model = replace(ERS210A, v_offset=0.8, speed_per_torque=0.9, compliance=0.01)
    load = np.cos(0.3 * np.arange(40)) if loaded else None
    desired = 0.4 * np.sin(2.0 * np.pi * np.arange(40) / 40) + 0.1 * np.cos(
        0.3 * np.pi * np.arange(40)
    )
    made = searches.nearest_within_speeds(model, desired, load, cyclic=cyclic)
    low, high = (
        np.broadcast_to(limit, 40) * model.period
        for limit in model.speed_limits(0.0 if load is None else load)
    )
    x = cp.Variable(40)
    steps, first = cp.diff(x), 0 if cyclic else 1
    if cyclic:
        steps = cp.hstack([x[0] - x[-1], steps])
    problem = cp.Problem(
        cp.Minimize(cp.sum_squares(x - desired)), [steps >= low[first:], steps <= high[first:]]
    )
    problem.solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(made, x.value, rtol=0.0, atol=1e-4)  # the solver's


@pytest.mark.parametrize("load", [None, -0.5])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_from_rest_a_joint_is_within_reach_of_its_top_speed_from_the_second_request_on(way, load):
    model = replace(ERS210A, lag=0.028, hold=2, v_offset=0.8, speed_per_torque=0.9)
    torques = None if load is None else np.full(30, load)
    far = searches.within_attainable_range(model, np.full(30, 99.0 * way), 0.5, torques)
    jump = np.full(30, 99.0 * way)
    jump[0] = 0.5
    angles = simulate(model, jump, cyclic=False, start=0.5, load=torques)
    assert np.all(way * (far - angles) >= -1e-12)
    np.testing.assert_array_equal(far == 0.5, angles == 0.5)
    top = model.speed_limits(load or 0.0)[1 if way > 0.0 else 0] * model.period
    np.testing.assert_allclose(np.diff(far[far != 0.5]), top)
    np.testing.assert_allclose(np.diff(angles)[-3:], top)


@pytest.mark.parametrize("cyclic", [True, False])
def test_further_searches_begin_early_by_the_delay_of_the_joint_and_at_the_desired_angles(cyclic):
    path = np.arange(20.0) / 20.0
    early, late = searches.early_and_late(
        track(ERS210A, path, cyclic=cyclic, start=None if cyclic else 0.0)
    )
    np.testing.assert_array_equal(late[:, 0], path)
    ahead = [*path[7:], *(path[:7] if cyclic else path[[19] * 7])]  # 4 ticks of lag, half of 6
    np.testing.assert_array_equal(early[1:, 0], ahead[1:])
    assert early[0, 0] == (ahead[0] if cyclic else 0.0)


@pytest.mark.parametrize("hold", [1, 3])
def test_the_time_accelerating_is_that_of_the_changes_of_speed_at_the_largest_acceleration(hold):
    """A triangle turns twice from v to -v, which takes 2 v / A each time."""
    model = replace(ERS210A, max_acceleration=50.0, hold=hold)
    speed = 0.4
    triangle = speed * model.period * np.abs(np.arange(40.0) - 20.0)[:, np.newaxis]
    problem = track(model, triangle[:, 0], cyclic=True)
    share = searches.time_accelerating(problem, triangle)
    assert share == pytest.approx(2.0 * (2.0 * speed / 50.0) / (40.0 * model.period))
