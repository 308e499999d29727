"""The search behind the exact bound: no response that is better than what is known is ever lost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import invert_optimal
from planner.model.joint import JointModel
from planner.model.response import simulate
from planner.planning.bounds.certify import certify, lower_bound
from planner.planning.bounds.exact import Node, branch, cut_off, exact_bound, tighten
from planner.planning.bounds.reachable_set import BoundProblem
from planner.planning.bounds.saturation_relaxation import (
    ScaledProblem,
    conditions,
    solve_relaxation,
)
from tests.instances import REFERENCE_JOINTS, random_model, saturating
from tests.strategies import models, trajectories

ERS210A = JointModel.ers210a()

ROUNDING = 1e-7
"""Rounding of angles, contributions and cuts [v_max a tick]; the cycle closes to 1e-12 rad."""

WITHIN = 1e-3
"""What plans of the reference walk's joints may be above the bound."""


def error(angles, desired, norm):
    errors = np.abs(angles - desired)
    return float(np.max(errors) if norm == "max" else np.sqrt(np.mean(errors**2)))


def unknowns(problem, model, requests, middle, *, cyclic, start):
    """What the response to the requests is among the problem's unknowns, and its requests."""
    every_tick = replace(model, hold=1)
    held = np.repeat(requests, model.hold)[: problem.ticks]
    angles = simulate(every_tick, held, cyclic=cyclic, start=start)
    before = np.roll(angles, 1)
    if not cyclic:
        before[0] = requests[0] + model.offset if start is None else start
    scaled = (np.asarray(requests) + model.offset - middle) / problem.unit
    pairs = problem.pairs
    at = (before[pairs.tick] - middle) / problem.unit
    contributions = model.speed(problem.unit * (scaled[pairs.request] - at)) / model.v_max
    return np.concatenate([(angles - middle) / problem.unit, contributions]), scaled


def violation(problem, node, point, requests):
    """By how much the response misses what the node says about it."""
    matrix, limits = conditions(problem, node.ranges, node.cuts)
    above = matrix @ point - limits
    equations = problem.equations
    worst = max(float(np.max(np.abs(above[:equations]))), float(np.max(above[equations:])))
    for request, (lower, upper) in node.intervals.items():
        worst = max(worst, lower - requests[request], requests[request] - upper)
    return worst


def without_dead_band(model):
    """The joint without what the level "exact" was not derived for."""
    return replace(model, dead_band=0.0)


@pytest.mark.parametrize(
    ("kind", "norm"),
    [("cyclic", "rms"), ("from rest", "rms"), ("from a start", "max")],
)
@settings(max_examples=4)
@given(
    model=st.one_of(
        models(holds=(1, 2)), models(holds=(1, 2), friction=True).map(without_dead_band)
    ),
    requests=trajectories(least=4, most=7, reach=0.5),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_response_better_than_what_is_known_stays_in_some_part(kind, norm, model, requests, seed):
    rng = np.random.default_rng(seed)
    cyclic = kind == "cyclic"
    start = float(requests[0] + model.offset) if kind == "from a start" else None
    angles = simulate(model, requests, cyclic=cyclic, start=start)
    desired = angles + rng.normal(size=len(angles)) * model.theta_0 * 10.0 ** rng.uniform(-2, 0)
    known = 1.0001 * error(angles, desired, norm)
    problem = ScaledProblem(BoundProblem(model, desired, cyclic, norm, start), known)
    point, scaled = unknowns(
        problem, model, requests, float(np.mean(desired)), cyclic=cyclic, start=start
    )
    ranges = problem.initial_ranges()
    node = Node(0.0, dict(problem.fixed), ranges, [], solve_relaxation(problem, ranges, []))
    assert violation(problem, node, point, scaled) <= ROUNDING
    for _ in range(2):
        assert tighten(problem, ranges, node.solution, range(problem.ticks))
        node = cut_off(problem, node)
        assert violation(problem, node, point, scaled) <= ROUNDING
        assert node.bound * problem.unit <= error(angles, desired, norm) + ROUNDING
    for _ in range(3):  # follow it down the tree
        parts = branch(problem, node)
        if not parts:
            break  # no cut is left
        misses = [violation(problem, part, point, scaled) for part in parts]
        assert min(misses) <= ROUNDING
        node = parts[int(np.argmin(misses))]
        assert node.bound * problem.unit <= error(angles, desired, norm) + ROUNDING


@pytest.mark.parametrize(("share", "norm"), [(0.99, "rms"), (3.0, "max")])
def test_the_bound_is_valid_whatever_is_said_to_be_known(share, norm):
    rng = np.random.default_rng(5)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=24)
    best = invert_optimal(model, desired, norm=norm).error
    known = share * best
    bound = exact_bound(BoundProblem(model, desired, True, norm, None), known, time_limit=0.3)
    assert bound <= min(known, best)


def test_what_no_response_goes_below_is_proved_to_the_full():
    rng = np.random.default_rng(5)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=24)
    known = 0.5 * lower_bound(model, desired)
    bound = exact_bound(BoundProblem(model, desired, True, "rms", None), known, time_limit=1.0)
    assert bound == pytest.approx(known, rel=1e-3)


def test_the_plan_of_the_reference_walk_is_within_a_thousandth_of_the_best():
    joint = REFERENCE_JOINTS[0]
    certificate = certify(ERS210A, joint.desired, level="exact", time_limit=2.0)
    assert math.degrees(certificate.bound) >= joint.exact_bound_deg
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits, smoothness=0.0)
    assert 0.0 <= plan.rms / certificate.bound - 1.0 <= WITHIN
    assert certificate.solver_gap <= WITHIN
