"""``results.json``: every figure of the experiment beside the paper's own."""

from __future__ import annotations

import dataclasses
import math
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from planner._version import __version__
from planner.evaluation.metrics import Distance
from planner.evaluation.outcome import JointOutcome, PlannedWalk, Reproduction
from planner.evaluation.paper import SOURCE, Published, published, published_foot
from planner.evaluation.planned_walk import REFINE, RULE
from planner.report.paper_tables import COMPARISONS, METHODS

NOTE = (
    "The joint here is the paper's model with the parameters of its Table 1; "
    "the paper's figures were measured on a robot, over 20 steps of the walk."
)

LIBRARIES = ("numpy", "scipy", "casadi", "osqp", "cvxpy", "pin", "matplotlib", "plotly")


def results(reproduction: Reproduction) -> dict[str, Any]:
    """The document that ``reproduce`` writes and prints, in degrees, centimetres and seconds.

    Every distance is a pair of plain numbers with the paper's own beside it, or None where the
    paper has none: ``table2[joint]["Des,Dir"]["L2"]`` beside ``[...]["paper"]["L2"]``, and
    ``foot[method]["Linf"]`` beside ``[...]["paper"]["Linf"]``. Comparisons are spelt as the paper
    spells them, without parentheses and blanks; ``comparisons`` and ``methods`` say what each is.
    The paper's closed form stands beside both of ours: ``closed_form_plain`` (``Plain`` in Table 2)
    is its method, ``closed_form`` (``MB``) has its knots refined by simulating the joint.
    """
    return {
        "made_by": f"request-planner {__version__} reproduce",
        "note": NOTE,
        "source": SOURCE,
        "units": {
            "table2": "deg",
            "foot": "cm",
            "bounds": "deg",
            "foot_bound": "cm",
            "gap": "1",
            "limits": "deg",
            "seconds": "s",
        },
        "comparisons": dict(COMPARISONS),
        "methods": dict(METHODS),
        "table2": {
            joint: {
                comparison: distance_entry(distance, published(joint, comparison))
                for comparison, distance in comparisons.items()
            }
            for joint, comparisons in reproduction.table2.items()
        },
        "foot": {
            method: distance_entry(distance, published_foot(method))
            for method, distance in reproduction.foot_table.items()
        },
        "best_shift_samples": reproduction.shift.samples,
        "baseline_deviation": reproduction.baseline_deviation,
        "bounds": {joint.name: bound_entry(joint) for joint in reproduction.joints},
        "foot_bound": foot_bound_entry(reproduction),
        "limits": {joint.name: limits_entry(joint) for joint in reproduction.joints},
        "step_tests": {
            f"{amplitude:g}": {
                "lag_ticks": response.lag,
                "acceleration_ticks": response.acceleration,
                "v_max_deg_per_tick": math.degrees(response.v_max) * reproduction.model.period,
            }
            for amplitude, response in reproduction.steps.items()
        },
        "parameters": {
            "model": dataclasses.asdict(reproduction.model),
            "segments": reproduction.segments,
            "rule": RULE,
            "refine": dict(REFINE),
            "samples": len(reproduction.walk.desired),
            "clamped_samples": int((~reproduction.walk.reachable).sum()),
        },
        "versions": versions(),
        "seconds": {**reproduction.seconds, "total": sum(reproduction.seconds.values())},
    }


def versions(*more: str) -> dict[str, str]:
    """Versions of this project, of Python, and of the libraries whose numbers these are."""
    found = {"request-planner": __version__, "python": platform.python_version()}
    for library in (*LIBRARIES, *more):
        try:
            found[library] = version(library)
        except PackageNotFoundError:  # installed by other means than a package
            found[library] = "unknown"
    return found


def distance_entry(distance: Distance, published: Published | None) -> dict[str, Any]:
    """A distance beside the paper's own, if it has one."""
    paper = None
    if published is not None:
        paper = {
            "L2": published.L2.mean,
            "Linf": published.Linf.mean,
            "L2_deviation": published.L2.deviation,
            "Linf_deviation": published.Linf.deviation,
        }
    return {"L2": distance.rms, "Linf": distance.max, "paper": paper}


def bound_entry(joint: JointOutcome) -> dict[str, Any]:
    """What no requests can go below, and how far above it the plans are."""
    return {
        "rms": math.degrees(joint.optimal.lower_bound),
        "gap": joint.optimal.gap,
        "closed_form_plain_gap": joint.closed_form_plain.gap,
        "closed_form_gap": joint.closed_form.gap,
        "level": "envelope",
    }


def foot_bound_entry(planned: PlannedWalk) -> dict[str, Any]:
    """What no requests within the limits bring the foot below, and how far above it the plan is."""
    return {
        "L2": 100.0 * planned.foot_plan.lower_bound,
        "gap": planned.foot_plan.gap,
        "level": "envelope",
    }


def limits_entry(joint: JointOutcome) -> dict[str, Any]:
    """The limits of a joint, and how far the farthest request of each plan is beyond them."""
    lower, upper = joint.limits
    return {
        "lower": math.degrees(lower),
        "upper": math.degrees(upper),
        "excess": {method: math.degrees(excess) for method, excess in joint.excesses.items()},
    }
