"""What was learnt from cycles, in numbers for machines and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.planning.plan import Plan
from planner.report.learning_page import Trials
from planner.report.table import number, text_table


def joint_results(plan: Plan, joint: int, unit: str) -> dict[str, Any]:
    """The next requests to a joint of a plan for machines, in "deg" or "percent"."""
    learnt = plan.task.disturbance
    return {
        f"requests_{unit}": np.degrees(plan.requests[:, joint]).tolist(),
        f"predicted_{unit}": np.degrees(plan.predicted[:, joint]).tolist(),
        f"learnt_{unit}": None if learnt is None else np.degrees(learnt[:, joint]).tolist(),
    }


def trials_results(trials: Trials) -> dict[str, Any]:
    """The trials of a joint, or of a foot, for machines."""
    return {
        "trials": len(trials.errors),
        f"errors_{trials.unit}": trials.errors.tolist(),
        f"predicted_{trials.unit}": trials.predicted,
        f"lower_bound_{trials.unit}": trials.bound,
        f"noise_{trials.unit}": trials.noise,
        "gain": trials.gain,
        "best_trial": trials.best + 1,
        "stopped": trials.stopped or None,
        "remarks": list(trials.remarks),
        "sensor_delay_ms": [1e3 * delay for delay in trials.delays],
    }


def trials_text(progress: Sequence[Trials]) -> str:
    """The trials of every joint, or of the foot, and remarks on them."""
    cells, lines = [], list[str]()
    for each in progress:
        errors = (each.errors[0], each.errors[-1], np.min(each.errors), each.predicted)
        bound, noise = number(each.bound, 3), f"{each.noise:.3f}"
        cells.append([f"{each.name} [{each.unit}]", *map("{:.3f}".format, errors), bound, noise])
        lines += [f"{each.name}: {text}" for text in each.remarks]
        if each.stopped:
            lines.append(f"{each.name}: learning has ended: {each.stopped}")
    titles = ["rms error", "first", "last", "best", "predicted next", "lower bound", "noise"]
    return "\n".join([text_table(titles, cells), *lines])
