"""The pages about a replay, with a slider through the episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.model.evidence import OPEN_TOP_SPEED
from planner.recording.recorded_path import WHY
from planner.report import figure, style
from planner.report.figure import Axis, Curve, Figure, Panel, Span, Timeline, line, rounded
from planner.report.page import Page, models_table
from planner.report.plan_results import motions_table, named
from planner.report.wording import (
    NOTHING,
    Column,
    Row,
    Table,
    number,
    phrase,
    rendered_text,
    thousandths,
    words_of,
)
from planner.trajectory import Array, Distance, size

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.recording.replaying import JointReplay, Replay
    from planner.recording.retiming import Fastest

LOG_UNITS = {"rad": ("deg", math.degrees(1.0)), "1": ("percent", 100.0)}
"""By a log's unit: the unit for people, and the factor to it."""

SIGNS = {"deg": "deg", "percent": "%"}
"""How a page writes these units."""

RESENT = (
    "the recorded requests may serve better than the plan, as they have moved the robot along this "
    "path: the error to expect of the plan is not clearly smaller than that of the requests as "
    "recorded"
)
"""A remark on replays at the recorded speed."""

AS_IT_IS = style.DIRECT._replace(label="as it is")
"""The path itself as requests."""


class JointSizes(NamedTuple):
    """The sizes of a joint's errors, in degrees or in percent of its range."""

    name: str
    label: str  # the name, with the unit where that is not degrees
    unit: str  # in names of results
    sign: str  # on pages
    factor: float  # from the unit of its log
    errors: dict[str, Distance]  # by kind of requests, and "recorded", of the recorded run
    expected: float  # of the plan, to expect on the robot, rms; NaN where unknown
    bound: float  # lower bound on the rms error of any requests; NaN where there is none


def sizes_of(joint: JointReplay) -> JointSizes:
    """The sizes of the errors of a joint; of one without a plan those of the recorded run alone."""
    (unit, factor), planned = LOG_UNITS[joint.path.unit], joint.inversion is not None
    errors = {"recorded": joint.recorded_errors, **(joint.errors if planned else {})}
    return JointSizes(
        name=joint.name,
        label=joint.name if unit == "deg" else f"{joint.name} [% of its range]",
        unit=unit,
        sign=SIGNS[unit],
        factor=factor,
        errors={kind: size(each, factor) for kind, each in errors.items()},
        expected=factor * joint.plan.expected[0].error if planned else math.nan,
        bound=factor * joint.lower_bound if planned else math.nan,
    )


def replay_page(
    replay: Replay,
    *,
    title: str,
    models: str,
    fastest: Fastest | None = None,
    arm: Leg | None = None,
    missed: Sequence[str] = (),
    remarks: Sequence[str] = (),
) -> Page:
    """The page about a replay, and about the search for the fastest one.

    ``models`` is their origin; an ``arm``, whose joints are all recorded, moves on the page.
    ``missed`` are the tolerances that it misses.
    """
    there = [joint.path.unit for joint in replay.planned]
    units = {"rad": "degrees", "1": "% of the range"}
    joints, names = [*map(sizes_of, replay.planned)], [each.name for each in replay.planned]
    known = [each for each in joints if math.isfinite(each.expected)]
    fast = {each.name: sum(b - a for a, b in each.too_fast) for each in replay.planned}
    proof, spoken = fastest and fastest.impossible, _spoken(replay, models, fastest)
    return Page(
        "replay",
        replay=replay,
        title=title,
        several=len(joints) > 1,
        unit=" or ".join(words for each, words in units.items() if each in there),
        most={
            kind: max(each.errors[kind].max for each in joints)
            for kind in ("planned", "direct", "resent")
        },
        first_line=phrase("replay.txt", "line", **spoken),
        good=not missed,
        fastest=fastest and phrase("replay.txt", "fastest", **spoken),
        missed=missed,
        fast={name: seconds for name, seconds in fast.items() if seconds},
        unknown=spoken["unknown"],
        said=proof and proof.of_model_only,
        open=OPEN_TOP_SPEED,
        untested=fastest is None and replay.untested,
        unplanned=[each for each in replay.joints if each.inversion is None],
        resent=spoken["resent"] and phrase("replay.txt", "resent", **spoken),
        remarks=remarks,
        farthest=max(joints, key=lambda each: each.errors["planned"].rms),
        expected=max(known, key=lambda each: each.expected, default=None),
        moving=moment_figure(replay) if arm is None else arm_figure(replay, arm),
        speeds=[] if fastest is None else speeds_figures(fastest),
        of_foot=fastest is not None and fastest.foot,
        open_speeds=sorted(replay.path.open_top_speeds),
        joints=joints_table(replay),
        pictures=[joint_figure(replay, j) for j in range(len(replay.joints))],
        models=models_table(names, [each.plan.models[0] for each in replay.planned]),
    )


# The text.


def replay_text(replay: Replay, models: str, fastest: Fastest | None = None) -> str:
    """A replay for people: each joint's errors, rms, and how its requests move."""
    planned = [*map(sizes_of, replay.planned)]
    labels, factors = [each.label for each in planned], [each.factor for each in planned]
    motions = [each.plan.motions[0] for each in replay.planned]
    return rendered_text(
        "replay.txt",
        **_spoken(replay, models, fastest),
        joints=joints_table(replay, "rms [deg]"),
        requests=motions_table(labels, motions, factors),
    )


def _spoken(replay: Replay, models: str, fastest: Fastest | None) -> dict[str, Any]:
    """What the sentences about a replay say."""
    fast = {each.name for each in replay.planned if each.too_fast}
    return {
        "replay": replay,
        "models": models,
        "why": WHY[replay.path.track],
        "fastest": fastest,
        "allowed": _allowed(fastest)[0] if fastest else 0.0,
        "unknown": sorted(replay.path.open_top_speeds & fast),
        "open": OPEN_TOP_SPEED,
        "better": RESENT,
        "resent": [*map(sizes_of, replay.resent_may_serve)],
    }


def _allowed(fastest: Fastest) -> tuple[float, str]:
    """The tolerance of a search for the fastest replay, and its unit."""
    if fastest.foot:
        return 100.0 * fastest.tolerance, "cm"
    return math.degrees(fastest.tolerance), "deg"


def joints_table(replay: Replay, about: str = "joint [deg]") -> Table:
    """Errors of every joint by kind of requests; a terminal shows the root mean squares."""
    norms, rows = ("rms", "max"), list[Row]()
    columns = (
        *(Column(title, norms) for title in ("recorded run", "requests as recorded")),
        Column("path as it is", norms),
        Column("best shift", (*norms, "by [ms]"), joined="{0} ({2} ms)"),
        Column("plan", norms),
        *map(Column, ("on the robot", "lower bound")),
        Column("faster than the joint", words=True),
    )
    for joint in replay.joints:
        sizes, fast = sizes_of(joint), "nowhere"
        pairs = {kind: thousandths(error) for kind, error in sizes.errors.items()}
        cells: list[str | tuple[str, ...]] = [pairs["recorded"]]
        if joint.inversion is None:
            cells += [(NOTHING,) * len(column.parts) or NOTHING for column in columns[1:-1]]
            cells.append(f"{joint.path.reason}: recorded requests, re-timed")
        else:
            if spans := joint.too_fast:
                widest = max(spans, key=lambda span: span[1] - span[0])
                fast = f"{widest[0]:.2f} to {widest[1]:.2f} s"
                if len(spans) > 1:
                    total = sum(last - first for first, last in spans)
                    fast = f"{total:.2g} s in {len(spans)} parts, such as {fast}"
            cells += [pairs["resent"], pairs["direct"]]
            cells += [(*pairs["shifted"], f"{1e3 * joint.lead:.0f}"), pairs["planned"]]
            cells += [number(sizes.expected, 3), number(sizes.bound, 3), fast]
        rows.append(Row(sizes.label, cells))
    return Table(about, columns, rows, "Joints")


# The figures.


def moment_figure(replay: Replay) -> Figure:
    """The slider through the episode, with the numbers of its moment."""
    timeline, joints = Timeline(replay.period, len(replay.moments), cyclic=False), replay.joints
    stride, units = timeline.stride, [LOG_UNITS[each.path.unit] for each in joints]
    kinds = []
    for name, kind in (("path", "desired"), ("request", "requests"), ("predicted", "predicted")):
        arrays = ((getattr(each, kind), unit) for each, unit in zip(joints, units, strict=True))
        values = [None if a is None else rounded(a[::stride], by) for a, (_, by) in arrays]
        kinds.append({"name": name, "values": values})
    pairs = zip(joints, units, strict=True)
    live = {
        "kind": "moment",
        "period": stride * timeline.period,
        "samples": len(range(0, timeline.samples, stride)),
        "joints": [{"name": each.name, "unit": SIGNS[unit]} for each, (unit, _) in pairs],
        "kinds": kinds,
    }
    return Figure("moment", *words_of("moment"), timeline.axis, live=live)


def arm_figure(replay: Replay, arm: Leg) -> Figure:
    """The moving arm: its path, with the path as requests, and planned."""
    by_name = {each.name: each for each in replay.joints}
    joints = [by_name[name] for name in arm.joint_names]
    timeline = Timeline(replay.period, len(replay.moments), cyclic=False)

    def points(kind: str, unplanned: str = "recorded_angles") -> Array:
        kinds = [unplanned if each.inversion is None else kind for each in joints]
        angles = [getattr(*each) for each in zip(joints, kinds, strict=True)]
        return arm.joint_positions(np.column_stack(angles))

    others = ((AS_IT_IS, points("direct")), (style.OPTIMAL, points("predicted")))
    return timeline.leg("arm", words_of("arm"), points("desired", "desired"), others)


def joint_figure(replay: Replay, j: int) -> Figure:
    """A joint: its angles and errors, where it is planned, and its requests."""
    timeline, joint = Timeline(replay.period, len(replay.moments), cyclic=False), replay.joints[j]
    unit, factor = LOG_UNITS[joint.path.unit]
    desired = (joint.desired, style.DESIRED._replace(label="path"))
    recorded = (joint.recorded_requests, style.APPROXIMATION._replace(label="recorded requests"))
    planned, fast = list[tuple[Array, style.Role]](), list[Span]()
    if joint.inversion is not None:
        assert joint.predicted is not None, "a planned joint is simulated"
        planned = [(joint.direct, AS_IT_IS), (joint.shifted, style.SHIFT)]
        planned.append((joint.predicted, style.OPTIMAL))
        fast = [
            Span(timeline.per_second * a, timeline.per_second * b, style.DIRECT, 0.16)
            for a, b in joint.too_fast
        ]
    return figure.joint_figure(
        timeline,
        f"joint_{j}",
        words_of("replay_joint", joint=joint),
        unit=(SIGNS[unit], factor),
        angles=[desired, *planned] if planned else [],
        errors=[(angles - joint.desired, role) for angles, role in planned[1:]],
        requests=[desired, recorded, (joint.requests, style.REQUESTED)],
        limits=replay.path.limits.get(joint.name) if planned else None,
        spans=tuple(fast),
    )


def speeds_figures(fastest: Fastest) -> list[Figure]:
    """Largest errors against the speed, with the tolerance; and the speed along the replay."""
    tolerance, unit = _allowed(fastest)
    speeds = np.array([each.speed for each in fastest.curve])
    looks = {"direct": AS_IT_IS, "shifted": style.SHIFT, "planned": style.OPTIMAL}
    curves = [
        Curve(role, speeds, tolerance * np.array([getattr(each, kind) for each in fastest.curve]))
        for kind, role in looks.items()
    ]
    bounds = tolerance * np.array([each.bound for each in fastest.curve])
    if np.isfinite(bounds).any():
        curves.append(Curve(style.LOWER_BOUND, speeds, bounds))
    ends = (float(speeds[0]), float(speeds[-1]))
    finite = np.concatenate([curve.y[np.isfinite(curve.y)] for curve in curves[1:]])
    top = min(20.0 * tolerance, 1.05 * max(float(np.max(finite)), tolerance))
    curves = [
        replace(each, label=f"{each.role.label}, off the scale") if np.all(each.y > top) else each
        for each in curves
    ]
    curves.insert(0, line(ends, (tolerance, tolerance), style.LIMIT))
    panel = Panel(Axis("largest error", unit, (0.0, top)), curves, height=1.8)
    across = Axis("times the recorded speed", range=ends)
    errors = Figure("speeds", *words_of("speeds"), across, [panel])
    if fastest.retime != "varying":
        return [errors]
    timeline = Timeline(fastest.replay.period, len(fastest.replay.moments), cyclic=False)
    factors = np.append(fastest.factors, fastest.factors[-1:])
    curves = [
        timeline.curve(np.full(len(factors), fastest.constant), style.LIMIT, "largest constant"),
        timeline.curve(factors, style.OPTIMAL, "speed"),
    ]
    panel = Panel(Axis("times the recorded speed", from_zero=True), curves, height=1.8)
    return [errors, timeline.figure("factors", [panel], words_of("factors"), clock=True)]


# For machines.


def replay_results(replay: Replay, models: str, remarks: Sequence[str]) -> dict[str, Any]:
    """A replay with ``models`` for machines, in degrees or percent; missing values are null."""
    joints = {}
    for joint in replay.joints:
        sizes, plan = sizes_of(joint), joint.inversion
        unit, factor = sizes.unit, sizes.factor
        errors = {kind: named(each, unit) for kind, each in sizes.errors.items()}
        entry: dict[str, Any] = {
            "planned": plan is not None,
            "reason": joint.path.reason or None,
            "unit": unit,
            "recorded": errors.pop("recorded"),
            f"requests_{unit}": (factor * joint.requests).tolist(),
        }
        if plan is not None:
            assert joint.predicted is not None, "a planned joint is simulated"
            entry |= {
                **errors,
                "best_shift_s": joint.lead,
                f"expected_on_robot_rms_{unit}": sizes.expected,
                "norm": plan.norm,
                f"lower_bound_{unit}": sizes.bound,
                f"largest_step_{unit}": factor * plan.largest_step,
                "recorded_requests_may_serve": joint in replay.resent_may_serve,
                "untested": list(joint.plan.expected[0].untested),
                "top_speed_known": joint.name not in replay.path.open_top_speeds,
                "faster_than_the_joint_s": [list(span) for span in joint.too_fast],
                f"desired_{unit}": (factor * joint.desired).tolist(),
                f"predicted_{unit}": (factor * joint.predicted).tolist(),
            }
        joints[joint.name] = entry
    return {
        "recording": replay.path.name,
        "track": replay.path.track,
        "why": WHY[replay.path.track],
        "models": models,
        "speed": replay.speed,
        "period_s": replay.period,
        "requests": len(replay.moments),
        "recorded_s": replay.path.duration,
        "joints": joints,
        "remarks": [*replay.path.remarks, *remarks],
    }


def fastest_results(fastest: Fastest) -> dict[str, Any]:
    """The fastest replay for machines; errors over speed are the largest, times the tolerance."""
    allowed, unit = _allowed(fastest)
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
