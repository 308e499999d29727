"""``request-planner simulate``: requests in, angles out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from planner.cli import options, types
from planner.cli.console import deliver, warn
from planner.exceptions import InvalidFile, about

if TYPE_CHECKING:
    from planner.cli.desired import Desired
    from planner.cli.settings import Run
    from planner.files.paths import JointPath
    from planner.model.evidence import Expectation
    from planner.trajectory import Array


@click.command()
@click.argument("requests", type=types.INPUT)
@options.settings(
    "model.file",
    "path.joints",
    "path.rate_hz",
    "plan.cyclic",
    "start.deg",
    rate_hz="Requests per second, as given to plan: the models take it.",
)
@click.option(
    "--load",
    type=click.Choice(["column"]),
    help="Torque on the joints: columns <joint>_load_Nm of REQUESTS, as plan --load writes them.",
)
@click.option("--desired", type=types.INPUT, help="Joint path to compare the angles with.")
@options.output
@options.as_json
def simulate(
    *,
    run: Run,
    requests: str,
    load: str | None,
    desired: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Simulate the joints under REQUESTS, a CSV of <joint>_deg or <joint>_rad columns.

    \b
    Example, the angles under a plan and their distances from the desired ones:
        request-planner simulate requests.csv --desired desired.csv -o angles.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli.desired import load_joints, refused_models, repeats, starts_of
    from planner.cli.models import model_words, verdict_document
    from planner.files.paths import write_joint_path
    from planner.model.evidence import untested_words
    from planner.model.response import simulate as simulate_joint

    given = load_joints(requests, run)
    path = None if desired is None else _desired(desired, given)
    cyclic, remarks = given.cyclic, given.remarks
    if path is not None:  # whose ends say more than those of its requests
        cyclic, closing = repeats(path.angles, run.plan.cyclic)
        remarks = (*closing, *refused_models(given.names, given.models))
    options.warn_of(remarks)
    rest = starts_of(run.start, given.names, cyclic=cyclic)
    loads = None if load is None else given.loads
    if load is not None and loads is None:
        raise InvalidFile(requests, "no columns <joint>_load_Nm, which --load column takes", line=1)
    if load is None and given.loads is not None:
        warn("the load in the columns is not used: ask for it with --load column")
    columns = []
    for j, (name, joint) in enumerate(zip(given.names, given.models, strict=True)):
        with about(name):
            column = None if loads is None else loads[:, j]
            columns.append(
                simulate_joint(
                    joint, given.angles[:, j], cyclic=cyclic, start=rest.get(name), load=column
                )
            )
    angles = np.column_stack(columns)
    distances = {} if path is None else _distances(path, given, angles)
    expected = () if path is None else _expected(path, given, angles, loads, cyclic=cyclic)
    robot = {
        name: {
            f"expected_rms_{given.unit(j)}": None
            if np.isnan(each.error)
            else float(np.degrees(each.error)),
            "untested": list(each.untested),
        }
        for j, (name, each) in enumerate(zip(given.names, expected, strict=False))
    }
    document = {
        "cyclic": cyclic,
        "period_s": given.period,
        "joints": {
            name: {
                **distances.get(name, {}),
                **robot.get(name, {}),
                **verdict_document(given.models[j]),
                f"angles_{given.unit(j)}": np.degrees(angles[:, j]).tolist(),
            }
            for j, name in enumerate(given.names)
        },
    }
    summary = f"{len(angles)} requests of {', '.join(given.names)}; {model_words(run.model)}"
    for j, (name, distance) in enumerate(distances.items()):
        unit, (rms, largest) = given.unit(j), distance.values()
        summary += f"\n{name}: {rms:.3f} {unit} rms from the desired angles"
        summary += f", {largest:.3f} {unit} at most"
        if np.isfinite(expected[j].error):
            summary += f"; on the robot expect about {np.degrees(expected[j].error):.3f} {unit} rms"
    if expected and (words := untested_words(given.names, expected)):
        summary += f"\n{words}"
    deliver(
        document,
        summary,
        lambda file: write_joint_path(
            file, given.names, angles, period=given.period, units=given.units
        ),
        output=output,
        as_json=as_json,
    )


def _desired(file: str, given: Desired) -> JointPath:
    """The path that the requests were planned for."""
    from planner.files.paths import read_joint_path

    path = read_joint_path(file, joints=given.names)
    if len(path.angles) != len(given.angles):
        raise InvalidFile(
            file,
            f"got {len(path.angles)} samples, expected {len(given.angles)}, one per request; "
            "compare with the path that the requests were planned for",
        )
    return path


def _expected(
    path: JointPath, given: Desired, angles: Array, loads: Array | None, *, cyclic: bool
) -> tuple[Expectation, ...]:
    """What to expect of each joint on the robot."""
    from planner.model.evidence import expectation

    return tuple(
        expectation(
            model.evidence,
            path.angles[:, j],
            angles[:, j],
            period=given.period,
            cyclic=cyclic,
            load=None if loads is None else loads[:, j],
        )
        for j, model in enumerate(given.models)
    )


def _distances(path: JointPath, given: Desired, angles: Array) -> dict[str, dict[str, float]]:
    import numpy as np

    from planner.evaluation.metrics import angle_distance

    distances = {}
    for j, name in enumerate(given.names):
        distance = angle_distance(angles[:, j], path.angles[:, j])
        distances[name] = {
            f"rms_{given.unit(j)}": float(np.degrees(distance.rms)),
            f"max_{given.unit(j)}": float(np.degrees(distance.max)),
        }
    return distances
