"""From logs to a joint model, with intervals, warnings and a verdict."""

from __future__ import annotations

from typing import Any

from planner.exceptions import SolverFailed
from planner.identification.identification import Identification
from planner.identification.log import as_logs


def identify(
    logs: Any, *, tick: float | None = None, hold: int | None = None, hold_out: bool = True
) -> Identification:
    """The joint model that explains the logs best.

    Args:
        logs: One or several logs of the same joint, see :func:`planner.identification.log.as_logs`.
        tick: Time step of the model [s]; by default chosen from the log's period.
        hold: Ticks for which a request is held; by default chosen from the log's period.
        hold_out: Whether to fit the first part of each log alone too, and test it on the rest.

    Returns:
        The model with what is needed to judge it.

    Raises:
        InvalidInput: The logs hold no motion to learn from, or tick and hold contradict the log.
    """
    raise SolverFailed("identification", f"not fitted: {len(as_logs(logs))} logs, {tick}, {hold}")
