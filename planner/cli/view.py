"""``request-planner view``: a page with the robot moving, as desired, direct and planned."""

from __future__ import annotations

from typing import Literal

import click

from planner.cli import options
from planner.cli.console import summarise
from planner.cli.declared import Source, argument, option
from planner.cli.settings import Run
from planner.files.text import write_text


@options.command(answers=False)
def view(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable", "model: file", "plan: cyclic", path=argument()
    ),
    requests: Source | None = option(
        "Requests to show as planned, as `plan` writes them; planned here by default."
    ),
    method: Literal["closed-form", "optimal", "foot-optimal"] | None = option(
        "How to plan them here.", otherwise="foot-optimal for a foot path, else optimal"
    ),
    html: options.Output = option("The page, which needs no server."),
) -> None:
    """Write a page that shows the robot's leg following PATH, a foot or joint path as for `plan`.

    Three legs move in real time, with the traces of their feet: the desired motion, the motion with
    the desired angles as requests, and the planned one. Any browser opens the page, which --html
    names; the extra 'meshcat' draws it.

    \b
    Example, a page to open in any browser:
        request-planner gait -o foot.csv
        request-planner view foot.csv --leg reference --unreachable clamp --html walk.html
    """  # noqa: D301
    from kinematics.scene import Scene
    from planner.cli.desired import find_leg, model_words
    from planner.cli.planning import plan_of, prepare
    from planner.files.paths import read_joint_path
    from planner.model.response import simulate_joints
    from planner.report.meshcat_scene import import_meshcat, scene_page

    place = find_leg(run)
    if place is None:
        raise click.UsageError("name the leg with --leg.")
    if requests is not None and method is not None:
        raise click.UsageError("--method plans what --requests brings along: leave one out.")
    import_meshcat()
    run.plan.method = method or "optimal"
    desired = prepare(run)
    options.warn_of(desired.remarks)
    assert desired.leg is not None, "the options name a leg"
    if set(desired.names) != set(desired.leg.joint_names):
        raise click.UsageError(
            f"{run.path.file}: got joints {', '.join(desired.names)}, expected those of the leg: "
            f"{', '.join(desired.leg.joint_names)}."
        )
    if method is None and desired.foot is not None:
        run.plan.method = "foot-optimal"
    if requests is None:
        plan = plan_of(desired)
        planned, loads = plan.predicted, plan.task.load
    else:
        sent = read_joint_path(requests, joints=desired.names)
        sent.check_period(desired.period)
        sent.check_samples(len(desired.angles))
        loads = sent.loads
        planned = simulate_joints(desired.models, sent.values, cyclic=desired.cyclic, loads=loads)
    direct = simulate_joints(desired.models, desired.angles, cyclic=desired.cyclic, loads=loads)
    order = [desired.names.index(name) for name in desired.leg.joint_names]
    angles = [each[:, order] for each in (desired.angles, direct, planned)]
    feet = [desired.leg.foot_positions(each) for each in angles]
    if desired.foot is not None:
        feet[0] = desired.foot
    page = scene_page(
        Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked),
        angles,
        feet,
        period=desired.period,
        cyclic=desired.cyclic,
        title=f"request-planner: {desired.title}",
    )
    write_text(html, page)
    summarise(f"{html}: {len(desired.angles)} samples; {model_words(run.model)}")
