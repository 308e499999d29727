"""The page about a sweep: the Pareto front of speed and error, and the points."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from planner.arrays import finite
from planner.evaluation.pareto_front import Outcome, Swept
from planner.report.figure import (
    DIRECT,
    FOOT_OPTIMAL,
    INK,
    LIMIT,
    OPTIMAL,
    Axis,
    Curve,
    Figure,
    Panel,
    Role,
)
from planner.report.page import Page
from planner.report.wording import CARRIED, phrase, rendered_text, words_of

WORDS = {
    "length": ("half stroke", "m"),
    "height": ("height", "m"),
    "forward": ("forward", "m"),
    "sideways": ("sideways", "m"),
    "hip_height": ("hip height", "m"),
    "ground_fraction": ("part on the ground", ""),
    "heading_deg": ("heading", "deg"),
    "period_s": ("period", "s"),
    "speed": ("speed", "×"),
    "smoothness": ("smoothness", ""),
}
"""Name and unit of each parameter."""


def sweep_page(swept: Swept) -> Page:
    """The whole page."""
    return Page(
        "sweep",
        swept=swept,
        good=not missed(swept),
        verdict=verdict(swept),
        commands=[(each.number, command(swept, each)) for each in swept.front],
        figure=front_figure(swept) if swept.front else None,
        of_point=WORDS,
        parameters_of=partial(parameters, swept),
    )


def sweep_results(swept: Swept) -> list[dict[str, Any]]:
    """The columns of every point; values that a point without a plan lacks are None."""
    unit, front, rows = swept.error_unit, {each.number for each in swept.front}, []
    for each in swept.outcomes:
        reason, required = each.reason, swept.requirement
        if not reason and required is not None and not required.is_met_by(each):
            reason = f"{required.of} {'below' if required.of == 'speed' else 'above'} "
            reason += f"{required.value:g}"
            if required.of == "error" and each.slowest:
                fast = f"its top speed on {100.0 * each.too_fast:.0f} % of the path"
                reason += f"; {each.slowest} would have to exceed {fast}"
        numbers = {
            "speed_cm_s" if swept.speed_unit == "cm/s" else "speed_factor": each.speed,
            f"error_{unit}": each.error,
            f"largest_error_{unit}": each.largest,
            f"direct_error_{unit}": each.direct,
            "too_fast_percent": 100.0 * each.too_fast,
        }
        rows.append(
            {
                "point": each.number,
                **dict(zip(swept.names, each.point, strict=True)),
                **{name: finite(value) for name, value in numbers.items()},
                "slowest_joint": each.slowest or None,
                "unreachable_samples": each.unreachable,
                "on_front": each.number in front,
                "reason": reason or None,
            }
        )
    return rows


def sweep_text(swept: Swept) -> str:
    """The sweep for people: the verdict, the front, and the first ten reasons for no plan."""
    again = command(swept, swept.best or swept.front[-1]) if swept.front else ""
    words = parameters(swept, swept.best) if swept.best else ""
    return rendered_text("sweep.txt", swept=swept, parameters=words, of_point=WORDS, again=again)


def verdict(swept: Swept) -> str:
    """The answer in a few words."""
    words = parameters(swept, swept.best) if swept.best else ""
    return phrase("sweep.txt", "verdict", swept=swept, parameters=words)


def missed(swept: Swept) -> str:
    """Why the sweep failed, in words; empty where it did not."""
    failed = not swept.front or (swept.requirement is not None and swept.best is None)
    return verdict(swept) if failed else ""


def parameters(swept: Swept, outcome: Outcome) -> str:
    """The parameters of a point."""
    values = zip((WORDS[name] for name in swept.names), outcome.point, strict=True)
    return ", ".join(f"{name} {value:.4g} {unit}".rstrip() for (name, unit), value in values)


def command(swept: Swept, outcome: Outcome) -> str:
    """The command that plans a point again, with all files of a run."""
    values = zip(swept.names, outcome.point, strict=True)
    options = " ".join(f"--at {name}={value!r}" for name, value in values)
    return f"request-planner sweep {shlex.quote(swept.file)} {options} --out point-{outcome.number}"


def front_figure(swept: Swept) -> Figure:
    """Speed against error of every point, with the parameters under the pointer."""

    def curve(role: Role, outcomes: Sequence[Outcome], label: str, **more: Any) -> Curve:
        errors = [each.direct if role is DIRECT else each.error for each in outcomes]
        notes = tuple(f"{each.number}: {parameters(swept, each)}" for each in outcomes)
        speeds = np.array([each.speed for each in outcomes])
        return Curve(role, speeds, np.array(errors), label, notes=notes, **more)

    planned = [each for each in swept.outcomes if each.planned]
    low, high = (end(each.speed for each in planned) for end in (min, max))
    curves = [
        curve(DIRECT, planned, "without a plan", marks="dots", hidden=True),
        curve(OPTIMAL, planned, "planned", marks="dots"),
        curve(FOOT_OPTIMAL, swept.front, "Pareto front"),
        curve(FOOT_OPTIMAL, swept.front, "Pareto front", marks="rings"),
    ]
    if swept.requirement is not None:
        limit, every = np.full(2, swept.requirement.value), curves[1]
        ends = np.array([every.x.min(), every.x.max()]), limit
        if swept.requirement.of == "speed":
            ends = limit, np.array([0.0, every.y.max()])
        curves.insert(0, Curve(LIMIT._replace(label="required"), *ends))
    if swept.best is not None:
        curves.append(curve(INK, [swept.best], "best", marks="dots"))
    across = Axis("speed", swept.speed_unit, None if high > low else (0.9 * low, 1.1 * high))
    upward = Axis("error", CARRIED[swept.error_unit].sign, from_zero=True, decimals=3)
    return Figure("front", *words_of("front"), across, [Panel(upward, curves, height=2.4)])
