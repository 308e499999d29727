"""Dry friction, asymmetry and load are found where they are, and exactly 0 where they are not."""

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.identification.excitation import excite
from tests.identification.made import AIBO, measured, rich_log, swung
from tests.identification.made import FINE_NOISE as NOISE
from tests.identification.made import FINE_QUANTUM as QUANTUM
from tests.instances import joint_of

STICKY = replace(AIBO, dead_band=math.radians(2.0))


def noisy_log(model, *, seed=0, rows=1500, load=None):
    log = rich_log(model, seed=seed, rows=rows, amplitude=0.4, load=load)
    angles = measured(log.angles, np.random.default_rng(seed), noise=NOISE, quantum=QUANTUM)
    return replace(log, angles=angles, load=load)


def term(found, name):
    return next(each for each in found.terms if each.name == name)


@pytest.mark.parametrize(
    ("model", "reach"),
    [(AIBO, 0.3), (STICKY, 0.9), (replace(AIBO, v_offset=0.5, offset=0.05), 0.9)],
)
def test_a_joint_without_a_sag_by_the_angle_has_none_to_the_last_bit(model, reach):
    found = planner.identify(swung(model, reach=reach), hold_out=False)
    assert found.model.sag_sin == found.model.sag_cos == 0.0


def test_a_sag_by_the_angle_is_sought_where_no_torque_is_known_and_angles_are_angles():
    log = swung(AIBO)
    for other in (replace(log, load=np.zeros(len(log.times))), replace(log, unit="1")):
        names = {each.name for each in planner.identify(other, hold_out=False).terms}
        assert not names & {"sag_sin", "sag_cos"}


def test_a_motors_time_constant_is_found_beside_friction_and_not_where_there_is_none():
    truth = replace(AIBO, time_constant=0.04, acceleration_time=0.016, dead_band=math.radians(1.0))
    found = planner.identify(noisy_log(truth, rows=1500), hold_out=False)
    assert term(found, "time_constant").kept
    assert abs(found.model.time_constant - 0.04) <= 0.008
    assert abs(found.model.dead_band / truth.dead_band - 1.0) <= 0.1
    assert not planner.identify(noisy_log(AIBO, rows=1500), hold_out=False).model.has_inertia


@pytest.mark.parametrize("seed", [2, 5])
def test_a_term_that_saves_less_than_the_logarithm_of_the_rows_is_not_kept(seed):
    """Of 160 rows of noise one saves 2 % of the loss by chance; 3 % would count."""
    found = planner.identify(rich_log(noise=0.0035, rows=160, seed=seed), hold_out=False)
    saved = [1.0 - (each.rms_with / each.rms_without) ** 2 for each in found.terms]
    assert 0.01 < max(saved) < np.log(160) / 160.0
    assert not any(each.kept for each in found.terms)


def motor_logs(truth, seed, load=None):
    """A slow triangle, sines and steps at 50 Hz, as a good encoder reports them.

    ``load`` is the torque by the angle.
    """
    random = np.random.default_rng(seed)
    logs = []
    for kind in ("slow_triangle", "multisine", "steps"):
        reach = math.radians(50.0)
        signal = excite(kind, limits=(-reach, reach), period=0.02, duration=20.0)
        angles, torques = signal.requests, None
        for _ in range(5 if load else 1):
            torques = load(angles) if load else None
            angles = planner.simulate(truth, signal.requests, cyclic=False, load=torques)
        angles = measured(angles, random, noise=NOISE, quantum=QUANTUM)
        logs.append(
            planner.Log(times=signal.times, requests=signal.requests, angles=angles, load=torques)
        )
    return logs


def test_inertia_an_acceleration_limit_and_friction_are_found_together():
    """Alone none of them shows: the first is kept beside neither of the others."""
    terms = {"dead_band": math.radians(3.0), "time_constant": 0.07, "max_acceleration": 45.0}
    truth = joint_of(5.5, 0.4, 0.015, 0.005, tick=0.005, hold=4, **terms)
    found = planner.identify(motor_logs(truth, seed=1), hold_out=False)
    for name in ("time_constant", "max_acceleration", "dead_band", "v_max", "theta_0"):
        assert abs(getattr(found.model, name) / getattr(truth, name) - 1.0) <= 0.05, name
    assert found.rms <= 1.1 * math.hypot(NOISE, QUANTUM / math.sqrt(12.0))


WITH_LOOP = joint_of(
    5.5, 0.3, 0.008, 0.004, tick=0.002, hold=10, dead_band=math.radians(0.5), time_constant=0.035
)


@pytest.mark.parametrize(
    ("integral", "rate"), [("integral_rate", 15.0), ("position_integral_rate", 4.0)]
)
@pytest.mark.parametrize("known", [False, True], ids=["gravity", "load"])
def test_an_integral_and_the_sag_that_it_hides_are_found_together(integral, rate, known):
    """At rest the joint shows no sag, and its motion no integral to a model without one."""
    sags = {"sag_sin": -0.05}
    if known:
        sags = {"compliance": 0.05, "speed_per_torque": 0.05 * WITH_LOOP.v_max / WITH_LOOP.theta_0}
    truth = replace(WITH_LOOP, **{integral: rate}, **sags)
    found = planner.identify(
        motor_logs(truth, seed=2, load=(lambda q: -np.sin(q)) if known else None), hold_out=False
    )
    for name in (integral, "time_constant", "v_max", "theta_0"):
        assert getattr(found.model, name) == pytest.approx(getattr(truth, name), rel=0.05), name
    sag = "compliance" if known else "sag_sin"
    assert found.intervals[sag].lower <= sags[sag] <= found.intervals[sag].upper
    assert getattr(found.model, sag) == pytest.approx(sags[sag], rel=0.2)
    assert found.model.v_offset == 0.0  # gravity shows in the top speeds, too
    assert found.rms <= 1.1 * math.hypot(NOISE, QUANTUM / math.sqrt(12.0))
