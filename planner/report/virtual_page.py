"""The report of the experiment on the virtual robot as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from planner.report.figures import Picture
from planner.report.page import experiment_page
from planner.report.virtual_tables import (
    ERRORS,
    dropped_words,
    promise_rows,
    signed_percent,
    table1_rows,
)

FEATURED = ("foot_paths", "joints_by_method")
"""The pictures after the key figures: the moving leg and its joints."""


def virtual_page(
    results: Mapping[str, Any], pictures: Sequence[Picture], files: Sequence[str]
) -> str:
    """The whole page.

    Args:
        results: The content of ``results.json``.
        pictures: The pictures, in order; drawn into the page.
        files: Files of the run to link to, relative to the page.
    """
    return experiment_page(
        "virtual.html",
        results,
        pictures,
        files,
        featured=FEATURED,
        table1=table1_rows(results),
        promises=promise_rows(results),
        errors=ERRORS,
        dropped=dropped_words(results),
        signed=signed_percent,
    )
