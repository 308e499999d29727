"""Replays: their pages, with a slider through the episode, their text and their JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from planner.arrays import Array, rms
from planner.model.evidence import OPEN_TOP_SPEED
from planner.recording.recorded_path import WHY
from planner.report import figure
from planner.report.figure import Axis, Curve, Figure, Panel, Span, Timeline, joined, line, rounded
from planner.report.page import Page, models_table
from planner.report.plan_results import Numbers, in_unit, motion_of, motions_table, sizes_of
from planner.report.wording import (
    CARRIED,
    UNITS,
    Unit,
    common,
    labelled,
    largest_of,
    phrase,
    rendered_text,
    words_of,
)

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.recording.recorded_path import JointModels
    from planner.recording.replaying import JointReplay, Kind, Replay
    from planner.recording.retiming import Fastest

MOST_ROWS = 500
"""Most rows of the table, for the recordings that are farthest off: a page of some 200 kB."""

KINDS = ("misfit", "resent", "rough")  # findings on a replay, blocks of findings.txt

AS_IT_IS = figure.DIRECT._replace(label="as it is")
"""The path itself as requests."""


def joint_numbers(joint: JointReplay) -> Numbers:
    """The numbers of a joint, degrees or percent of its range; without a plan fewer."""
    unit, plan = UNITS[joint.path.unit], joint.inversion
    numbers: Numbers = {
        "planned": False,
        "reason": joint.path.reason or None,
        "unit": unit.name,
        "recorded": sizes_of(joint.recorded_errors, unit.factor),
        "requests": (unit.factor * joint.requests).tolist(),
    }
    if plan is None:
        return numbers
    return numbers | {
        **{kind: sizes_of(errors, unit.factor) for kind, errors in joint.errors.items()},
        "best_shift_s": joint.shift.leads[0],
        "expected_on_robot_rms": unit.factor * joint.plan.expected[0].error,
        "norm": plan.norm,
        "lower_bound": unit.factor * joint.lower_bound,
        **motion_of(joint.plan, 0, unit.factor),
        "untested": list(joint.plan.expected[0].untested),
        "faster_than_the_joint_s": [list(span) for span in joint.too_fast],
        "desired": (unit.factor * joint.desired).tolist(),
        "predicted": (unit.factor * plan.predicted).tolist(),
    }


def replay_page(
    replay: Replay,
    *,
    title: str,
    models: JointModels,
    fastest: Fastest | None = None,
    arm: Leg | None = None,
    missed: Sequence[str] = (),
) -> Page:
    """The page about a replay, or the fastest; an ``arm``, whose joints are all recorded, moves."""
    units = {joint.name: UNITS[joint.path.unit] for joint in replay.planned}
    said = _spoken(replay, models, fastest)
    joints = {name: said["numbers"][name] for name in units}
    known = [name for name in joints if math.isfinite(joints[name]["expected_on_robot_rms"])]
    fast = {each.name: sum(b - a for a, b in each.too_fast) for each in replay.planned}
    return Page(
        "replay",
        **said,
        title=title,
        planned=joints,
        page=True,
        signs={name: unit.sign for name, unit in units.items()},
        most={
            kind: largest_of((each["unit"], each[kind]["max"]) for each in joints.values())
            for kind in ("planned", "direct", "resent")
        },
        good=not missed,
        missed=missed,
        fast={name: seconds for name, seconds in fast.items() if seconds},
        farthest=max(joints, key=lambda name: float(joints[name]["planned"]["rms"])),
        expected=max(known, key=lambda name: joints[name]["expected_on_robot_rms"], default=None),
        moving=moment_figure(replay) if arm is None else arm_figure(replay, arm),
        speeds=[] if fastest is None else speeds_figures(fastest),
        open_speeds=sorted(replay.path.open_top_speeds),
        pictures=[joint_figure(replay, j) for j in range(len(replay.joints))],
        parameters=models_table({each.name: each.plan.models[0] for each in replay.planned}, units),
    )


def replay_text(replay: Replay, models: JointModels, fastest: Fastest | None = None) -> str:
    """A replay for people: each joint's errors, rms, and how its requests move."""
    said = _spoken(replay, models, fastest)
    motions = [(label, each) for label, each in said["joints"] if each["planned"]]
    requests = motions_table(motions, said["unit"])
    return rendered_text("replay.txt", **said, page=False, requests=requests)


def _spoken(replay: Replay, models: JointModels, fastest: Fastest | None) -> dict[str, Any]:
    """What the sentences about a replay say."""
    fast = {each.name for each in replay.planned if each.too_fast}
    unit, labels = labelled({joint.name: UNITS[joint.path.unit] for joint in replay.joints})
    numbers = {joint.name: joint_numbers(joint) for joint in replay.joints}
    return {
        "replay": replay,
        "numbers": numbers,
        "joints": [(labels[name], each) for name, each in numbers.items()],
        "unit": unit,
        "models": models,
        "why": WHY[replay.path.track],
        "fastest": fastest,
        "allowed": _allowed(fastest) if fastest else (0.0, CARRIED["deg"]),
        "unknown": sorted(replay.path.open_top_speeds & fast),
        "open": OPEN_TOP_SPEED,
        "findings": findings(replay, models),
    }


def findings(replay: Replay, models: JointModels) -> dict[str, str]:
    """Models that do not fit the recording, better requests and rough ones: a line each, if any."""
    joints = [(each, UNITS[each.path.unit]) for each in replay.planned]
    said = {"joints": joints, "replay": replay, "models": models, "rms": rms}
    return {kind: words for kind in KINDS if (words := phrase("findings.txt", kind, **said))}


def told(found: Mapping[str, str], *remarks: str) -> dict[str, list[str]]:
    """Findings for machines after other remarks; models that do not fit are warnings."""
    others = dict(found)
    warned = [others.pop("misfit")] if "misfit" in others else []
    return {"warnings": warned, "remarks": [*remarks, *others.values()]}


def _allowed(fastest: Fastest) -> tuple[float, Unit]:
    """The tolerance of a search for the fastest replay, and its unit."""
    joints = (UNITS[joint.path.unit].name for joint in fastest.replay.planned)
    unit = common(["cm"] if fastest.foot else joints)
    return unit.factor * fastest.tolerance, unit


# The figures.


def moment_figure(replay: Replay) -> Figure:
    """The slider through the episode, with the numbers of its moment."""
    timeline, joints = Timeline(replay.period, len(replay.moments), cyclic=False), replay.joints
    stride, units, kinds = timeline.stride, [UNITS[each.path.unit] for each in joints], []
    for name, kind in (("path", "desired"), ("request", "requests"), ("predicted", "predicted")):
        arrays = zip((getattr(each, kind) for each in joints), units, strict=True)
        values = [None if a is None else rounded(a[::stride], unit.factor) for a, unit in arrays]
        kinds.append({"name": name, "values": values})
    pairs = zip(replay.names, units, strict=True)
    live = {
        "kind": "moment",
        "period": stride * timeline.period,
        "samples": len(range(0, timeline.samples, stride)),
        "joints": [{"name": name, "unit": unit.sign} for name, unit in pairs],
        "kinds": kinds,
    }
    return Figure("moment", *words_of("moment"), timeline.axis, live=live)


def arm_figure(replay: Replay, arm: Leg) -> Figure:
    """The moving arm: its path, with the path as requests, and planned."""
    joints = [replay.joints[replay.names.index(name)] for name in arm.joint_names]
    timeline = Timeline(replay.period, len(replay.moments), cyclic=False)

    def points(kind: Kind) -> Array:
        angles = [each.angles(kind) if each.inversion else each.recorded_angles for each in joints]
        return arm.joint_positions(np.column_stack(angles))

    desired = arm.joint_positions(np.column_stack([each.desired for each in joints]))
    others = ((AS_IT_IS, points("direct")), (figure.OPTIMAL, points("planned")))
    return timeline.leg("arm", words_of("arm"), desired, others)


def joint_figure(replay: Replay, j: int) -> Figure:
    """A joint: its angles and errors, where it is planned, and its requests."""
    timeline, joint = Timeline(replay.period, len(replay.moments), cyclic=False), replay.joints[j]
    unit = UNITS[joint.path.unit]
    desired = (joint.desired, figure.DESIRED._replace(label="path"))
    recorded = (joint.recorded_requests, figure.APPROXIMATION._replace(label="recorded requests"))
    planned, fast = list[tuple[Array, figure.Role]](), list[Span]()
    if joint.inversion is not None:
        planned = [(joint.angles("direct"), AS_IT_IS), (joint.angles("shifted"), figure.SHIFT)]
        planned.append((joint.angles("planned"), figure.OPTIMAL))
        fast = [
            Span(timeline.per_second * a, timeline.per_second * b, figure.DIRECT, 0.16)
            for a, b in joint.too_fast
        ]
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        words_of("replay_joint", joint=joint),
        unit=unit,
        angles=[desired, *planned] if planned else [],
        errors=[(angles - joint.desired, role) for angles, role in planned[1:]],
        requests=[desired, recorded, (joint.requests, figure.REQUESTED)],
        limits=replay.path.limits.get(joint.name) if planned else None,
        spans=tuple(fast),
    )


def speeds_figures(fastest: Fastest) -> list[Figure]:
    """Largest errors against the speed, with the tolerance; and the speed along the replay."""
    tolerance, unit = _allowed(fastest)
    speeds = np.array([each.speed for each in fastest.curve])
    looks = {"direct": AS_IT_IS, "shifted": figure.SHIFT, "planned": figure.OPTIMAL}
    curves = [
        Curve(role, speeds, tolerance * np.array([getattr(each, kind) for each in fastest.curve]))
        for kind, role in looks.items()
    ]
    bounds = tolerance * np.array([each.bound for each in fastest.curve])
    if np.isfinite(bounds).any():
        curves.append(Curve(figure.LOWER_BOUND, speeds, bounds))
    ends = (float(speeds[0]), float(speeds[-1]))
    finite = np.concatenate([curve.y[np.isfinite(curve.y)] for curve in curves[1:]])
    top = min(20.0 * tolerance, 1.05 * max(float(np.max(finite)), tolerance))
    curves = [
        replace(each, label=f"{each.role.label}, off the scale") if np.all(each.y > top) else each
        for each in curves
    ]
    curves.insert(0, line(ends, (tolerance, tolerance), figure.LIMIT))
    panel = Panel(Axis("largest error", unit.sign, (0.0, top)), curves, height=1.8)
    across = Axis("times the recorded speed", range=ends)
    errors = Figure("speeds", *words_of("speeds"), across, [panel])
    if fastest.retime != "varying":
        return [errors]
    timeline = Timeline(fastest.replay.period, len(fastest.replay.moments), cyclic=False)
    factors = np.append(fastest.factors, fastest.factors[-1:])
    curves = [
        timeline.curve(np.full(len(factors), fastest.constant), figure.LIMIT, "largest constant"),
        timeline.curve(factors, figure.OPTIMAL, "speed"),
    ]
    panel = Panel(Axis("times the recorded speed", from_zero=True), curves, height=1.8)
    return [errors, timeline.figure("factors", [panel], words_of("factors"), clock=True)]


# For machines.


def replay_results(replay: Replay, models: JointModels) -> dict[str, Any]:
    """A replay with ``models`` for machines, in degrees or percent; missing values are null."""
    joints = {}
    for joint in replay.joints:
        numbers = joint_numbers(joint)
        if joint.inversion is not None:
            numbers["recorded_requests_may_serve"] = joint in replay.resent_may_serve
            numbers["model_fits_recording"] = joint.fits
            numbers["top_speed_known"] = joint.name not in replay.path.open_top_speeds
        joints[joint.name] = in_unit(numbers, numbers["unit"])
    return {
        "recording": replay.path.name,
        "track": replay.path.track,
        "why": WHY[replay.path.track],
        "models": models.words,
        "speed": replay.speed,
        "period_s": replay.period,
        "requests": len(replay.moments),
        "recorded_s": replay.path.duration,
        "joints": joints,
        **told(findings(replay, models), *replay.path.remarks, *models.remarks),
    }


def fastest_results(fastest: Fastest) -> dict[str, Any]:
    """The fastest replay for machines; errors over speed are the largest, times the tolerance."""
    allowed, own = _allowed(fastest)
    unit = own.name
    impossible = fastest.impossible and {
        "speed": fastest.impossible.speed,
        "joint": fastest.impossible.joint,
        f"lower_bound_{unit}": allowed * fastest.impossible.bound,
        "of_model_only": fastest.impossible.of_model_only,
    }
    curve = []
    for each in fastest.curve:
        pairs = zip(each._fields[1:], each[1:], strict=True)
        errors = {f"{kind}_max_{unit}": allowed * ratio for kind, ratio in pairs}
        curve.append({"speed": each.speed, **errors})
    return {
        f"tolerance_{unit}": allowed,
        "retime": fastest.retime,
        "speed": fastest.speed,
        "constant_speed": fastest.constant,
        "least_factor": float(np.min(fastest.factors)),
        "largest_factor": float(np.max(fastest.factors)),
        f"largest_error_{unit}": allowed * fastest.largest,
        "impossible": impossible,
        "contradicted": list(fastest.contradicted),
        "errors_by_speed": curve,
    }


# Many recordings.


def episodes_page(document: Mapping[str, Any], *, title: str) -> Page:
    """The page about the document of ``replay --json`` for many recordings."""
    rows, failures = document["recordings"], document["left_out"]
    total = len(rows) + len(failures)
    sizes = [np.fmax(row["expected_on_robot_rms"] or 0.0, row["planned_rms"]) for row in rows]
    off = np.argsort(np.negative(sizes), kind="stable")[:MOST_ROWS]
    shown = [rows[place] | {"recording": _short(rows[place]["recording"])} for place in sorted(off)]
    units = sorted({row["unit"] for row in rows})
    worst = rows[off[0]]
    return Page(
        "episodes",
        **document,
        total=total,
        title=title,
        median={
            kind: float(np.median([row[f"{kind}_rms"] for row in rows]))
            for kind in ("direct", "shifted", "planned")
        },
        unit=common(units).sign,
        good=not failures,
        worst={
            **worst,
            "size": sizes[off[0]],
            "recording": _short(worst["recording"]),
            "sign": CARRIED[worst["unit"]].sign,
        },
        errors=[episodes_figure(rows, unit) for unit in units],
        shown=shown,
        rest=max(len(rows) - MOST_ROWS, 0),
        short=_short,
    )


def episodes_figure(rows: Sequence[Mapping[str, Any]], unit: str) -> Figure:
    """Errors against the number of the recording, in the order in which they were read."""
    own = [(place, row) for place, row in enumerate(rows, 1) if row["unit"] == unit]
    places = np.array([float(place) for place, _ in own])
    notes = tuple(f"{_short(row['recording'])}, {row['worst_joint']}" for _, row in own)

    def values(kind: str) -> Array:
        return np.array([np.nan if row[kind] is None else row[kind] for _, row in own])

    few = range(1, len(rows) + 1) if len(rows) <= 12 else ()  # more have round numbers on the axis
    numbers = {float(k): str(k) for k in few} or None
    looks = {
        "direct_rms": figure.DIRECT,
        "shifted_rms": figure.SHIFT,
        "planned_rms": figure.OPTIMAL,
    }
    curves = []
    for kind, role in looks.items():
        marks: Literal["rings", "dots"] = "rings" if role is figure.SHIFT else "dots"
        hidden = role is figure.DIRECT
        curves.append(Curve(role, places, values(kind), marks=marks, notes=notes, hidden=hidden))
    if np.isfinite(bounds := values("lower_bound")).any():
        ends = places[:, None] + np.array([-0.4, 0.4])
        heights = np.column_stack([bounds, bounds])
        curves.append(Curve(figure.LOWER_BOUND._replace(dashes="-"), joined(ends), joined(heights)))
    across = Axis("recording", "", (0.5, len(rows) + 0.5), names=numbers)
    panel = Panel(Axis("error, rms", CARRIED[unit].sign, from_zero=True), curves, height=2.2)
    return Figure(f"errors_{unit}", *words_of("episodes"), across, [panel])


def _short(recording: str) -> str:
    """A recording without the folders that it is in."""
    return PurePath(recording).name


def episodes_text(document: Mapping[str, Any], said: Sequence[str] = ()) -> str:
    """Many recordings for people, a line each about the worst joint; remarks that are not said."""
    return rendered_text("episodes.txt", **document, shown=document["recordings"], said=said)


def findings_of_many(found: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Findings by recording as one line of each kind, with their number and an example."""
    lines = dict[str, str]()
    for kind in KINDS:
        if of := [(name, each[kind]) for name, each in found.items() if kind in each]:
            example = f"{'for example ' * (len(of) > 1)}'{of[0][0]}': {of[0][1]}"
            lines[kind] = f"{len(of)} of {len(found)} recordings, {example}"
    return lines


def episode_results(replay: Replay, models: JointModels) -> dict[str, Any]:
    """The row of a recording in a table of many: the joint that will be farthest off."""
    every = [(joint_numbers(joint), joint) for joint in replay.planned]
    sizes = [np.fmax(each["expected_on_robot_rms"], each["planned"]["rms"]) for each, _ in every]
    numbers, worst = every[int(np.argmax(sizes))]
    found, fits = findings(replay, models), {each.fits for each in replay.planned} - {None}
    return {
        "recording": replay.path.name,
        "requests": len(replay.moments),
        "duration_s": (len(replay.moments) - 1) * replay.period,
        "speed": replay.speed,
        "worst_joint": worst.name,
        "unit": numbers["unit"],
        **{f"{kind}_rms": numbers[kind]["rms"] for kind in worst.errors},
        "expected_on_robot_rms": numbers["expected_on_robot_rms"],
        "lower_bound": numbers["lower_bound"],
        "recorded_requests_may_serve": bool(replay.resent_may_serve),  # of any joint
        "model_fits_recording": all(fits) if fits else None,  # of all joints that are judged
        "findings": found,
        **told(found, *replay.path.remarks),
    }
