"""The text and the page about replays of many recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any, Literal

import numpy as np

from planner.recording.replaying import Replay
from planner.report import style
from planner.report.figure import Axis, Curve, Figure, Panel, joined
from planner.report.page import Page
from planner.report.replay_page import RESENT, SIGNS, sizes_of
from planner.report.wording import NOTHING, Column, Row, Table, by_columns, number, words_of
from planner.trajectory import Array

MOST_ROWS = 500
"""Most rows of the table, for the recordings that are farthest off: a page of some 200 kB."""


KINDS = {
    "resent_rms": "as recorded",
    "direct_rms": "path as it is",
    "shifted_rms": "best shift",
    "planned_rms": "plan",
    "expected_on_robot_rms": "on the robot",
    "lower_bound": "lower bound",
}
"""Columns of the table, by their name in the document."""


def episodes_page(document: Mapping[str, Any], *, title: str) -> Page:
    """The page about the document of ``replay --json`` for many recordings."""
    rows, failures = document["recordings"], document["left_out"]
    total = len(rows) + len(failures)
    off = np.argsort([-row["planned_rms"] for row in rows], kind="stable")[:MOST_ROWS]
    shown = [rows[place] | {"recording": _short(rows[place]["recording"])} for place in sorted(off)]
    left_out = [Row(_short(name), (reason,)) for name, reason in failures.items()]
    if len(left_out) > 20:  # that is enough to read
        left_out[20:] = [Row(f"{len(left_out) - 20} more", (NOTHING,))]
    reasons = Table("recording", [Column("reason", words=True)], left_out, "Left out")
    units = sorted({row["unit"] for row in rows})
    worst = max(rows, key=lambda row: float(row["planned_rms"]))
    return Page(
        "episodes",
        total=total,
        title=title,
        rows=rows,
        median={
            kind: float(np.median([row[f"{kind}_rms"] for row in rows]))
            for kind in ("direct", "shifted", "planned")
        },
        unit=SIGNS[units[0]] if len(units) == 1 else "deg, or % of a range,",
        line=episodes_line(document),
        good=not failures,
        remarks=document["remarks"],
        worst={**worst, "recording": _short(worst["recording"]), "sign": SIGNS[worst["unit"]]},
        errors=[errors_figure(rows, unit) for unit in units],
        recordings=episodes_table(shown, fastest=document["speed"] is None),
        rest=max(len(rows) - MOST_ROWS, 0),
        left_out=reasons if failures else None,
    )


def episodes_table(rows: Sequence[Mapping[str, Any]], *, fastest: bool) -> Table:
    """Errors of recordings by kind of requests; with their speeds where these are the fastest."""
    columns = [
        ("requests", [f"{row['requests']}" for row in rows]),
        fastest and ("speed", [f"{row['speed']:.3g}" for row in rows]),
        ("worst joint", [f"{row['worst_joint']} [{row['unit']}]" for row in rows]),
        *((title, [number(row[kind], 3) for row in rows]) for kind, title in KINDS.items()),
    ]
    names = [str(row["recording"]) for row in rows]
    return by_columns("recording", names, columns, label="Recordings")


def errors_figure(rows: Sequence[Mapping[str, Any]], unit: str) -> Figure:
    """Errors against the number of the recording, in the order in which they were read."""
    own = [(place, row) for place, row in enumerate(rows, 1) if row["unit"] == unit]
    places = np.array([float(place) for place, _ in own])
    notes = tuple(f"{_short(row['recording'])}, {row['worst_joint']}" for _, row in own)

    def values(kind: str) -> Array:
        return np.array([np.nan if row[kind] is None else row[kind] for _, row in own])

    few = range(1, len(rows) + 1) if len(rows) <= 12 else ()  # more have round numbers on the axis
    numbers = {float(k): str(k) for k in few} or None
    looks = {"direct_rms": style.DIRECT, "shifted_rms": style.SHIFT, "planned_rms": style.OPTIMAL}
    curves = []
    for kind, role in looks.items():
        marks: Literal["rings", "dots"] = "rings" if role is style.SHIFT else "dots"
        hidden = role is style.DIRECT
        curves.append(Curve(role, places, values(kind), marks=marks, notes=notes, hidden=hidden))
    if np.isfinite(bounds := values("lower_bound")).any():
        ends = places[:, None] + np.array([-0.4, 0.4])
        heights = np.column_stack([bounds, bounds])
        curves.append(Curve(style.LOWER_BOUND._replace(dashes="-"), joined(ends), joined(heights)))
    across = Axis("recording", "", (0.5, len(rows) + 0.5), names=numbers)
    panel = Panel(Axis("error, rms", SIGNS[unit], from_zero=True), curves, height=2.2)
    return Figure(f"errors_{unit}", *words_of("episodes"), across, [panel])


def _short(recording: str) -> str:
    """A recording without the folders that it is in."""
    return PurePath(recording).name


def episodes_line(document: Mapping[str, Any]) -> str:
    """One line about the replay: track, number of recordings, speed and models."""
    rows, speed = document["recordings"], document["speed"]
    requests = sum(row["requests"] for row in rows)
    how = "as fast as the tolerance allows" if speed is None else f"at {speed:.4g} times the speed"
    return (
        f"follows {document['why']}; {len(rows)} recordings, {requests} requests {how}; "
        f"{document['models']}"
    )


def episodes_text(document: Mapping[str, Any]) -> str:
    """Many recordings for people: a line each, about the joint with the largest planned error."""
    table = episodes_table(document["recordings"], fastest=document["speed"] is None)
    words = resent_words(document["recordings"])
    return "\n".join([episodes_line(document), table.text(), *words])


def resent_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The number of recordings whose own requests may be better, with the errors of one example."""
    of = [row for row in rows if row["recorded_requests_may_serve"]]
    if not of:
        return []
    first = of[0]
    errors = f"{first['expected_on_robot_rms']:.3f} and {first['resent_rms']:.3f} {first['unit']}"
    where = f"such as {errors} rms in {first['recording']}"
    return [f"in {len(of)} of {len(rows)} recordings {RESENT}, {where}"]


def episode_results(replay: Replay) -> dict[str, Any]:
    """The row of a recording in a table of many: the joint with the largest error of its plan."""
    each = [(sizes_of(joint), joint) for joint in replay.planned]
    sizes, worst = max(each, key=lambda pair: pair[0].errors["planned"].rms)
    return {
        "recording": replay.path.name,
        "requests": len(replay.moments),
        "duration_s": (len(replay.moments) - 1) * replay.period,
        "speed": replay.speed,
        "worst_joint": worst.name,
        "unit": sizes.unit,
        **{f"{kind}_rms": sizes.errors[kind].rms for kind in worst.errors},
        "expected_on_robot_rms": sizes.expected,
        "lower_bound": sizes.bound,
        "recorded_requests_may_serve": worst in replay.resent_may_serve,
        "remarks": list(replay.path.remarks),
    }
