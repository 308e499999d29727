"""From what the joints or the foot should do, and the method chosen, to a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from planner.cli.checks import check_bound, check_limits
from planner.cli.limits import Limits
from planner.cli.say import naming

if TYPE_CHECKING:
    from planner.cli.wanted import Wanted
    from planner.inversion.arguments import Norm, Solver
    from planner.inversion.foot.result import FootInversion
    from planner.inversion.line_inverse import Rule
    from planner.inversion.result import Inversion
    from planner.model.joint import JointModel
    from planner.trajectory import Array

IGNORED = {
    "closed-form": ("norm", "solver", "weights", "start_deg"),
    "optimal": ("segments", "rule", "weights"),
    "foot-optimal": ("segments", "rule", "solver", "start_deg"),
}
"""Options that a method would silently ignore, and that are therefore refused."""


@dataclass(frozen=True)
class Plan:
    """Requests for all joints.

    Attributes:
        requests: What to send to the joints [rad], shape (n, k).
        predicted: What the joints then do [rad], shape (n, k).
        inversions: The plan of every joint, where they were planned one by one.
        together: The plan for the foot, where they were planned all at once.
    """

    requests: Array
    predicted: Array
    inversions: Mapping[str, Inversion]
    together: FootInversion | None = None

    @property
    def foot_bound(self) -> float | None:
        """What no requests bring the foot's error below [m]; None where it would take minutes."""
        from planner.inversion.foot.bound import MOST_SAMPLES_BOUNDED

        if self.together is None or len(self.requests) > MOST_SAMPLES_BOUNDED:
            return None
        return self.together.lower_bound

    def foot_positions(self, wanted: Wanted) -> Array:
        """Where the foot then is [m], shape (n, 3)."""
        assert wanted.leg is not None, "a foot belongs to a leg"
        return wanted.leg.foot_positions(self.predicted)

    def foot_distances(self, wanted: Wanted) -> Array:
        """How far that is from where it should be [m], shape (n,)."""
        from planner.evaluation.metrics import foot_distances

        assert wanted.foot is not None, "only a foot path says where the foot should be"
        return foot_distances(self.foot_positions(wanted), wanted.foot)


def check_choices(choices: Mapping[str, Any], wanted: Wanted) -> None:
    """Refuse options that do not go with the method or the path.

    Raises:
        click.UsageError: The message says which.
    """
    method = choices["method"]
    for name in IGNORED[method]:
        if choices[name] not in (None, ()):
            option = name.replace("_", "-")
            raise click.UsageError(f"--{option} has no effect with --method {method}.")
    if method == "foot-optimal" and wanted.foot is None:
        raise click.UsageError(
            "--method foot-optimal plans for a foot path: give columns x_m, y_m, z_m and a leg."
        )


def make_plan(
    choices: Mapping[str, Any],
    wanted: Wanted,
    limits: Limits,
    starts: Mapping[str, float],
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan by the method chosen, and look at the answer before it is handed over.

    Args:
        choices: The options.
        wanted: What the joints or the foot should do.
        limits: Limits of the requests [rad].
        starts: Where joints rest before [rad].
        progress: Told what is being planned.

    Raises:
        click.ClickException: The answer failed a check.
        PlannerError: There is none.
    """
    import numpy as np

    if choices["method"] == "foot-optimal":
        progress("the foot")
        plan = _for_the_foot(choices, wanted, limits)
    else:
        inversions = {}
        for j, (name, joint) in enumerate(zip(wanted.names, wanted.models, strict=True)):
            progress(name)
            with naming(name):
                inversions[name] = _for_a_joint(
                    choices, joint, wanted.angles[:, j], limits.get(name), starts.get(name)
                )
                check_bound(name, inversions[name])
        plan = Plan(
            requests=np.column_stack([each.requests for each in inversions.values()]),
            predicted=np.column_stack([each.predicted for each in inversions.values()]),
            inversions=inversions,
        )
    may_exceed = choices["method"] == "closed-form" and not choices["limits"]
    for j, name in enumerate(wanted.names):
        if name in limits:
            check_limits(name, plan.requests[:, j], limits[name], may_exceed=may_exceed)
    return plan


def prove(plan: Plan, *, progress: Callable[[str], None]) -> None:
    """Have it computed what no requests for the foot can beat, which takes seconds."""
    if plan.together is not None:
        progress("what no requests can beat")
        _ = plan.foot_bound


def _for_the_foot(choices: Mapping[str, Any], wanted: Wanted, limits: Limits) -> Plan:
    from planner.inversion.foot.invert import invert_foot

    assert wanted.leg is not None, "a foot path needs a leg"
    assert wanted.foot is not None, "this method plans for a foot path"
    lower, upper = zip(*(limits[name] for name in wanted.names), strict=True)
    plan = invert_foot(
        wanted.models,
        wanted.leg,
        wanted.foot,
        cyclic=choices["cyclic"],
        limits=(lower, upper),
        norm=choices["norm"] or "rms",
        weights=choices["weights"] or (1.0, 1.0, 1.0),
    )
    return Plan(plan.requests, plan.predicted, inversions={}, together=plan)


def _for_a_joint(
    choices: Mapping[str, Any],
    joint: JointModel,
    desired: Array,
    limits: tuple[float, float] | None,
    start: float | None,
) -> Inversion:
    from planner.inversion.closed_form import invert_closed_form
    from planner.inversion.optimal import invert_optimal

    cyclic = choices["cyclic"]
    if choices["method"] == "closed-form":
        rule: Rule = choices["rule"] or "paper"
        return invert_closed_form(
            joint, desired, cyclic=cyclic, segments=choices["segments"], rule=rule
        )
    norm: Norm = choices["norm"] or "rms"
    solver: Solver = choices["solver"] or "gauss-newton"
    return invert_optimal(
        joint, desired, cyclic=cyclic, limits=limits, norm=norm, start=start, solver=solver
    )
