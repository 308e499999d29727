"""Where two plans differ and why, on plans that are made up to differ for a known reason."""

from __future__ import annotations

import numpy as np
import pytest

from planner.approximation.curve import PiecewiseLinear
from planner.evaluation.differences import classify, difference, runs
from planner.model.joint import JointModel
from planner.planning.closed_form import invert_closed_form
from planner.planning.inversion import invert_optimal
from tests.instances import REFERENCE_JOINTS, random_model, saturating
from tests.plans import claiming, inversion

SAMPLES = 60
# A request has its largest effect 2 + 4 / 2 = 4 samples after it was sent.
JOINT = JointModel(v_max=1.0, theta_0=0.05, lag=0.02, acceleration_time=0.04, tick=0.01)
LEAD = 4
STEP = JOINT.v_max * JOINT.period


def _plan(*, requests=None, predicted=None, knots=None, limits=None, cyclic=True, desired=None):
    """A plan that says of itself what it is told to: nothing here is solved or simulated."""
    still = np.zeros(SAMPLES)
    curve = None
    if knots is not None:
        ends = [] if cyclic else [0.0, SAMPLES - 1.0]
        every = np.array(sorted([*knots, *ends]))
        curve = PiecewiseLinear(
            knots=every,
            values=np.zeros(len(every)),
            samples=SAMPLES,
            tick=JOINT.period,
            cyclic=cyclic,
        )
    plan = inversion(
        JOINT,
        still if desired is None else desired,
        still if requests is None else requests,
        method="optimal" if curve is None else "closed_form",
        cyclic=cyclic,
        limits=limits,
        start=None if cyclic else 0.0,
        approximation=curve,
    )
    return claiming(plan, still if predicted is None else predicted)


def _ramp(first, last, height=STEP):
    """At top speed on the way to the samples ``first`` to ``last``, at rest elsewhere."""
    steps = np.zeros(SAMPLES)
    steps[first : last + 1] = height
    return np.cumsum(steps)


def _where(reasons, reason):
    return [k for k, each in enumerate(reasons) if each == reason]


@pytest.mark.parametrize("moving", ["closed form", "optimised"])
def test_requests_that_act_while_either_plan_moves_at_top_speed_are_saturated(moving):
    ramp = _ramp(20, 29)
    closed_form = _plan(knots=[], predicted=ramp if moving == "closed form" else None, cyclic=False)
    optimal = _plan(predicted=ramp if moving == "optimised" else None, cyclic=False)
    reasons = classify(closed_form, optimal)
    assert _where(reasons, "saturated") == list(range(20 - LEAD, 30 - LEAD))


def test_less_than_top_speed_is_not_saturated():
    slow = _plan(predicted=_ramp(20, 29, height=0.99 * STEP), cyclic=False)
    assert "saturated" not in classify(_plan(knots=[], cyclic=False), slow)


def test_requests_near_a_corner_are_those_that_act_within_the_acceleration_time_of_it():
    reasons = classify(_plan(knots=[10.5, 40.0]), _plan())
    acceleration = 4
    near = [k for k in range(SAMPLES) if abs((k + LEAD) - 10.5) <= acceleration]
    near += [k for k in range(SAMPLES) if abs((k + LEAD) - 40.0) <= acceleration]
    assert _where(reasons, "corner") == near
    assert set(reasons) == {"corner", "free"}


def test_a_corner_at_a_cycle_boundary_counts_on_both_sides():
    reasons = classify(_plan(knots=[1.0, 30.0]), _plan())
    assert reasons[(1 - LEAD - 4) % SAMPLES] == "corner"
    assert reasons[(1 - LEAD - 5) % SAMPLES] == "free"


def test_the_ends_of_a_curve_and_a_curve_of_one_line_have_no_corner():
    assert "corner" not in classify(_plan(knots=[], cyclic=False), _plan(cyclic=False))
    assert "corner" not in classify(_plan(knots=[7.0]), _plan())


@pytest.mark.parametrize("limit", [-0.3, 0.3])
def test_requests_at_a_limit_are_those_of_the_optimised_plan(limit):
    requests = np.zeros(SAMPLES)
    requests[5:9] = limit
    outside = _plan(knots=[30.0, 40.0], requests=np.full(SAMPLES, 0.9))
    reasons = classify(outside, _plan(requests=requests, limits=(-0.3, 0.3)))
    assert _where(reasons, "limit") == [5, 6, 7, 8]
    assert "limit" not in classify(outside, _plan(requests=requests))


def test_where_several_reasons_hold_saturation_counts_before_the_limit_before_the_corner():
    requests = np.full(SAMPLES, 0.3)
    closed_form = _plan(knots=[24.0], predicted=_ramp(20, 22), cyclic=False)
    reasons = classify(closed_form, _plan(requests=requests, limits=(-1.0, 0.3), cyclic=False))
    assert _where(reasons, "saturated") == [16, 17, 18]
    assert reasons[20] == "limit"  # it acts on the knot


def test_from_rest_requests_that_act_after_the_end_are_set_apart():
    reasons = classify(_plan(knots=[], cyclic=False), _plan(cyclic=False))
    # Request k acts from sample k + 3 on, the last is 59.
    assert _where(reasons, "after_end") == [57, 58, 59]
    assert "after_end" not in classify(_plan(knots=[5.0]), _plan())


@pytest.mark.parametrize(
    ("reasons", "cyclic", "expected"),
    [
        ("aabba", False, [(0, 2), (2, 2), (4, 1)]),
        ("aabba", True, [(2, 2), (4, 3)]),
        ("aabb", True, [(0, 2), (2, 2)]),
        ("aaa", True, [(0, 3)]),
        ("aaa", False, [(0, 3)]),
    ],
)
def test_equal_reasons_run_together_across_a_cycle_boundary_too(reasons, cyclic, expected):
    assert runs(list(reasons), cyclic=cyclic) == expected


def test_the_plan_with_the_smaller_error_where_the_requests_act_tracks_better():
    desired = np.full(SAMPLES, 0.2)
    # At rest at 0.2 until sample 29, and at 0 from sample 30 on; corners keep the halves apart.
    good_first = np.where(np.arange(SAMPLES) < 30, 0.2, 0.0)
    closed_form = _plan(knots=[30.0, 59.0], predicted=good_first, desired=desired)
    optimal = _plan(predicted=0.2 - good_first, desired=desired)
    free = [each for each in difference(closed_form, optimal).intervals if each.reason == "free"]
    assert [each.better for each in free] == ["closed_form", "optimal"]
    assert free[0].optimal_rms == pytest.approx(0.2)
    assert free[0].closed_form_rms == 0.0
    same = difference(_plan(knots=[30.0]), _plan(requests=desired))
    assert {each.better for each in same.intervals} == {"neither"}


def test_the_difference_of_the_requests_is_measured_and_shared_out():
    requests = np.zeros(SAMPLES)
    requests[17], requests[40] = 0.3, -0.1
    found = difference(
        _plan(knots=[], requests=requests, cyclic=False),
        _plan(predicted=_ramp(20, 29), cyclic=False),
    )
    assert found.largest == pytest.approx(0.3)
    assert found.largest_at == 17
    assert found.rms == pytest.approx(np.sqrt(0.1 / SAMPLES))
    assert found.shares == pytest.approx({"saturated": 0.9, "free": 0.1, "after_end": 0.0})


def _servo(dead_band):
    """A hobby servo that takes 50 requests a second, of three of which it moves by the mean."""
    return JointModel(v_max=5.0, theta_0=0.3, lag=0.02, acceleration_time=0.06, tick=0.005, hold=4,
                      dead_band=dead_band)  # fmt: skip


ANGLE = np.pi * 0.02 * np.arange(100)
CURVED = np.radians(20.0 * np.sin(ANGLE) + 5.0 * np.sin(3.0 * ANGLE))
RESTING = np.radians(np.clip(30.0 * np.sin(ANGLE), -15.0, 15.0))


@pytest.mark.parametrize(
    ("model", "desired", "main"),
    [
        (_servo(0.03), RESTING, "at_rest"),
        (_servo(0.0), RESTING, "averaged"),
        (_servo(0.0), CURVED, "line"),
        (_servo(0.01), CURVED, "line"),
    ],
)
def test_the_requests_of_a_hobby_servo_differ_for_known_reasons(model, desired, main):
    shares = difference(invert_closed_form(model, desired), invert_optimal(model, desired)).shares
    others = {reason: share for reason, share in shares.items() if reason != "corner"}
    assert max(others, key=others.get) == main
    assert shares.get("free", 0.0) < 0.03


@pytest.mark.parametrize(
    ("closed_form", "optimised", "apart", "reason"),
    [
        (0.0, 0.2, 0.3, "line"),
        (-0.3, 0.2, 0.3, "free"),
        (0.0, 0.5, 0.3, "free"),
        (0.0, 0.2, 0.6, "free"),
        (0.0, 0.2, 0.9, "averaged"),
        (0.0, 0.0, 0.1, "averaged"),
    ],
)
def test_a_line_off_the_path_explains_what_it_causes_and_no_fault(
    closed_form, optimised, apart, reason
):
    """The line is at 0, the path at 0.2; faults are plans that are neither on it nor good."""
    reasons = classify(
        _plan(knots=[30.0, 59.0], predicted=np.full(SAMPLES, closed_form),
              desired=np.full(SAMPLES, 0.2)),
        _plan(predicted=np.full(SAMPLES, optimised), requests=np.full(SAMPLES, apart),
              desired=np.full(SAMPLES, 0.2)),
    )  # fmt: skip
    assert set(reasons) == {"corner", reason}


@pytest.mark.parametrize("cyclic", [True, False])
@pytest.mark.parametrize("hold", [1, 3])
def test_the_intervals_of_real_plans_cover_every_request_once(cyclic, hold):
    rng = np.random.default_rng(hold)
    model = random_model(rng, whole=False, hold=hold, offset=True)
    desired = saturating(rng, model)
    found = difference(
        invert_closed_form(model, desired, cyclic=cyclic, segments=6, rule="exact"),
        invert_optimal(model, desired, cyclic=cyclic),
    )
    covered = [
        (interval.start + k) % len(desired)
        for interval in found.intervals
        for k in range(interval.samples)
    ]
    assert sorted(covered) == list(range(len(desired)))
    assert sum(interval.share for interval in found.intervals) == pytest.approx(1.0)
    for interval in found.intervals:
        assert interval.end == (interval.start + interval.samples - 1) % len(desired)


def test_on_the_reference_walk_the_plans_differ_most_where_the_joint_is_at_its_top_speed():
    joint = REFERENCE_JOINTS[0]
    model = JointModel.ers210a()
    shares = difference(
        invert_closed_form(model, joint.desired, segments=6),
        invert_optimal(model, joint.desired, limits=joint.limits),
    ).shares
    assert max(shares, key=shares.get) == "saturated"
