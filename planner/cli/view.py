"""``request-planner view``: a page with the robot in Meshcat, as desired, direct and planned."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from planner.cli import options, types
from planner.cli.console import summarise
from planner.cli.settings import Method, Run
from planner.files.text import write_text

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.desired import Desired
    from planner.report.scene import Motion
    from planner.trajectory import Array


@click.command()
@click.argument("path", type=types.INPUT)
@options.settings(*options.LEG, "leg.unreachable", "model.file", "plan.cyclic")
@click.option(
    "--requests",
    type=types.INPUT,
    help="Requests to show as planned, as `plan` writes them; planned here by default.",
)
@click.option(
    "--method",
    type=click.Choice(["closed-form", "optimal", "foot-optimal"]),
    help="How to plan them here.  [default: foot-optimal for a foot path, else optimal]",
)
@click.option("--html", type=types.OUTPUT, required=True, help="The page, which needs no server.")
def view(*, run: Run, path: str, requests: str | None, method: Method | None, html: str) -> None:
    """Show the robot's leg following PATH, a foot path or joint path as for `plan`, on a page.

    Three legs move in real time, with the traces of their feet: the desired motion, the motion with
    the desired angles as requests, and the planned one. Needs the extra 'meshcat'.

    \b
    Example, a page to open in any browser:
        request-planner gait -o foot.csv
        request-planner view foot.csv --leg reference --unreachable clamp --html walk.html
    """  # noqa: D301
    from kinematics.scene import Scene
    from planner.cli.desired import find_leg, leg_title
    from planner.cli.models import model_words
    from planner.cli.planning import load, plan_of, prepare
    from planner.report.scene import import_meshcat, scene_page

    if find_leg(run.leg) is None:
        raise click.UsageError("name the leg with --leg.")
    if requests is not None and method is not None:
        raise click.UsageError("--method plans what --requests brings along: leave one out.")
    import_meshcat()
    prepared = load(run)
    options.warn_of(prepared.desired.remarks)
    place, desired = prepared.place, prepared.desired
    assert place is not None, "the options name a leg"
    assert desired.leg is not None, "the options name a leg"
    if set(desired.names) != set(desired.leg.joint_names):
        raise click.UsageError(
            f"{path}: got joints {', '.join(desired.names)}, expected those of the leg: "
            f"{', '.join(desired.leg.joint_names)}."
        )
    if requests is None:
        method = method or ("optimal" if desired.foot is None else "foot-optimal")
        plan = plan_of(prepare(replace(run, plan=replace(run.plan, method=method))))
        planned, loads = plan.predicted, plan.task.load
    else:
        planned, loads = _angles_under(requests, desired)
    page = scene_page(
        Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked),
        _motions(desired.leg, desired, planned, loads),
        period=desired.period,
        cyclic=desired.cyclic,
        title=f"request-planner: {leg_title(run.leg)}",
    )
    write_text(html, page)
    summarise(f"{html}: {len(desired.angles)} samples; {model_words(run.model)}")


def _angles_under(requests: str, desired: Desired) -> tuple[Array, Array | None]:
    """The simulated angles under the requests of a file [rad], and the file's load, (n, k)."""
    from planner.files.paths import read_joint_path
    from planner.model.response import simulate_joints

    path = read_joint_path(requests, joints=desired.names)
    path.check_period(desired.period)
    path.check_samples(len(desired.angles))
    angles = simulate_joints(desired.models, path.angles, cyclic=desired.cyclic, loads=path.loads)
    return angles, path.loads


def _motions(leg: Leg, desired: Desired, planned: Array, loads: Array | None) -> tuple[Motion, ...]:
    """Desired, direct and planned motions, joints in the order of the leg, under these loads."""
    from planner.model.response import simulate_joints
    from planner.report.scene import LOOKS, Motion

    order = [desired.names.index(name) for name in leg.joint_names]
    direct = simulate_joints(desired.models, desired.angles, cyclic=desired.cyclic, loads=loads)
    angles = [each[:, order] for each in (desired.angles, direct, planned)]
    feet = [leg.foot_positions(each) for each in angles]
    if desired.foot is not None:
        feet[0] = desired.foot
    return tuple(
        Motion(role, each, foot, opacity)
        for (role, opacity), each, foot in zip(LOOKS, angles, feet, strict=True)
    )
