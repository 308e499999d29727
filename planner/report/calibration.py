"""A calibration: what each way of moving a joint came to, and which is recommended."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from planner.report.identification_page import cloud_figure
from planner.report.identification_text import next_step
from planner.report.page import Page
from planner.report.table import Column, Row, Table, number
from planner.robot.candidates import WORDS, Compared


def candidates_table(comparisons: Mapping[str, Compared]) -> Table:
    """Every joint and every method, with its errors measured on the test motion."""
    rows = []
    for joint, compared in comparisons.items():
        for method in compared.candidates:
            mark = "\nrecommended" if method is compared.recommended else ""
            sizes = (method.error, method.max_error, method.expected, method.largest_step)
            error, *rest = (number(math.degrees(each)) for each in sizes)
            rows.append(Row(WORDS[method.way], (error + mark, *rest), subject=joint))
    columns = tuple(
        Column(title) for title in ("error, rms", "largest", "expected", "largest step")
    )
    return Table("on the test motion [deg]", columns, tuple(rows), apart=True)


def recommendation(joint: str, each: Compared) -> str:
    """The recommendation for a joint, in a line."""
    best, shift = each.recommended, each.named("shift")
    error, other = math.degrees(best.error), math.degrees(shift.error)
    words = f"{joint}: {WORDS[best.way]}, {number(error)} deg rms"
    if best.way == "shift":
        return f"{words}; plan with --method shift"
    if best.way == "direct":
        return f"{words}; send the path as it is"
    method = "; plan with --method closed-form" if best.way == "closed_form" else ""
    return f"{words} (best shift: {number(other)} deg){method}"


def calibration_text(comparisons: Mapping[str, Compared], output: str) -> str:
    """The last screen: the recommendation, the errors of every method, and the next step."""
    lines = [f"recommended, and written to {output}:"]
    lines += [f"  {recommendation(joint, each)}" for joint, each in comparisons.items()]
    step = next_step({joint: each.identification for joint, each in comparisons.items()}, output)
    return "\n".join([*lines, candidates_table(comparisons).text(), step])


def calibration_page(comparisons: Mapping[str, Compared], output: str) -> Page:
    """The same as a page, with every joint's model beside its measurements."""

    def spread(values: Sequence[float], digits: str) -> str:
        return "–".join(dict.fromkeys(f"{end:{digits}}" for end in (min(values), max(values))))

    joints = list(comparisons.items())
    gains = [each.named("shift").error / each.recommended.error for _, each in joints]
    errors = [math.degrees(each.recommended.error) for _, each in joints]
    figures = []
    for k, (joint, each) in enumerate(joints, 1):
        figure = cloud_figure(each.identification, f"joint{k}_")
        figures.append(replace(figure, title=f"{joint}: {figure.title}"))
    step = next_step({joint: each.identification for joint, each in joints}, output)
    return Page(
        "calibration",
        joint=joints[0][0],
        lines=[recommendation(joint, each) for joint, each in joints],
        good=all(each.identification.accepted for _, each in joints),
        errors=spread(errors, ".2f"),
        gains=spread(gains, ".2g"),
        step=re.split("(request-planner [^;]+)", step[:1].upper() + step[1:]),
        table=candidates_table(comparisons),
        pictures=figures,
    )
