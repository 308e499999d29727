"""A calibration: what each way of moving a joint came to, and which is recommended."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from planner.report import figure
from planner.report.figure import Axis, Curve, Figure, Panel, Timeline
from planner.report.identification_page import cloud_figure
from planner.report.identification_text import explained, joints_table, next_step, parameters
from planner.report.page import Page
from planner.report.wording import UNITS, Unit, phrase, table, words_of
from planner.robot.arm import SETTINGS, Servo
from planner.robot.calibration import WORDS, Check, Compared, Recheck, Way

ROLES: Mapping[Way, figure.Role] = {
    "direct": figure.DIRECT,
    "shift": figure.SHIFT._replace(label=WORDS["shift"]),
    "closed_form": figure.CLOSED_FORM,
    "optimal": figure.OPTIMAL,
    "optimal_friction": figure.FOOT_OPTIMAL._replace(label=WORDS["optimal_friction"], width=1.6),
}
"""Looks of every way."""


def servos_text(check: Check, period: float) -> str:
    """The state of the servos before they move, of requests every ``period`` [s]."""
    return phrase("calibration.txt", "servos", check=check, period=period, settings=SETTINGS)


def calibration_results(
    results: Mapping[str, Compared], servos: Mapping[str, Servo], tick_time: float
) -> dict[str, Any]:
    """A calibration for machines; ``tick_time`` is that of a sync write and a sync read [s]."""
    return {
        "tick_s": tick_time,
        "joints": {
            name: {
                "id": servos[name].id,
                "limits_deg": [math.degrees(limit) for limit in servos[name].limits],
                "recommended": result.recommended.way,
                "candidates": {
                    candidate.way: {
                        "rms_deg": math.degrees(candidate.error),
                        "max_deg": math.degrees(candidate.max_error),
                        "largest_step_deg": math.degrees(candidate.largest_step),
                        "expected_rms_deg": math.degrees(candidate.expected),
                    }
                    for candidate in result.candidates
                },
                "identification": result.identification.to_dict(),
            }
            for name, result in results.items()
        },
    }


def recheck_answer(
    joint: str,
    result: Recheck,
    before: Mapping[str, int],
    now: Mapping[str, int],
    unit: Unit = UNITS["rad"],
) -> tuple[dict[str, Any], str]:
    """Whether a model still holds, for machines and people, with the registers that changed."""
    estimates = [] if result.anew is None else parameters(result.anew)
    own = {"joint": joint, "of": result, "before": before, "now": now, "estimates": estimates}
    own |= {"unit": unit}
    changes = phrase("calibration.txt", "changes", **own, settings=SETTINGS).splitlines()
    document = {
        "holds": result.holds,
        f"rms_{unit.name}": unit.factor * result.error,
        f"expected_rms_{unit.name}": unit.factor * result.expected,
        f"allowed_rms_{unit.name}": unit.factor * result.most,
        "changes": changes,
    }
    return document, "; ".join([phrase("calibration.txt", "recheck", **own), *changes])


def recommendation(joint: str, each: Compared) -> str:
    """The recommendation for a joint, in a line."""
    return phrase("calibration.txt", "recommendation", joint=joint, of=each, words=WORDS)


def calibration_text(comparisons: Mapping[str, Compared], output: str) -> str:
    """The last screen: the recommendation, the errors of every method, and the next step."""
    lines = [f"recommended, and written to {output}:"]
    lines += [f"  {recommendation(joint, each)}" for joint, each in comparisons.items()]
    step = next_step({joint: each.identification for joint, each in comparisons.items()}, output)
    measured = table("candidates", joints=comparisons, ways_in_words=WORDS)
    return "\n".join([*lines, measured.text(), step])


def calibration_page(comparisons: Mapping[str, Compared], output: str) -> Page:
    """The same as a page: what every joint did, and every model beside its measurements."""
    joints = list(comparisons.items())
    found = {joint: each.identification for joint, each in joints}
    worst = max(comparisons, key=lambda joint: comparisons[joint].recommended.max_error)
    step = next_step(found, output)
    clouds = [cloud_figure(each, f"joint{k}_") for k, each in enumerate(found.values(), 1)]
    named = zip(found, clouds, strict=True)
    return Page(
        "calibration",
        joints=comparisons,
        lines=[recommendation(joint, each) for joint, each in joints],
        good=all(each.accepted for each in found.values()),
        gains=[each.named("shift").error / each.recommended.error for _, each in joints],
        worst=worst,
        largest=math.degrees(comparisons[worst].recommended.max_error),
        step=re.split("(request-planner [^;]+)", step[:1].upper() + step[1:]),
        ways=ways_figure(comparisons),
        ways_in_words=WORDS,
        motions=[motion_figure(*each, k) for k, each in enumerate(joints, 1)],
        models=joints_table(found, page=True),
        rare=explained(found),
        clouds=[replace(cloud, title=f"{joint}: {cloud.title}") for joint, cloud in named],
    )


def ways_figure(comparisons: Mapping[str, Compared]) -> Figure:
    """The measured error of every way, a row for each joint."""
    count, curves = len(comparisons), list[Curve]()
    places = np.arange(float(count))
    for way, role in ROLES.items():
        errors = [
            next((each.error for each in compared.candidates if each.way == way), math.nan)
            for compared in comparisons.values()
        ]
        curves.append(Curve(role, np.degrees(errors), places, marks="dots"))
    best = np.degrees([each.recommended.error for each in comparisons.values()])
    curves.append(Curve(figure.INK, best, places, "recommended", marks="rings"))
    top = 1.06 * float(np.nanmax(np.concatenate([curve.x for curve in curves])))
    joints = Axis("", range=(count - 0.5, -0.5), names=dict(enumerate(comparisons)))
    panel = Panel(joints, curves, height=0.6 + 0.25 * count)
    across = Axis("error, rms", "deg", (0.0, top), decimals=3)
    return Figure("ways", *words_of("ways"), across, [panel])


def motion_figure(joint: str, compared: Compared, number: int) -> Figure:
    """The test motion of a joint: what it did in every way, and its errors."""
    desired = compared.desired
    timeline = Timeline(compared.model.period, len(desired), cyclic=False)
    shown = (compared.recommended.way, "shift")
    drawn = [(each.angles, ROLES[each.way], each.way not in shown) for each in compared.candidates]
    return figure.joint_figure(
        timeline,
        f"motion_{number}",
        words_of("motion", name=joint, best=WORDS[compared.recommended.way]),
        angles=[(desired, figure.DESIRED), *drawn],
        errors=[(angles - desired, role, hidden) for angles, role, hidden in drawn],
        clock=False,
        title="measured",
    )
