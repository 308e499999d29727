"""Whole answers on logs as robots write them, held by snapshots: numbers, notes, rows, evidence."""

from dataclasses import replace

import numpy as np
import pytest

import planner
from tests.identification.made import (
    AIBO,
    JOINT,
    NOISE,
    QUANTUM,
    calm_and_shaken,
    caught,
    measured,
    on_the_table,
    rich_log,
    rings,
    servo,
    stopped,
    swung,
)

ONE_WAY = np.concatenate([np.zeros(100), np.linspace(0.0, 2.0, 300), np.full(100, 2.0)])


def noisy(requests, *, joint=AIBO, noise=NOISE, quantum=0.0):
    """A log of a joint under these requests."""
    angles = planner.simulate(joint, requests, cyclic=False)
    return planner.Log(
        times=joint.period * np.arange(len(requests)),
        requests=requests,
        angles=measured(angles, np.random.default_rng(0), noise=noise, quantum=quantum),
    )


def mirrored(log):
    """The log with the other sign."""
    return replace(log, requests=-log.requests, angles=-log.angles)


def worn():
    """Failed readings, glitches, a long and a short gap, and rows without torque."""
    log = rich_log(replace(AIBO, dead_band=0.03), noise=NOISE / 2.0, rows=700)
    rows = np.arange(700)
    angles = np.where((rows >= 100) & (rows < 103), 5.0, log.angles)
    angles[[40, 41, 600]] += 2.0
    angles[200:230] = -np.pi
    return planner.Log(
        times=log.times + 2.0 * (rows >= 300) + 0.7 * (rows >= 302),
        requests=log.requests,
        angles=angles,
        torque_on=(rows < 450) | (rows >= 500),
        measured=(rows < 100) | (rows >= 103),
        joint="knee",
    )


def loaded():
    """Under a load that changes its sign and is larger in the other direction."""
    joint = replace(AIBO, dead_band=0.035, compliance=0.05, speed_per_torque=0.6)
    load = 0.8 * np.sin(0.01 * np.arange(700)) - 0.3
    log = rich_log(joint, rows=700, amplitude=0.5, noise=NOISE / 4.0, load=load)
    return replace(log, load=load)


def jitter():
    """Times that are noted late or early by an eighth of a period."""
    log = rich_log(noise=NOISE, rows=500)
    times = np.sort(log.times + np.random.default_rng(0).normal(scale=1e-3, size=500))
    return replace(log, times=times + 1e-9 * np.arange(500))


def unequal():
    """Two logs of two clocks."""
    one = replace(rich_log(noise=NOISE), name="one")
    return [one, replace(one, times=1.2 * one.times, name="two")]


def contradictory():
    """Two logs with another zero."""
    one, two = (replace(rich_log(noise=NOISE, seed=k), name=("one", "two")[k]) for k in (0, 1))
    return [one, replace(two, angles=two.angles + 0.05)]


def turned():
    """An encoder that starts again after a turn."""
    log = rich_log(rows=500, noise=NOISE)
    angles = np.mod(log.angles + 3.1 + np.pi, 2.0 * np.pi) - np.pi
    return replace(log, requests=log.requests + 3.1, angles=angles)


def drifts():
    """A sensor that warms up, in rows with torque."""
    log = rich_log(noise=NOISE, rows=600)
    angles = log.angles + np.linspace(-0.05, 0.05, 600)
    return replace(log, angles=angles, torque_on=np.arange(600) >= 50)


def backlash():
    """Play in two logs, of which one shows it more clearly."""
    random, logs = np.random.default_rng(3), []
    for name, rows in (("one", 300), ("two", 400)):
        lengths = random.integers(10, 40, size=rows)
        requests = np.repeat(random.uniform(-0.6, 0.6, size=rows), lengths)[:rows]
        known = {"top": 4.0, "gain": 12.0, "delay": 0.0, "constant": 0.03, "friction": 0.0}
        angles = servo(requests, 0.02, **known, play=0.05)
        angles = measured(angles, random, noise=NOISE / 10.0, quantum=0.0)
        times = 0.02 * np.arange(rows)
        logs.append(planner.Log(times=times, requests=requests, angles=angles, name=name))
    return logs


def inverted(requests):
    """A log whose angles have the wrong sign."""
    log = noisy(requests, joint=JOINT)
    return replace(log, angles=-log.angles)


def late():
    """A sine of 100 ms that the joint follows half of that late, and 40 ms."""
    requests = 0.1 * np.sin(10.0 * np.pi * AIBO.period * np.arange(500))
    return noisy(requests, noise=0.0)


def unmoved(angles):
    """A log of other angles than those of its requests."""
    return replace(rich_log(), angles=angles)


def in_two_scales(factor):
    """Angles that are as many times too large; a sag by the angle explains most of one to two."""
    times = AIBO.period * np.arange(400)
    log = noisy(0.5 * np.sin(2.0 * times) + 0.3 * np.sign(np.sin(3.1 * times)), noise=0.0)
    return replace(log, angles=factor * log.angles)


def exchanged():
    """The columns of requested and actual angles."""
    log = rich_log(noise=NOISE)
    return replace(log, requests=log.angles, angles=log.requests)


def gentle_first():
    """Random requests, small ones and then large ones."""
    sizes = (0.04, 1.2)  # rad
    return np.concatenate([rich_log(seed=3, rows=300, amplitude=size).requests for size in sizes])


LOGS = {
    "worn": worn,
    "loaded": loaded,
    "gripper": lambda: replace(rich_log(amplitude=0.05, noise=NOISE / 10.0), unit="1", joint="jaw"),
    "turned": turned,
    "jitter": jitter,
    "unequal": unequal,
    "contradictory": contradictory,
    "slow rows": lambda: rich_log(AIBO.requested_every(0.1), rows=300, noise=NOISE),
    "gentle": lambda: rich_log(amplitude=0.05, noise=NOISE / 10.0),
    "gentle at first": lambda: noisy(gentle_first()),
    "one way": lambda: noisy(ONE_WAY, quantum=QUANTUM),
    "stopped below": lambda: mirrored(stopped()),
    "caught": caught,
    "rings": rings,
    "drifts": drifts,
    "asymmetric": lambda: rich_log(replace(AIBO, v_offset=0.8), noise=NOISE, rows=800),
    "shaken": lambda: replace(calm_and_shaken()[1], load=np.zeros(750)),
    "backlash": backlash,
    "sag": lambda: swung(replace(AIBO, dead_band=0.035, sag_sin=-0.03, sag_cos=0.02)),
}

TIMES = JOINT.period * np.arange(400)
WHITE = np.random.default_rng(0).normal(0.0, 0.01, 400)

ROUGH = {
    # A sine looks like one of the opposite sign half a cycle later.
    "inverted": (lambda: inverted(0.4 * np.sin(np.pi * TIMES)), ("sign",)),
    "inverted steps": (lambda: inverted(0.4 * np.sign(np.sin(4.0 * np.pi * TIMES))), ()),
    "inverted sweep": (lambda: inverted(0.4 * np.sin(TIMES**2)), ()),
    "late": (late, ("sign",)),
    "exchanged": (exchanged, ("columns",)),
    "a fifth": (lambda: in_two_scales(0.2), ("columns",)),
    "half as much again": (lambda: in_two_scales(1.5), ("columns",)),
    "hardly moves": (lambda: rich_log(amplitude=0.01, noise=NOISE), ("fit", "motion", "log")),
    "noise": (lambda: unmoved(WHITE), ()),
    "loud noise": (lambda: unmoved(30.0 * WHITE), ()),
    "noise in counts": (lambda: unmoved(np.round(WHITE / QUANTUM) * QUANTUM), ()),
    "contact": (on_the_table, ("log",)),
    "another motion": (lambda: unmoved(rich_log(seed=1).angles), ("motion",)),
}
"""Where which optimum is found may depend on the processor: logs, and topics that do not, or all.

Of a wrong sign, and of a log without motion, nothing is said that only follows from it.
"""


def numbers(values):
    """To three digits, one of which another processor may round otherwise."""
    return " ".join(f"{value:.3g}" for value in values)


def told(found):
    """What an identification says of its logs, in lines."""
    lines = [f"{found.verdict}: {found.reason}"]
    lines += [f"{each.topic}: {each.words}" for each in found.findings]
    for name, ends in found.intervals.items():
        lines.append(f"{name} {numbers([getattr(found.model, name), *ends])}")
    lines.append(f"gain {numbers([found.gain, *found.gain_interval])}, hold {found.model.hold}")
    for term in found.terms:
        assert not term.kept or term.interval == found.intervals[term.name]
        kept = "kept" if term.kept else "not kept"
        lines.append(f"{term.name} {kept} {numbers([term.rms_without, *term.interval])}")
    for each in found.alternatives:
        held_out = numbers([] if each.held_out_rms is None else [each.held_out_rms])
        known = numbers(each.parameters.values())
        lines.append(f"{each.name} {each.rms:.3g} held out {held_out} {known}")
    errors = found.rms, found.expected_error, found.noise, found.unexplained, found.signal
    lines.append(f"errors {numbers(errors)}")
    seen = found.tested
    lines.append(f"seen {numbers([found.fastest, found.heaviest, seen.speed, seen.load])}")
    lines.append(f"angles {numbers(seen.angles)}, delay {seen.delay_error:.2g}")
    pairs = (value for pair in seen.by_acceleration for value in pair)
    lines.append(f"errors by motion {numbers([*pairs, *seen.spread, seen.over_delay])}")
    lines.append(f"correlations {' '.join(f'{each[0]:.2f}' for each in found.correlations)}")
    for fit in found.fits:
        held_out = np.flatnonzero(fit.held_out)
        out = f"{held_out[0]} to {held_out[-1]}" if len(held_out) else "none"
        used = f"{fit.log.joint} {np.sum(fit.used)} used, {np.sum(fit.held_out)} held out: {out}"
        lines.append(f"{used}; rms {fit.rms:.3g}, weights {np.sum(fit.weights):.4g}")
        lines.append(f"left out: {fit.left_out}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", LOGS)
def test_an_answer_is_what_it_was(name, snapshot):
    snapshot.check(name.replace(" ", "_"), told(planner.identify(LOGS[name]())))


def test_what_speaks_against_a_log_is_what_it_was(snapshot):
    lines = []
    for name, (make, topics) in ROUGH.items():
        found = planner.identify(make(), hold_out=False)
        words = [each.words for each in found.findings if not topics or each.topic in topics]
        lines += [f"{name} {found.verdict}", *words]
    snapshot.check("rough", "\n".join(lines) + "\n")
