"""``request-planner view``: the robot in Meshcat, its leg as desired, direct and planned."""

from __future__ import annotations

import sys
import time
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import click

from planner.cli import legs, options, planning
from planner.cli.limits import parse_limits
from planner.cli.say import summarise
from planner.cli.wanted import load_chosen

if TYPE_CHECKING:
    from kinematics import Leg
    from kinematics.scene import Scene
    from planner.cli.wanted import Wanted
    from planner.report.draw_scene import Motion
    from planner.trajectory import Array

PLAIN_PLAN: dict[str, Any] = {
    "limits": (),
    "norm": None,
    "solver": None,
    "weights": None,
    "segments": None,
    "rule": None,
    "start_deg": (),
}
"""What `plan` takes beyond the method, left as it is."""


@click.command(short_help="Show the robot moving, in the browser.")
@click.argument("path")
@legs.options
@legs.unreachable
@options.model
@options.cyclic
@click.option(
    "--requests",
    metavar="FILE",
    help="Requests to show as planned, as `plan` writes them; planned here by default.",
)
@click.option(
    "--method",
    type=click.Choice(list(planning.IGNORED)),
    help="How to plan them here.  [default: foot-optimal for a foot path, else optimal]",
)
@click.option("--html", metavar="FILE", help="Write a page that needs no server, and end.")
@click.option("--open/--no-open", "browse", default=True, help="Whether to open a browser.")
def view(
    *, path: str, requests: str | None, html: str | None, browse: bool, **choices: Any
) -> None:
    """Show the robot's leg following PATH, a foot path or joint path as for `plan`.

    Three legs move in real time, with the traces of their feet: as desired, direct, which is where
    they go when that is what is requested, and as planned. The server ends with Ctrl-C. Needs the
    extra 'meshcat'.

    \b
    Example, a page to open in any browser:
        request-planner gait -o foot.csv
        request-planner view foot.csv --leg reference --unreachable clamp --html walk.html
    """  # noqa: D301
    from kinematics.scene import Scene
    from planner.report.draw_scene import import_meshcat

    place = legs.find_leg(choices)
    if place is None:
        raise click.UsageError("name the leg with --leg.")
    if requests is not None and choices["method"] is not None:
        raise click.UsageError("--method plans what --requests brings along: leave one out.")
    import_meshcat()
    leg, wanted = load_chosen(path, {**choices, "joints": ()})
    assert leg is not None, "the options name one"
    if set(wanted.names) != set(leg.joint_names):
        raise click.UsageError(
            f"{path}: got joints {', '.join(wanted.names)}, expected those of the leg: "
            f"{', '.join(leg.joint_names)}."
        )
    cyclic = choices["cyclic"]
    shown = shown_motions(leg, wanted, _planned(wanted, requests, choices), cyclic=cyclic)
    scene = Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked)
    settings = {"period": wanted.period, "cyclic": cyclic}
    if html is not None:
        from planner.files.text import write_text
        from planner.report.scene_page import scene_page

        title = f"request-planner: {legs.title(choices)}"
        write_text(html, scene_page(scene, shown, **settings, title=title))
        summarise(f"{html}: {len(wanted.angles)} samples, {len(scene.bodies)} links")
    else:
        _serve(scene, shown, settings, browse=browse)


def shown_motions(leg: Leg, wanted: Wanted, planned: Array, *, cyclic: bool) -> tuple[Motion, ...]:
    """The three motions, the joints in the order of the leg.

    Args:
        leg: The leg.
        wanted: What its joints should do.
        planned: What they do as planned [rad], shape (n, k), in the order of ``wanted``.
        cyclic: Whether the path repeats for ever.
    """
    from planner.report.draw_scene import motions

    order = [wanted.names.index(name) for name in leg.joint_names]
    direct = _answers(wanted, wanted.angles, cyclic=cyclic)
    angles = [each[:, order] for each in (wanted.angles, direct, planned)]
    feet = [leg.foot_positions(each) for each in angles]
    if wanted.foot is not None:
        feet[0] = wanted.foot
    first, second, third = zip(angles, feet, strict=True)
    return motions(first, second, third)


def _answers(wanted: Wanted, requests: Array, *, cyclic: bool) -> Array:
    """What the joints do under requests [rad], shape (n, k)."""
    import numpy as np

    from planner.model.response import simulate

    columns = [
        simulate(model, column, cyclic=cyclic)
        for model, column in zip(wanted.models, requests.T, strict=True)
    ]
    return np.column_stack(columns)


def _planned(wanted: Wanted, requests: str | None, choices: dict[str, Any]) -> Array:
    """What the joints do under the requests of a file, or under some that are planned here."""
    if requests is None:
        method = choices["method"] or ("optimal" if wanted.foot is None else "foot-optimal")
        asked = {**PLAIN_PLAN, "cyclic": choices["cyclic"], "method": method}
        planning.check_choices(asked, wanted)
        limits = parse_limits((), wanted.names, wanted.limits)
        return planning.make_plan(asked, wanted, limits, {}).predicted
    from planner.exceptions import InvalidFile
    from planner.files.joint_path import read_joint_path

    given = read_joint_path(requests, joints=wanted.names)
    given.check_period(wanted.period)
    if len(given.angles) != len(wanted.angles):
        raise InvalidFile(
            requests,
            f"got {len(given.angles)} requests, expected {len(wanted.angles)}, one per sample; "
            "show the path that they were planned for",
        )
    return _answers(wanted, given.angles, cyclic=choices["cyclic"])


def _serve(
    scene: Scene, shown: tuple[Motion, ...], settings: dict[str, Any], *, browse: bool
) -> None:
    """Show the scene in a browser until Ctrl-C."""
    from planner.report.draw_scene import draw_scene, import_meshcat

    with redirect_stdout(sys.stderr):  # Meshcat says where it is on standard output
        viewer = import_meshcat().Visualizer()
    draw_scene(viewer, scene, shown, **settings)
    if browse:
        viewer.open()
    summarise("Ctrl-C ends the view")
    while True:
        time.sleep(1.0)
