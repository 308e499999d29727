"""Results of a calibration, for terminal and page: every method with its measured error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from planner.calibration.candidates import WORDS, Compared
from planner.report.identification.figures import cloud_figure
from planner.report.identification.text import next_step
from planner.report.page import Card, Page, Section, figures_section, heading
from planner.report.table import Column, Row, Table, number


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
    return f"{words} (best shift: {number(other)}){method}"


def calibration_text(comparisons: Mapping[str, Compared], output: str) -> str:
    """The last screen: the recommendation, the errors of every method, and the next step."""
    lines = [f"recommended, and written to {output}:"]
    lines += [f"  {recommendation(joint, each)}" for joint, each in comparisons.items()]
    step = next_step({joint: each.identification for joint, each in comparisons.items()}, output)
    return "\n".join([*lines, candidates_table(comparisons).text(), step])


def calibration_page(comparisons: Mapping[str, Compared], output: str) -> str:
    """The same as a page, with every joint's model beside its measurements."""
    joints = list(comparisons.items())
    gains = [each.named("shift").error / each.recommended.error for _, each in joints]
    errors = [math.degrees(each.recommended.error) for _, each in joints]
    lines = [recommendation(joint, each) for joint, each in joints]
    figures = []
    for k, (joint, each) in enumerate(joints, 1):
        figure = cloud_figure(each.identification, f"joint{k}_")
        figures.append(replace(figure, title=f"{joint}: {figure.title}"))
    step = next_step({joint: each.identification for joint, each in joints}, output)
    return Page(
        heading=heading(joints[0][0] if len(joints) == 1 else f"{len(joints)} joints")
        + ", calibrated",
        eyebrow="request-planner calibrate",
        verdict=lines[0]
        if len(lines) == 1
        else f"Under the recommended requests the errors are {_range(errors, '.2f')} deg rms, "
        f"{_range(gains, '.2g')} times less than those of the best shift.",
        sections=(
            Section(
                "Recommendation",
                "<ul>{% for line in lines %}<li>{{ line }}</li>{% endfor %}</ul><p>{{ step }}</p>",
                {"lines": lines, "step": step[:1].upper() + step[1:]},
            ),
            Section("Every way", WAYS, {"table": candidates_table(comparisons)}),
            figures_section("The joints", figures),
        ),
        footer="Errors are measured: every way was played on the servos.",
        good=all(each.identification.accepted for _, each in joints),
        cards=(
            Card(_range(gains, ".2g"), "×", "closer than the best shift"),
            Card(str(len(joints)), "", f"joint{'s' * (len(joints) > 1)}"),
        ),
    ).html()


WAYS = """
{{ table }}
<p class="note">The expected error is that of the plan and of its model together; a dash where
none was known.</p>
"""


def _range(values: Sequence[float], digits: str) -> str:
    """From the smallest to the largest, once where they are the same."""
    return "–".join(dict.fromkeys(f"{end:{digits}}" for end in (min(values), max(values))))
