"""The shortest cycle of a foot within a tolerance."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kinematics import Leg, urdf_path
from planner import Infeasible, invert_foot
from planner.gait import stride
from planner.gait.stride import in_samples
from tests.instances import ERS210A

HELD = replace(ERS210A, hold=2)
TOLERANCE = 0.004


@pytest.fixture(scope="module")
def leg():
    return Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")


@pytest.fixture(scope="module")
def circle(leg):
    """A circle of 1 cm around the foot of a bent leg [m], in 24 samples."""
    middle = leg.foot_positions(np.radians([[0.0, 10.0, 60.0]]))[0]
    phase = 2.0 * np.pi * np.arange(24) / 24
    return middle + 0.01 * np.column_stack([np.cos(phase), np.zeros(24), np.sin(phase)])


def test_the_foot_keeps_the_tolerance_and_not_in_a_sample_less(leg, circle, monkeypatch):
    monkeypatch.setattr(stride, "FEWEST", 11)
    monkeypatch.setattr(stride, "PROOFS", 0)
    found = stride.shortest_cycle(
        ERS210A, leg, lambda count: in_samples(circle, count), tolerance=TOLERANCE, samples=16
    )
    assert found.plan.max_error <= TOLERANCE
    task = found.plan.plan.task
    np.testing.assert_array_equal([task.lower, task.upper], leg.limits)
    assert found.period == pytest.approx(found.samples * ERS210A.period)
    if found.samples > 11:
        shorter = in_samples(circle, found.samples - 1)
        assert invert_foot(ERS210A, leg, shorter, norm="max").max_error > TOLERANCE
    assert found.too_short is None  # no proof was asked for


def test_a_path_in_as_many_samples_is_itself(circle):
    assert in_samples(circle, 24) == pytest.approx(circle)
    assert in_samples(circle, 12) == pytest.approx(circle[::2])
    twice = in_samples(circle, 48)
    assert twice[::2] == pytest.approx(circle)
    assert twice[1::2] == pytest.approx((circle + np.roll(circle, -1, axis=0)) / 2.0)


def test_a_path_that_any_cycle_keeps_takes_the_fewest_samples(leg, circle):
    middle = circle.mean(axis=0)
    found = stride.shortest_cycle(
        ERS210A, leg, lambda count: np.tile(middle, (count, 1)), tolerance=TOLERANCE, samples=16
    )
    assert (found.samples, found.too_short) == (stride.FEWEST, None)


def test_a_cycle_that_is_proved_too_short_is_one_whose_bound_exceeds_the_tolerance(
    leg, monkeypatch
):
    def plan(models, leg, path, **options):  # noqa: ARG001
        return SimpleNamespace(
            requests=path, models=[HELD], max_error=1.0 / len(path), lower_bound=0.9 / len(path)
        )

    monkeypatch.setattr(stride, "invert_foot", plan)
    monkeypatch.setattr(stride, "MOST", 50)
    for samples in (25, 88):
        found = stride.shortest_cycle(
            ERS210A, leg, lambda count: np.zeros((count, 3)), tolerance=1.0 / 40.0, samples=samples
        )
        assert (found.samples, found.period) == (40, pytest.approx(40 * 0.016))
        assert found.too_short == (35, 0.9 / 35)


def test_a_tolerance_that_no_cycle_keeps_is_refused_with_the_largest_distance(
    leg, circle, monkeypatch
):
    monkeypatch.setattr(stride, "MOST", 20)
    largest = invert_foot(ERS210A, leg, in_samples(circle, 16), norm="max").max_error
    with pytest.raises(Infeasible, match=f"cycle of 16 samples .* {100.0 * largest:.3g} cm off"):
        stride.shortest_cycle(
            ERS210A, leg, lambda count: in_samples(circle, count), tolerance=1e-9, samples=16
        )
