"""Plans for joints with a motor's time constant and an acceleration limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import planner

PAPER = planner.JointModel.ers210a()

INERT = replace(PAPER, acceleration_time=0.016, time_constant=0.024)

STARTING_SLOWLY = replace(PAPER, acceleration_time=0.008, max_acceleration=120.0)

STICKY = replace(INERT, dead_band=0.02, tick=0.004, hold=2)

OVERSHOOTING = replace(STICKY, dead_band=0.005, max_acceleration=150.0, integral_rate=12.0)
"""A cascade of loops, that for the speed with an integral."""

SWING = 0.4 * np.sin(2.0 * np.pi * np.arange(60) / 60) ** 3
"""A path that these joints can nearly follow [rad]."""


EVERY = pytest.mark.parametrize(
    "model", [INERT, STARTING_SLOWLY, STICKY, OVERSHOOTING], ids=["T", "A", "both", "integral"]
)


@EVERY
@pytest.mark.parametrize("cyclic", [True, False], ids=["cyclic", "from rest"])
def test_a_plan_with_inertia_is_better_than_the_closed_form_and_keeps_the_bound(model, cyclic):
    plan = planner.invert_optimal(model, SWING, cyclic=cyclic)
    form = planner.invert_closed_form(model, SWING, cyclic=cyclic)
    assert plan.rms < form.rms
    for level in ("slope", "envelope", "exact"):
        bound = planner.lower_bound(model, SWING, cyclic=cyclic, level=level)
        assert bound <= min(plan.rms, form.rms) + 1e-12


@pytest.mark.parametrize("model", [INERT, STARTING_SLOWLY], ids=["T", "A"])
def test_a_plan_for_the_window_of_the_same_delay_misses_what_the_inertia_does(model):
    delay = model.time_constant if model is INERT else 0.02
    window = replace(PAPER, acceleration_time=model.acceleration_time + 2.0 * delay)
    plan = planner.invert_optimal(model, SWING, smoothness=0.0)
    blind = planner.invert_optimal(window, SWING, smoothness=0.0)
    angles = planner.simulate(model, blind.requests)
    assert plan.rms <= 0.5 * np.sqrt(np.mean((angles - SWING) ** 2))


def test_casadis_transcription_finds_little_better():
    plan = planner.invert_optimal(STICKY, 2.0 * SWING[::2], smoothness=0.0)
    other = planner.invert_optimal(STICKY, 2.0 * SWING[::2], solver="ipopt", smoothness=0.0)
    assert plan.rms <= 1.005 * other.rms + 1e-4


def test_limits_and_steps_are_kept():
    options = {"limits": (-0.45, 0.45), "max_step": 0.05}
    plan = planner.invert_optimal(INERT, SWING, **options)
    assert np.all(np.abs(plan.requests) <= 0.45)
    assert np.max(np.abs(np.diff(plan.requests, append=plan.requests[0]))) <= 0.05


@EVERY
def test_a_stream_follows_a_path_with_the_inertia_in_mind(model):
    path = 0.3 - 0.3 * np.cos(2.0 * np.pi * np.arange(200) / 100)[:, np.newaxis]
    stream = planner.Stream(model, preview=25, limits=(-1.0, 1.0))
    sent = [stream.step(path[k : k + 25])[0] for k in range(len(path))]
    angles = planner.simulate(model, sent, cyclic=False)
    assert np.sqrt(np.mean((angles - path[:, 0]) ** 2)) <= 0.01


def test_the_closed_form_switches_later_by_the_time_constant():
    without = replace(INERT, time_constant=0.0)
    assert INERT.switching_time - without.switching_time == pytest.approx(0.024)
    followed = replace(INERT, integral_rate=12.0)  # an integral makes up for it
    assert followed.switching_time == pytest.approx(without.switching_time)


def test_no_closed_form_does_better_on_a_square_that_an_acceleration_limit_keeps_out_of_reach():
    model = planner.JointModel(
        v_max=6.6, theta_0=0.1, lag=0.012, acceleration_time=0.027, hold=2, max_acceleration=81.0
    )
    square = 0.8 * np.repeat([1.0, -1.0], 20)
    plan = planner.invert_optimal(model, square, smoothness=0.0)
    forms = [planner.invert_closed_form(model, square, rule=rule) for rule in ("paper", "exact")]
    assert plan.rms <= min(form.rms for form in forms) + 1e-12
