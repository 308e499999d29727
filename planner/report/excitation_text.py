"""A test signal for a terminal: what it would tell about a joint, and how it is played."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from planner.identification.excitation import Excitation
from planner.identification.result import Identification
from planner.report.identification_parameters import Parameter, parameters
from planner.report.identification_text import SYMBOLS
from planner.report.text_table import text_table

WIDTH = 96
"""Of the lines [characters]."""


def excitation_text(made: Excitation, expected: Identification, *, model: str) -> str:
    """What a signal would determine first, then how, then in numbers.

    Args:
        made: The signal.
        expected: The identification of the expected joint from its answer.
        model: What the expected joint is called.
    """
    found = parameters(expected)
    heights = ", ".join(f"{math.degrees(height):.4g}" for height in made.amplitudes)
    rows = [
        [
            SYMBOLS[row.name],
            row.value,
            row.interval,
            "no" if not row.known else "roughly" if row.rough else "yes",
            row.judgement,
        ]
        for row in found
    ]
    seconds = len(made.requests) * made.period
    return "\n".join(
        [
            f"{made.kind.replace('_', ' ')} for {seconds:.4g} s: {_verdict(found)}",
            f"begins and ends at {math.degrees(made.centre):.4g} deg; the largest jump is "
            f"{math.degrees(made.largest_jump):.4g} deg"
            + (f"; step tests of {heights} deg" if heights else ""),
            *textwrap.wrap(made.meaning, WIDTH),
            f"expected of a joint like {model}:",
            text_table(["parameter", "identified", "95 % interval", "determined", "known"], rows),
            *(f"identify would warn: {warning}" for warning in expected.warnings),
        ]
    )


def _verdict(found: Sequence[Parameter]) -> str:
    missing = [SYMBOLS[row.name] for row in found if not row.known]
    rough = [SYMBOLS[row.name] for row in found if row.known and row.rough]
    told = [
        f"{how} {', '.join(names)}"
        for how, names in (("would not determine", missing), ("only roughly", rough))
        if names
    ]
    return "; ".join(told) if told else "would determine every parameter"
