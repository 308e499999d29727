"""``request-planner simulate``: requests in, angles out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from planner.cli import options, starts
from planner.cli.say import deliver, naming
from planner.cli.wanted import load_wanted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from planner.trajectory import Array


@click.command(short_help="Say what joints do under requests.")
@click.argument("requests")
@options.model
@options.joints
@options.cyclic
@starts.option
@click.option("--desired", metavar="FILE", help="Joint path to compare the angles with.")
@options.output
@options.as_json
def simulate(
    *,
    requests: str,
    model: str,
    joints: tuple[str, ...],
    cyclic: bool,
    start_deg: tuple[str, ...],
    desired: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Say what the joints do under REQUESTS, a CSV of <joint>_deg or <joint>_rad columns.

    \b
    Example, the angles under a plan and how far they are from the wanted ones:
        request-planner simulate requests.csv --desired desired.csv -o angles.csv
    """  # noqa: D301
    import numpy as np

    from planner.files.joint_path import write_joint_path
    from planner.model.response import simulate as simulate_joint

    given = load_wanted(requests, model=model, joints=joints, takes_leg=False)
    rest = starts.parse_starts(start_deg, given.names, cyclic=cyclic)
    columns = []
    for j, (name, joint) in enumerate(zip(given.names, given.models, strict=True)):
        with naming(name):
            columns.append(
                simulate_joint(joint, given.angles[:, j], cyclic=cyclic, start=rest.get(name))
            )
    angles = np.column_stack(columns)
    distances = {} if desired is None else _distances(desired, given.names, angles)
    document = {
        "cyclic": cyclic,
        "period_s": given.period,
        "joints": {
            name: {**distances.get(name, {}), "angles_deg": np.degrees(angles[:, j]).tolist()}
            for j, name in enumerate(given.names)
        },
    }
    summary = f"simulated {len(angles)} requests of {', '.join(given.names)}"
    for name, distance in distances.items():
        summary += f"\n{name}: {distance['rms_deg']:.3f} deg rms from the desired angles"
        summary += f", {distance['max_deg']:.3f} deg at most"
    deliver(
        document,
        summary,
        lambda file: write_joint_path(file, given.names, angles, period=given.period),
        output=output,
        as_json=as_json,
    )


def _distances(desired: str, names: Sequence[str], angles: Array) -> dict[str, dict[str, float]]:
    import numpy as np

    from planner.evaluation.metrics import angle_distance
    from planner.exceptions import InvalidFile
    from planner.files.joint_path import read_joint_path

    wanted = read_joint_path(desired, joints=names)
    if len(wanted.angles) != len(angles):
        raise InvalidFile(
            desired,
            f"got {len(wanted.angles)} samples, expected {len(angles)}, one per request; "
            "compare with the path that the requests were planned for",
        )
    distances = {}
    for j, name in enumerate(names):
        distance = angle_distance(angles[:, j], wanted.angles[:, j])
        distances[name] = {
            "rms_deg": float(np.degrees(distance.rms)),
            "max_deg": float(np.degrees(distance.max)),
        }
    return distances
