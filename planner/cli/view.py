"""``request-planner view``: the robot in Meshcat, its leg as desired, direct and planned."""

from __future__ import annotations

import sys
import time
from contextlib import redirect_stdout
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options, types
from planner.cli.console import summarise
from planner.cli.settings import Method, Run
from planner.files.text import write_text

if TYPE_CHECKING:
    from kinematics.scene import Scene
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
@click.option("--html", type=types.OUTPUT, help="Write a page that needs no server, and end.")
@click.option(
    "--open/--no-open",
    "browse",
    default=True,
    show_default=False,
    help="Whether to open a browser.",
)
def view(
    *,
    run: Run,
    path: str,
    requests: str | None,
    method: Method | None,
    html: str | None,
    browse: bool,
) -> None:
    """Show the robot's leg following PATH, a foot path or joint path as for `plan`.

    Three legs move in real time, with the traces of their feet: the desired motion, the motion with
    the desired angles as requests, and the planned one. Ctrl-C ends the server. Needs the extra
    'meshcat'.

    \b
    Example, a page to open in any browser:
        request-planner gait -o foot.csv
        request-planner view foot.csv --leg reference --unreachable clamp --html walk.html
    """  # noqa: D301
    from kinematics.scene import Scene
    from planner.cli.desired import find_leg, leg_title
    from planner.cli.models import model_words
    from planner.cli.planning import load, plan_of, prepare
    from planner.cli.run_file import shown_motions
    from planner.report.scene import import_meshcat

    if find_leg(run.leg) is None:
        raise click.UsageError("name the leg with --leg.")
    if requests is not None and method is not None:
        raise click.UsageError("--method plans what --requests brings along: leave one out.")
    import_meshcat()
    prepared = load(run)
    options.warn_of(prepared.desired.remarks)
    place, desired, cyclic = prepared.place, prepared.desired, prepared.desired.cyclic
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
        planned, loads = _angles_under(requests, desired, cyclic=cyclic)
    leg_motions = shown_motions(desired.leg, desired, planned, cyclic=cyclic, loads=loads)
    scene = Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked)
    settings: dict[str, Any] = {"period": desired.period, "cyclic": cyclic}
    if html is not None:
        from planner.report.scene import scene_page

        title = f"request-planner: {leg_title(run.leg)}"
        write_text(html, scene_page(scene, leg_motions, **settings, title=title))
        summarise(f"{html}: {len(desired.angles)} samples; {model_words(run.model)}")
    else:
        _serve(scene, leg_motions, settings, browse=browse)


def _angles_under(requests: str, desired: Desired, *, cyclic: bool) -> tuple[Array, Array | None]:
    """The simulated angles under the requests of a file [rad], and the file's load, (n, k)."""
    from planner.files.paths import read_joint_path
    from planner.model.response import simulate_joints

    path = read_joint_path(requests, joints=desired.names)
    path.check_period(desired.period)
    path.check_samples(len(desired.angles))
    angles = simulate_joints(desired.models, path.angles, cyclic=cyclic, loads=path.loads)
    return angles, path.loads


def _serve(
    scene: Scene, leg_motions: tuple[Motion, ...], settings: dict[str, Any], *, browse: bool
) -> None:
    from planner.report.scene import draw_scene, import_meshcat

    with redirect_stdout(sys.stderr):  # Meshcat prints its address on standard output
        viewer = import_meshcat().Visualizer()
    draw_scene(viewer, scene, leg_motions, **settings)
    if browse:
        viewer.open()
    summarise("Ctrl-C ends the view")
    while True:
        time.sleep(1.0)
