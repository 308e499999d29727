"""What the model does not have is named where it shows, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import planner
from planner.identification.residual_patterns import _ringing
from tests.identification.made import (
    AIBO,
    NOISE,
    changed,
    hobby_servo,
    identified_rich,
    identified_steps,
    measured,
    rich_log,
    step_logs,
)

NAMES = ("asymmetry:", "mechanical stop", "ringing:", "slow drift", "backlash:")


def named(found):
    return {name for name in NAMES if any(name in text for text in found.warnings)}


def stopped():
    log = rich_log(noise=NOISE, rows=800)
    return changed(log, angles=np.minimum(log.angles, 0.3))


def rings():
    (log,) = step_logs(amplitudes=(0.5,), quantum=0.0)
    edges = np.flatnonzero(np.diff(log.requests)) + 1
    angles = log.angles.copy()
    for edge in edges:
        rows = np.arange(edge, len(angles))
        since = (rows - edge - 20.0).clip(0.0) * log.period
        step = log.requests[edge] - log.requests[edge - 1]
        angles[rows] += 0.3 * step * np.sin(50.0 * since) * np.exp(-25.0 * since)
    return changed(log, angles=angles)


def drifts():
    log = rich_log(noise=NOISE, rows=800)
    return changed(log, angles=log.angles + np.linspace(-0.05, 0.05, 800))


def asymmetric():
    return rich_log(replace(AIBO, v_offset=0.15 * AIBO.v_max), noise=NOISE, rows=800)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (stopped, "mechanical stop"),
        (rings, "ringing:"),
        (drifts, "slow drift"),
        (asymmetric, "asymmetry:"),
    ],
)
def test_what_the_model_does_not_have_is_named(make, name):
    assert name in named(planner.identify(make(), hold_out=False))


def test_ringing_that_the_models_inertia_explains_is_not_named():
    heavy = replace(AIBO, theta_0=0.05, time_constant=0.04)
    (log,) = step_logs(heavy, amplitudes=(0.3,), quantum=0.0)
    found = planner.identify(log, hold_out=False)
    (fit,) = found.fits
    step = int(np.flatnonzero(np.diff(log.requests))[0]) + 1
    assert np.max(fit.predicted[step:]) > 1.05 * np.max(log.requests), "the model overshoots"
    assert "ringing:" not in named(found)


def test_the_same_steps_ring_in_a_mirrored_log():
    """Three steps up and two down; a third one down is one that the joint does not make."""
    asked, reached = np.array([[0.0, 0.5, 0.0, 0.5, 0.0, 0.5, level] for level in (-0.1, 0.45)])
    since = 0.008 * np.tile(np.arange(60.0), 7)
    requests, angles, modelled = np.repeat([asked, reached, asked], 60, axis=1)
    left = np.exp(-20.0 * since)
    angles -= left * np.cos(50.0 * since) * np.repeat(np.diff(reached, prepend=0.0), 60)
    modelled -= left * np.repeat(np.diff(asked, prepend=0.0), 60)
    notes = []
    for way in (1.0, -1.0):
        times = 0.008 * np.arange(420)
        log = planner.Log(times=times, requests=way * requests, angles=way * angles, name="log")
        fit = SimpleNamespace(log=log, predicted=way * modelled)
        notes.append(_ringing(AIBO, fit, 1e-4))
    assert notes[0] == notes[1]
    ((_, _, values),) = notes[0]
    assert (values["over"], values["steps"]) == (5, 5)


def test_rows_at_a_mechanical_stop_are_left_out_with_a_note():
    log = stopped()
    found = planner.identify(log, hold_out=False)
    (said,) = (text for text in found.warnings if "mechanical stop" in text)
    assert "stays at its largest angle, 0.3" in said
    assert said.endswith("these rows are left out")
    at_stop = log.angles == 0.3
    assert np.mean(found.fits[0].used[at_stop]) <= 0.2  # its first rows, until the model is beyond
    assert found.fits[0].used[~at_stop].mean() >= 0.9
    assert found.verdict == "holds"
    for name in ("v_max", "theta_0"):
        assert abs(getattr(found.model, name) / getattr(AIBO, name) - 1.0) <= 0.05


def test_a_loaded_hobby_servo_is_predicted_and_its_asymmetry_named():
    rng = np.random.default_rng(0)
    requests = np.repeat(rng.uniform(-1.2, 1.2, size=24), rng.integers(15, 60, size=24))
    found = planner.identify(hobby_servo(requests, 0.02))
    assert np.degrees(found.held_out_rms) <= 5.5
    assert "asymmetry:" in named(found)
    up, down = (found.model.v_max + way * found.model.v_offset for way in (1.0, -1.0))
    assert abs(np.degrees(up) / 220.0 - 1.0) <= 0.1
    assert 250.0 <= np.degrees(down) <= 360.0  # seldom reached: it still accelerates


def test_logs_that_contradict_each_other_are_said_to():
    one = replace(rich_log(noise=NOISE), name="first")
    other = replace(rich_log(noise=NOISE, seed=1), name="second")
    assert not any("contradict" in text for text in planner.identify([one, other]).warnings)
    moved = replace(other, angles=other.angles + 0.05)
    found = planner.identify([one, moved], hold_out=False)
    (said,) = (text for text in found.warnings if "contradict" in text)
    assert "higher in second than in first" in said


def test_a_joint_like_the_model_shows_nothing():
    assert not named(identified_steps())
    assert not named(identified_rich())


def test_a_log_in_which_the_joint_is_sent_nowhere_is_no_fault():
    log = rich_log(noise=NOISE, rows=400)
    idle = changed(log, requests=np.full(400, 0.1), angles=np.full(400, 0.1))
    assert planner.identify([log, idle], hold_out=False).rms < 2.0 * NOISE


STICKY = planner.JointModel(
    tick=0.02, hold=1, lag=0.02, acceleration_time=0.04, v_max=4.0, theta_0=0.3, dead_band=0.02
)
"""A joint whose dry friction shows, logged at 50 Hz."""


def holds_log(model=STICKY, *, seed=0, rows=3000, largest=0.6):
    """Ramps between angles that are held for a second or so."""
    rng = np.random.default_rng(seed)
    places, requests = rng.uniform(-largest, largest, size=rows), [0.0]
    for place in places[: rows // 60]:
        ramp = max(2, round(abs(place - requests[-1]) / 0.03))
        requests += np.linspace(requests[-1], place, ramp)[1:].tolist() + [place] * 50
    requests = np.array(requests[:rows])
    angles = planner.simulate(model, requests, cyclic=False)
    noisy = measured(angles, rng, noise=0.0005, quantum=0.0015)
    return planner.Log(times=0.02 * np.arange(len(requests)), requests=requests, angles=noisy)


def on_the_table(log, *, table=-0.35):
    """The joint stands on something: it does not go below, and rests on it at several angles."""
    low = log.angles < table
    return replace(log, angles=np.where(low, table + 0.25 * (log.angles - table), log.angles)), low


def test_rows_in_which_the_joint_stands_on_something_are_left_out_with_a_note():
    log, low = on_the_table(holds_log())
    found = planner.identify(log)
    (said,) = (text for text in found.warnings if "contact" in text)
    assert "places of rest" in said
    assert said.endswith("these rows are left out")
    (fit,) = found.fits
    rested = np.abs(log.requests - holds_log().angles) < 0.021
    assert np.mean(fit.used[low & rested & (log.requests < -0.45)]) < 0.2
    assert np.mean(fit.used[~low]) > 0.9
    assert found.model.dead_band == pytest.approx(STICKY.dead_band, rel=0.1)


def test_a_joint_with_friction_that_stands_on_nothing_has_no_contact():
    for seed in range(3):
        found = planner.identify(holds_log(seed=seed), hold_out=False)
        assert not any("contact" in text for text in found.warnings)


def test_the_dead_band_is_that_of_calm_motion():
    """A log whose joint is shaken shows half of it."""
    shaken = replace(holds_log(replace(STICKY, dead_band=0.01), seed=1), name="shaken")
    found = planner.identify([replace(holds_log(), name="calm"), shaken], hold_out=False)
    assert found.model.dead_band == pytest.approx(STICKY.dead_band, rel=0.05)
    same = planner.identify([holds_log(), holds_log(seed=2)], hold_out=False)
    assert same.model.dead_band == pytest.approx(STICKY.dead_band, rel=0.05)


def test_rows_without_torque_do_not_make_a_log_wide():
    """A log of small motion, moved by hand in the end."""
    shaken = holds_log(replace(STICKY, dead_band=0.01), seed=1)
    last = np.arange(len(shaken.times)) >= 0.75 * len(shaken.times)
    moved = np.where(last, shaken.angles + 2.0 * np.sin(0.5 * shaken.times), shaken.angles)
    by_hand = replace(shaken, name="shaken", angles=moved, torque_on=~last)
    found = planner.identify([replace(holds_log(), name="calm"), by_hand], hold_out=False)
    assert found.model.dead_band == pytest.approx(STICKY.dead_band, rel=0.05)


def test_the_dead_band_is_not_that_of_a_log_of_small_motion_alone():
    """What holds a joint at rest is more than what slows it down."""
    held = replace(STICKY, dead_band=1.5 * STICKY.dead_band)
    small = replace(holds_log(held, seed=1, largest=0.2), name="small")
    found = planner.identify([holds_log(), small], hold_out=False)
    assert found.model.dead_band < 1.35 * STICKY.dead_band  # both fitted together
    alone = planner.identify(small, hold_out=False)
    assert alone.model.dead_band == pytest.approx(held.dead_band, rel=0.05)
