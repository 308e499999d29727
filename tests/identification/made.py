"""Logs whose joint is known, and the recorded ones."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

import planner
from planner.identification.excitation import excite
from planner.identification.grid import timing_of
from planner.identification.joint_fit import fit_joint
from tests.instances import joint_of

AIBO = planner.JointModel.ers210a()
NOISE = math.radians(0.2)  # standard deviation of the made logs' noise [rad]
QUANTUM = math.radians(0.3)  # step of the made logs' sensor [rad]
FINE_NOISE, FINE_QUANTUM = math.radians(0.1), math.radians(0.09)  # the same of a good encoder [rad]

AMPLITUDES = tuple(map(math.radians, (30.0, 90.0)))
"""Step tests [rad]: small enough to see the joint close in, large enough to saturate it."""

JOINT = joint_of(5.0, 0.3, 0.02, 0.05, tick=0.005, hold=4)

STICKY = joint_of(4.0, 0.3, 0.02, 0.04, tick=0.02, hold=1, dead_band=0.02)
"""A joint whose dry friction shows, logged at 50 Hz."""


def measured(angles, rng, *, noise=NOISE, quantum=QUANTUM):
    """Angles as a noisy sensor of finite resolution reports them."""
    noisy = angles + rng.normal(scale=noise, size=len(angles)) if noise else angles
    return np.round(noisy / quantum) * quantum if quantum else noisy


def step_logs(
    model=AIBO, *, seed=0, amplitudes=AMPLITUDES, samples=88, cycles=3, noise=NOISE, quantum=QUANTUM
):
    """Step tests of a joint that rests at 0 before, one log for each amplitude."""
    rng = np.random.default_rng(seed)
    logs = []
    for amplitude in amplitudes:
        requests = np.tile(planner.step_test(amplitude, samples=samples), cycles)
        angles = planner.simulate(model, requests, cyclic=False, start=model.offset)
        logs.append(
            planner.Log(
                times=np.arange(len(requests)) * model.period,
                requests=requests,
                angles=measured(angles, rng, noise=noise, quantum=quantum),
            )
        )
    return logs


def rich_log(model=AIBO, *, seed=0, rows=400, amplitude=0.6, noise=0.0, quantum=0.0, load=None):
    """Steps of random height and length."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(4, 30, size=rows)
    heights = rng.uniform(-amplitude, amplitude, size=rows)
    requests = np.repeat(heights, lengths)[:rows]
    angles = planner.simulate(model, requests, cyclic=False, load=load)
    return planner.Log(
        times=np.arange(rows) * model.period,
        requests=requests,
        angles=measured(angles, rng, noise=noise, quantum=quantum),
    )


def servo(requests, period, *, top, gain, delay, constant, friction, most=math.inf, play=0.0):
    """Angles of a servo that is not the model, in steps of a millisecond [rad].

    The speed that it is called to follows the error of ``delay`` before; it gains that speed with a
    time constant and at most ``most`` [rad/s^2]. Coulomb friction, which holds an error of
    ``friction``, opposes the speed; ``top`` is the top speed that it leaves.
    Between motor and joint is play; the error is that of the joint.
    """
    fine = round(period / 0.001)
    step, half = period / fine, play / 2.0
    late = np.concatenate([np.full(round(delay / step), requests[0]), np.repeat(requests, fine)])
    motor = angle = requests[0]
    speed, angles = 0.0, []
    for k, request in enumerate(late[: fine * len(requests)].tolist()):
        if k % fine == 0:
            angles.append(angle)
        error, most_called = request - angle, top + gain * friction
        called = min(max(gain * error, -most_called), most_called)
        speed += min(max(step / constant * (called - speed), -step * most), step * most)
        held = step / constant * gain * friction
        speed -= min(max(speed, -held), held)
        motor += step * speed
        angle = min(max(angle, motor - half), motor + half)
    return np.array(angles)


def random_motion(random, period, *, kind, seconds, span):
    """Requests [rad] within a span: random steps, sines, or a third each, a triangle between."""
    count = round(seconds / period)
    lengths = random.integers(round(0.2 / period), round(0.8 / period), size=count)
    steps = np.repeat(random.uniform(-span, span, size=count), lengths)[:count]
    times = period * np.arange(count)
    turns = 2.0 * np.pi * np.outer(times, random.uniform(0.1, 1.5, 4))
    sines = np.sum(np.sin(turns + random.uniform(0.0, 2.0 * np.pi, 4)), axis=1)
    sines *= span / np.max(np.abs(sines))
    triangle = span * (4.0 * np.abs(times / 4.0 % 1.0 - 0.5) - 1.0)
    part = count // 3
    mixed = np.concatenate([steps[:part], triangle[:part], sines[: count - 2 * part]])
    return {"steps": steps, "sines": sines, "mixed": mixed}[kind]


def logged(joint: planner.JointModel, *, period: float, rows: int, seed: int = 0) -> planner.Log:
    """A log of a joint whose requests change with its rows, whatever its own ticks."""
    random = np.random.default_rng([seed, 1])
    requests = random_motion(random, period, kind="mixed", seconds=rows * period, span=1.0)
    times = period * np.arange(len(requests))
    ticks = joint.tick * np.arange(int(times[-1] / joint.tick) + 2)
    in_force = np.searchsorted(times, ticks + 1e-6 * joint.tick, side="right") - 1
    angles = np.interp(times, ticks, planner.simulate(joint, requests[in_force], cyclic=False))
    angles = measured(angles, random, noise=FINE_NOISE, quantum=FINE_QUANTUM)
    return planner.Log(times=times, requests=requests, angles=angles)


def holds_log(model=STICKY, *, seed=0, rows=1800, largest=0.6):
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


def on_the_table():
    """The joint stands on something: it does not go below, and rests on it at several angles."""
    log, table = holds_log(rows=3000), -0.35
    standing = table + 0.25 * (log.angles - table)
    return replace(log, angles=np.where(log.angles < table, standing, log.angles))


def caught():
    """Something holds the joint for two seconds."""
    log = rich_log(noise=NOISE, rows=1500)
    angles = log.angles.copy()
    angles[600:850] = angles[600]
    return replace(log, angles=angles)


def stopped():
    log = rich_log(noise=NOISE, rows=800)
    return replace(log, angles=np.minimum(log.angles, 0.3))


def rings():
    (log,) = step_logs(amplitudes=(0.5,), quantum=0.0)
    edges = np.flatnonzero(np.diff(log.requests)) + 1
    angles = log.angles.copy()
    for edge in edges:
        rows = np.arange(edge, len(angles))
        since = (rows - edge - 20.0).clip(0.0) * log.period
        step = log.requests[edge] - log.requests[edge - 1]
        angles[rows] += 0.3 * step * np.sin(50.0 * since) * np.exp(-25.0 * since)
    return replace(log, angles=angles)


def calm_and_shaken():
    """Step tests of a joint with friction, once calm and once shaken at 4 Hz by something else."""
    sticky = replace(AIBO, dead_band=0.02)
    (calm,) = step_logs(sticky, amplitudes=(0.5,), samples=250, noise=0.0, quantum=0.0015)
    shaking = 0.006 * np.sin(2.0 * np.pi * 4.0 * calm.times)
    return calm, replace(calm, angles=calm.angles + shaking)


def swung(model, *, seed=0, reach=0.9):
    """A log of slow and quick sines over most of a servo's range."""
    signal = excite("multisine", limits=(-reach, reach), period=model.period, duration=30.0)
    angles = planner.simulate(model, signal.requests, cyclic=False)
    angles = measured(angles, np.random.default_rng(seed), noise=FINE_NOISE, quantum=FINE_QUANTUM)
    return planner.Log(times=signal.times, requests=signal.requests, angles=angles)


@functools.cache
def identified_steps():
    """The joint of :func:`step_logs`, identified once for all tests."""
    return planner.identify(step_logs())


@functools.cache
def fitted_rich():
    """The fit to that log alone."""
    log = rich_log(noise=NOISE)
    (fit,) = fit_joint([log], timing_of([log], tick=None, hold=None))
    return fit


@functools.cache
def identified_rich():
    """The joint of :func:`rich_log` with noise, identified once for all tests."""
    return planner.identify(rich_log(noise=NOISE))


def so101(folder: Path, recording: str, joint: str) -> planner.Log:
    """One joint of the SO-101's recordings."""
    options = planner.LogOptions(joint=joint, unit="range" if joint == "Jaw" else "rad")
    (log,) = planner.read_logs(folder / "so101" / f"{recording}.csv", options=options)
    return log


def pendulum(folder: Path, servo: str, recording: str) -> planner.Log:
    """A servo that swings a weight."""
    (log,) = planner.read_logs(folder / servo / f"{recording}.csv")
    return log
