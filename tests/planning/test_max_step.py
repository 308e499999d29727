"""The largest change from one request to the next: kept exactly, at little cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import invert_foot, invert_optimal, reference_walk
from tests.instances import ERS210A, REFERENCE_JOINTS, random_model, saturating

EXACT = 1e-12  # by how much a step may exceed the limit: the rounding of one subtraction [relative]
CYCLIC = pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])


def steps(requests, *, cyclic):
    """Sizes of the changes from one request to the next [rad]."""
    return np.abs(np.diff(requests, axis=0, append=requests[:1] if cyclic else requests[-1:]))


def random_instance(seed):
    """A joint and a path with all that a plan may have, by seed: options of invert_optimal."""
    rng = np.random.default_rng([31, seed])
    model = random_model(rng, whole=bool(rng.integers(2)), hold=int(rng.integers(1, 4)))
    desired = saturating(rng, model, samples=int(rng.integers(20, 60)))
    cyclic = bool(rng.integers(2))
    options = {
        "cyclic": cyclic,
        "norm": ["rms", "max"][int(rng.integers(2))],
        "max_step": float(model.v_max * model.period * rng.uniform(0.1, 3.0)),
        "smoothness": [0.0, 0.005, 0.05][int(rng.integers(3))],
    }
    if rng.integers(2):
        model = replace(model, dead_band=rng.uniform(0.0, 0.5) * model.theta_0, compliance=0.02)
        options["load"] = rng.uniform(-1.0, 1.0, size=len(desired))
    if rng.integers(2):
        room = 0.02 + model.dead_band
        options["limits"] = (desired.min() - room, desired.max() + room)
    return model, desired, options


@pytest.mark.parametrize("kind", ["plain", "inertia", "several"])
@pytest.mark.parametrize("seed", range(6))
def test_steps_and_requests_are_within_their_limits_whatever_else_is_asked_for(seed, kind):
    model, desired, options = random_instance(seed)
    if kind == "inertia":
        model = replace(model, time_constant=0.016)
    models = [model, replace(model, lag=model.lag + 0.01)] if kind == "several" else model
    made = invert_optimal(models, desired, **options)
    task, limit = made.plan.task, options["max_step"]
    assert np.max(steps(made.requests, cyclic=made.cyclic)) <= limit * (1.0 + EXACT)
    assert made.largest_step <= limit * (1.0 + EXACT)
    if task.limits[0] is not None:
        assert task.limits[0][0] <= np.min(made.requests)
        assert np.max(made.requests) <= task.limits[0][1]
    if not made.cyclic:
        load = 0.0 if task.loads[0] is None else task.loads[0][0]
        holding = task.starts[0] - model.sag(load)  # the middle of the requests that hold it
        assert made.requests[0] == pytest.approx(holding, abs=model.dead_band + 1e-12)
    assert made.error >= made.lower_bound - 1e-9


def test_a_wide_limit_changes_nothing_much_and_a_narrow_one_leaves_a_constant():
    joint = REFERENCE_JOINTS[0]
    free = invert_optimal(ERS210A, joint.desired)
    wide = invert_optimal(ERS210A, joint.desired, max_step=2.0)
    assert wide.rms == pytest.approx(free.rms, rel=0.005)
    narrow = invert_optimal(ERS210A, joint.desired, max_step=1e-6)
    assert np.ptp(narrow.requests) <= 88e-6
    assert narrow.rms == pytest.approx(np.std(joint.desired), rel=1e-3)


@CYCLIC
def test_the_foot_keeps_one_limit_or_one_for_each_joint(cyclic):
    walk = reference_walk()
    limits = np.radians([4.0, 5.0, 6.0])
    made = invert_foot(ERS210A, walk.leg, walk.desired_foot, cyclic=cyclic, max_step=limits)
    assert np.all(steps(made.requests, cyclic=cyclic) <= limits * (1.0 + EXACT))
    if cyclic:
        free = invert_foot(ERS210A, walk.leg, walk.desired_foot)
        assert made.rms <= 1.02 * free.rms
