"""The search behind the exact bound: no response that is better than what is known is ever lost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import invert_optimal
from planner.inversion.arguments import NORMS
from planner.inversion.bounds.branch_and_bound import Node, branches, exact_bound, strengthen
from planner.inversion.bounds.reachable_set import BoundProblem
from planner.inversion.bounds.saturation_relaxation import Task, nearest, rows
from planner.inversion.bounds.tightening import tighten
from planner.inversion.certify import certify, lower_bound, planned_error
from planner.model.joint import JointModel
from planner.model.response import simulate
from tests.instances import REFERENCE_JOINTS, random_model, saturating
from tests.strategies import models, trajectories

ERS210A = JointModel.ers210a()

ROUNDING = 1e-7
"""Rounding of angles, calls and cuts, in units of v_max a tick: the cycle closes to 1e-12 rad."""

WITHIN = 1e-3
"""What plans of the reference walk's joints may be above the bound."""


def error(angles, desired, norm):
    errors = np.abs(angles - desired)
    return float(np.max(errors) if norm == "max" else np.sqrt(np.mean(errors**2)))


def unknowns(task, model, requests, middle, *, cyclic, start):
    """What the response to the requests is among the task's unknowns, and its requests."""
    every_tick = replace(model, hold=1)
    held = np.repeat(requests, model.hold)[: task.ticks]
    angles = simulate(every_tick, held, cyclic=cyclic, start=start)
    before = np.roll(angles, 1)
    if not cyclic:
        before[0] = requests[0] + model.offset if start is None else start
    scaled = (np.asarray(requests) + model.offset - middle) / task.unit
    entries = task.entries
    at = (before[entries.tick] - middle) / task.unit
    calls = np.clip(task.gain * (scaled[entries.request] - at), -1.0, 1.0)
    return np.concatenate([(angles - middle) / task.unit, calls]), scaled


def violation(task, node, point, requests):
    """By how much the response misses what the node says about it."""
    matrix, limits = rows(task, node.ranges, node.cuts)
    above = matrix @ point - limits
    equations = task.driven.shape[0]
    worst = max(float(np.max(np.abs(above[:equations]))), float(np.max(above[equations:])))
    for request, (lower, upper) in node.between.items():
        worst = max(worst, lower - requests[request], requests[request] - upper)
    return worst


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("kind", ["cyclic", "from rest", "from a start"])
@settings(max_examples=12, deadline=None)
@given(
    model=models(),
    requests=trajectories(least=4, most=9, reach=0.5),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_response_better_than_what_is_known_stays_in_some_part(kind, norm, model, requests, seed):
    rng = np.random.default_rng(seed)
    cyclic = kind == "cyclic"
    start = float(requests[0] + model.offset) if kind == "from a start" else None
    angles = simulate(model, requests, cyclic=cyclic, start=start)
    desired = angles + rng.normal(size=len(angles)) * model.theta_0 * 10.0 ** rng.uniform(-2, 0)
    known = 1.0001 * error(angles, desired, norm)
    task = Task(BoundProblem(model, desired, cyclic, norm, start), known)
    point, scaled = unknowns(
        task, model, requests, float(np.mean(desired)), cyclic=cyclic, start=start
    )
    until = math.inf
    ranges = task.initial_ranges()
    node = Node(0.0, dict(task.pinned), ranges, [], nearest(task, ranges, []))
    assert violation(task, node, point, scaled) <= ROUNDING
    for _ in range(2):
        assert tighten(task, ranges, node.proof, range(task.ticks), until=until)
        node = strengthen(task, node, until)
        assert violation(task, node, point, scaled) <= ROUNDING
        assert node.bound * task.unit <= error(angles, desired, norm) + ROUNDING
    for _ in range(3):  # follow it down the tree
        parts = branches(task, node, until)
        misses = [violation(task, part, point, scaled) for part in parts]
        assert min(misses) <= ROUNDING
        node = parts[int(np.argmin(misses))]
        assert node.bound * task.unit <= error(angles, desired, norm) + ROUNDING


@pytest.mark.usefixtures("counted_seconds")
@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("share", [0.5, 0.99, 3.0])
def test_the_bound_is_valid_whatever_is_said_to_be_known(share, norm):
    rng = np.random.default_rng(5)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=24)
    best = invert_optimal(model, desired, norm=norm).error
    known = share * best
    bound = exact_bound(BoundProblem(model, desired, True, norm, None), known, time_limit=1.0)
    assert bound <= min(known, best)


@pytest.mark.usefixtures("counted_seconds")
def test_what_no_response_goes_below_is_proved_to_the_full():
    rng = np.random.default_rng(5)
    model = random_model(rng, whole=False)
    desired = saturating(rng, model, samples=24)
    known = 0.5 * lower_bound(model, desired)
    bound = exact_bound(BoundProblem(model, desired, True, "rms", None), known, time_limit=5.0)
    assert bound == pytest.approx(known, rel=1e-3)


@pytest.mark.usefixtures("counted_seconds")
@pytest.mark.parametrize("joint", REFERENCE_JOINTS, ids=lambda joint: joint.name)
def test_plans_of_the_reference_walk_are_within_a_thousandth_of_the_best(joint):
    certificate = certify(ERS210A, joint.desired, level="exact", time_limit=3.0)
    assert math.degrees(certificate.bound) >= joint.exact_bound_deg
    plan = invert_optimal(ERS210A, joint.desired, limits=joint.limits)
    assert 0.0 <= plan.rms / certificate.bound - 1.0 <= WITHIN
    assert certificate.solver_gap <= WITHIN


@pytest.mark.usefixtures("counted_seconds")
@pytest.mark.parametrize("cyclic", [True, False])
def test_two_angles_are_bounded_too(cyclic):
    model = random_model(np.random.default_rng(0), whole=False)
    desired = np.array([0.0, 1.0])
    known = planned_error(BoundProblem(model, desired, cyclic, "rms", None))
    assert known == pytest.approx(0.5)
    bound = lower_bound(model, desired, cyclic=cyclic, level="exact", time_limit=3.0)
    assert lower_bound(model, desired, cyclic=cyclic) <= bound <= known
