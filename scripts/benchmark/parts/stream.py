"""Streams: compared with common practice, and the time of a tick."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import planner
from benchmark.parts import Options, friction, recordings
from benchmark.table import Table
from planner.arrays import Array, rms

AHEAD = 0.2  # preview of a stream [s]
LONGER = 0.3  # a longer preview, for comparison [s]
ALPHA = 0.25  # share of the new value in exponential smoothing, as users set it
CYCLES = 4  # cycles of the walk that are followed from rest
ROWS = 600
"""Rows of a recording that are followed, and those from which its joint is identified: 2,000."""

CYCLE = 0.7  # cycle of the paths on which ticks are timed [s]
JOINTS = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll")

COLUMNS = "direct | EMA | feed-forward | shift | stream | whole plan | stream over whole, %"

MODELLED = f"{COLUMNS} | with {1e3 * LONGER:g} ms, %"  # where the joint is its model
WALKED = f"{MODELLED} | with its cycle, %"  # where the path repeats, too
EXPLAINED = (
    f"Root mean square of the error, mrad, from rest, with {1e3 * AHEAD:g} ms known ahead. EMA: "
    f"exponential smoothing, alpha {ALPHA:g}. Feed-forward: first order, by the model's lag, half "
    "its acceleration time and theta_0 over v_max. Shift: earlier by the best number of periods. "
    "Whole plan: `invert_optimal` of the whole path at once. "
)


def measure(options: Options) -> list[Table]:
    """Times, and errors on the model, on the virtual servo and on recordings."""
    ticks = 1000 if options.instances > 3 else 100
    tables = [times(ticks), on_models(), on_changing_walks(), on_servo()]
    folder = recordings()
    return [*tables, *(on_recordings(folder) if folder else [])]


def earlier(path: Array, rows: int) -> Array:
    """The path so many rows early, its last row held; the first row holds the joint at rest."""
    moved = np.concatenate([path[rows:], np.repeat(path[-1:], rows)])
    moved[0] = path[0]
    return moved


def smoothed(path: Array) -> Array:
    """Exponential smoothing."""
    kept = path.copy()
    for k in range(1, len(path)):
        kept[k] = kept[k - 1] + ALPHA * (path[k] - kept[k - 1])
    return kept


def fed_forward(model: planner.JointModel, path: Array) -> Array:
    """The path plus its slope times the joint's delay."""
    delay = model.lag + model.acceleration_time / 2.0 + model.theta_0 / model.v_max
    return path + delay * np.gradient(path, model.period)


def streamed(
    model: planner.JointModel,
    path: Array,
    measured: Callable[[Array], Array] | None = None,
    ahead: float = AHEAD,
    cycle: int | None = None,
) -> Array:
    """The stream's requests; ``measured`` sends each and returns the next measured angle."""
    preview = round(ahead / model.period)
    stream, sent, angle = planner.Stream(model, preview=preview, cycle=cycle), [], None
    for k in range(len(path)):
        requests = stream.step(path[k : k + preview], angle)
        angle = measured(requests) if measured is not None else None
        sent.append(requests[0])
    return np.array(sent)


def row(
    model: planner.JointModel, path: Array, execute: Callable[[Array], Array]
) -> tuple[list[float], Array]:
    """Errors of methods without feedback [mrad], and the whole plan's requests."""
    whole = planner.invert_optimal(model, path, cyclic=False)
    most = round(0.4 / model.period)
    shifts = [rms(execute(earlier(path, rows)) - path) for rows in range(0, most, 1 + most // 13)]
    sent = path, smoothed(path), fed_forward(model, path)
    errors = [*(rms(execute(each) - path) for each in sent), min(shifts)]
    return [1e3 * each for each in errors], whole.requests


def compared(stream: float, whole: float, *others: float) -> list[float]:
    """Errors of a stream and of a whole plan [mrad], and those of streams over the latter [%]."""
    over = [100.0 * (each / whole - 1.0) if whole else np.nan for each in (stream, *others)]
    return [1e3 * stream, 1e3 * whole, *over]


def modelled(
    table: Table, name: str, model: planner.JointModel, path: Array, cycle: int | None = None
) -> None:
    """Add a joint that is its model, and where its path repeats, the gain of a stream by that."""

    def execute(requests: Array) -> Array:
        return planner.simulate(model, requests, cyclic=False, start=float(path[0]))

    errors, requests = row(model, path, execute)
    whole = rms(execute(requests) - path)
    settings = [{"ahead": AHEAD}, {"ahead": LONGER}, *([{"cycle": cycle}] if cycle else [])]
    stream, *others = (rms(execute(streamed(model, path, **each)) - path) for each in settings)
    table.add(name, *errors, *compared(stream, whole, *others))


def on_models() -> Table:
    """The reference walk, whose joints saturate, and slower ones, which they can follow."""
    note = EXPLAINED + f"With its cycle: {CYCLES} cycles, of which the stream expects the length. "
    table = Table("Streams, walks on the model", f"joint | {WALKED}", note=note)
    joint, walk = planner.JointModel.ers210a(), planner.reference_walk()
    for share in (1.0, 0.5, 0.25):
        for name, angles in zip(("rotator", "abductor", "knee"), walk.desired.T, strict=True):
            path = np.tile(angles[0] + share * (angles - angles[0]), CYCLES)
            modelled(table, f"{name}, stroke times {share:g}", joint, path, len(walk.desired))
    return table


def on_changing_walks() -> Table:
    """The reference walk at a speed that changes: the cost of expecting a cycle."""
    table = Table(
        "Streams, walks whose speed changes",
        "speed | stream | with a cycle | whole plan | stream over whole, % | with a cycle, %",
        note="Root mean square of the error of the reference walk's three joints, mrad, from "
        f"rest, with {1e3 * AHEAD:g} ms known ahead; five cycles at the speed of the walk. The "
        "stream with a cycle expects that of the reference walk.",
    )
    joint, walk = planner.JointModel.ers210a(), planner.reference_walk()
    count = len(walk.desired)
    at = np.arange(5 * count)
    middle = 2.5 * count
    speeds = {
        "constant": np.ones(len(at)),
        "constant, 10 % slower than expected": np.full(len(at), 0.9),
        "falls by 30 %": np.linspace(1.0, 0.7, len(at)),
        "rises by 30 %": np.linspace(1.0, 1.3, len(at)),
        "20 % more and less": 1.0 + 0.2 * np.sin(2.0 * np.pi * at / 300.0),
        "half of it at once": np.where(at < middle, 1.0, 0.5),
        "falls to 0 in 0.3 s": np.clip(1.0 - (at - middle) * joint.period / 0.3, 0.0, 1.0),
        "0 at once": np.where(at < middle, 1.0, 0.0),
    }
    for name, speed in speeds.items():
        row = np.cumsum(speed) - speed[0]
        path = np.transpose(
            [np.interp(row, np.arange(count), each, period=count) for each in walk.desired.T]
        )
        plans = [planner.invert_optimal(joint, each, cyclic=False) for each in path.T]
        whole = rms(np.array([plan.rms for plan in plans]))
        errors = []
        for cycle in (None, count):
            stream = planner.Stream([joint] * 3, preview=round(AHEAD / joint.period), cycle=cycle)
            sent = np.array([stream.step(path[k:]) for k in at])
            angles = [planner.simulate(joint, each, cyclic=False) for each in sent.T]
            errors.append(rms(np.transpose(angles) - path))
        over = [100.0 * (each / whole - 1.0) for each in errors]
        table.add(name, *(1e3 * each for each in (*errors, whole)), *over)
    return table


def on_servo() -> Table:
    """The virtual servo with a pendulum: friction and gravity, measured at every tick."""
    table = Table(
        "Streams on a virtual servo",
        f"motion | {COLUMNS}",
        note=EXPLAINED + "A simulated Feetech STS3215 with friction and a pendulum at 50 Hz; the "
        "model is fitted to one log of 74 s, without the load. The stream is given the measured "
        "angles, the others have no use for them.",
    )
    rig = friction.make_rig()
    log = replace(rig.log(friction.excitation()), load=None)
    model = planner.identify(log, hold_out=False).model.requested_every(friction.PERIOD)
    for name, (length, motion) in friction.MOTIONS.items():
        count = round(length / friction.PERIOD)
        path = np.tile(motion(friction.TURNS * np.arange(count) / count), 2)
        errors, whole = row(model, path, lambda each: rig.execute(each)[1])
        robot, angles = rig.robot(path[:1]), list[float]()

        def send(requests: Array, robot: Any = robot, angles: Any = angles) -> Array:
            angles.append(float(robot.play(requests[np.newaxis]).angles[0, 0]))
            return robot.sense()

        streamed(model, path, send)
        planned = rms(rig.execute(whole)[1] - path)
        table.add(name, *errors, *compared(rms(np.array(angles) - path), planned))
    return table


def on_recordings(folder: Path) -> list[Table]:
    """Recorded angles followed again, and recorded requests predicted from them."""
    followed = Table(
        "Streams, recorded angles of an SO-101 followed again",
        f"joint | {MODELLED}",
        note=EXPLAINED + f"{ROWS} rows of random way-points; the joints are models, identified "
        "from 2,000 rows of a pseudo-random binary sequence.",
    )
    predicted = Table(
        "Streams, recorded requests predicted from the measured path",
        "joint | raw | best shift | stream",
        note="Root mean square of recorded minus predicted requests, mrad: the measured path as "
        "it is, as early as is best, and the stream's requests for it. In a dead band requests "
        "cannot be told from angles.",
    )
    learnt = np.genfromtxt(folder / "so101" / "prbs_excitation.csv", delimiter=",", names=True)
    played = np.genfromtxt(folder / "so101" / "random_waypoints.csv", delimiter=",", names=True)
    for joint in JOINTS:
        part = slice(0, 2000)
        log = planner.Log(
            times=learnt["t_s"][part],
            requests=learnt[f"req_{joint}"][part],
            angles=learnt[f"act_{joint}"][part],
        )
        model = planner.identify(log, hold_out=False).model
        path, requests = played[f"act_{joint}"][-ROWS:], played[f"req_{joint}"][-ROWS:]
        modelled(followed, joint, model, path)
        shifts = [rms(earlier(path, rows) - requests) for rows in range(20)]
        row = shifts[0], min(shifts), rms(streamed(model, path) - requests)
        predicted.add(joint, *(1e3 * each for each in row))
    return [followed, predicted]


def times(ticks: int) -> Table:
    """Time of a tick by period: six joints that all differ, with measured angles and limits."""
    table = Table(
        "Streams, time of a tick",
        "period | rows | median, ms | 99th percentile, ms",
        note=f"Processor time. Six different joints, {ticks} ticks, with {1e3 * AHEAD:g} ms known "
        f"ahead, limits, max_step and measured angles; and a cycle of {CYCLE:g} s where one is "
        "expected.",
    )
    fast = ((period, 1, 0.0) for period in (0.002, 0.004, 0.008, 0.01))
    periods = (*fast, (0.02, 4, 0.02), (0.03, 1, 0.02))
    for (period, hold, band), repeats in product(periods, (False, True)):
        joint = {"theta_0": 0.2, "lag": 0.03, "acceleration_time": 0.05, "dead_band": band}
        joint |= {"tick": period / hold, "hold": hold}
        models = [planner.JointModel(v_max=5.0 + 0.1 * j, **joint) for j in range(6)]
        rows, cycle = round(AHEAD / period), round(CYCLE / period) if repeats else None
        stream = planner.Stream(models, preview=rows, limits=(-1.0, 1.0), max_step=0.3, cycle=cycle)
        clock = period * np.arange(ticks + rows)[:, np.newaxis]
        turns = clock / (cycle * period) if cycle else clock * (0.5 + 0.1 * np.arange(6))
        path = (0.3 if cycle else 0.5) * np.sin(2.0 * np.pi * turns + np.arange(6))
        used = []
        for k in range(ticks):
            began = time.process_time()
            stream.step(path[k : k + rows], path[k])
            used.append(1e3 * (time.process_time() - began))
        name = f"{1e3 * period:g} ms" + (f", {hold} ticks of the model" if hold > 1 else "")
        name += (", dry friction" if band else "") + (", with a cycle" if cycle else "")
        table.add(name, rows, *np.percentile(used, [50, 99]))
    return table
