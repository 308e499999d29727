"""``request-planner simulate`` and ``view``: joints under requests, as angles or as a page."""

from __future__ import annotations

from typing import Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, summarise, warn
from planner.cli.declared import Source, argument, option
from planner.cli.settings import Run
from planner.exceptions import InvalidFile, about
from planner.files.text import write_text


@options.command()
def simulate(
    *,
    run: Run = options.settings(
        "model: file",
        "path: joints rate_hz",
        "plan: cyclic",
        "start: deg",
        path=argument(form="REQUESTS"),
        rate_hz="Requests per second, as given to plan: the models take it.",
    ),
    load: Literal["column"] | None = option(
        "Torque on the joints: columns <joint>_load_Nm of REQUESTS, as plan --load writes them."
    ),
    desired: Source | None = option("Joint path to compare the angles with."),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
    """Simulate the joints under REQUESTS, a CSV of <joint>_deg or <joint>_rad columns.

    \b
    Example, the angles under a plan and their distances from the desired ones:
        request-planner simulate requests.csv --desired desired.csv -o angles.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli.desired import load_joints, model_words, refused_models, repeats, starts_of
    from planner.files.paths import read_joint_path
    from planner.model.response import simulate as simulate_joint
    from planner.report.plan_results import simulation_answer

    inputs = load_joints(run)
    path = None if desired is None else read_joint_path(desired, joints=inputs.names)
    if path is not None and len(path.values) != len(inputs.angles):
        raise InvalidFile(
            path.path,
            f"got {len(path.values)} samples, expected {len(inputs.angles)}, one per request; "
            "compare with the path that the requests were planned for",
        )
    cyclic, remarks = inputs.cyclic, inputs.remarks
    if path is not None:  # its ends are better evidence than the ends of its requests
        cyclic, closing = repeats(path.values, run.plan.cyclic)
        remarks = closing, refused_models(inputs.names, inputs.models)
    options.warn_of(remarks)
    rest = starts_of(run.start, inputs.names, cyclic=cyclic)
    loads = None if load is None else inputs.loads
    if load is not None and loads is None:
        raise InvalidFile(
            str(run.path.file), "no columns <joint>_load_Nm, which --load column takes", line=1
        )
    if load is None and inputs.loads is not None:
        warn("the load in the columns is not used: ask for it with --load column")
    columns = []
    for j, (name, model) in enumerate(zip(inputs.names, inputs.models, strict=True)):
        column = None if loads is None else loads[:, j]
        with about(name):
            angles = simulate_joint(
                model, inputs.angles[:, j], cyclic=cyclic, start=rest.get(name), load=column
            )
        columns.append(angles)
    predicted = np.column_stack(columns)
    joints, words = simulation_answer(
        inputs.names,
        inputs.models,
        predicted,
        units=[*inputs.shown_units.values()],
        desired=None if path is None else path.values,
        cyclic=cyclic,
        loads=loads,
    )
    summary = f"{len(predicted)} requests of {', '.join(inputs.names)}; {model_words(run.model)}"
    document = {"cyclic": cyclic, "period_s": inputs.period, "joints": joints}
    return Answer(document, summary + words, lambda file: inputs.write(file, predicted))


@options.command(answers=False)
def view(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable", "model: file", "plan: cyclic", path=argument()
    ),
    requests: Source | None = option(
        "Requests to show as planned, as `plan` writes them; planned here by default, all at once "
        "for a foot path."
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
    import_meshcat()
    desired = prepare(run)
    options.warn_of(desired.remarks)
    assert desired.leg is not None, "the options name a leg"
    if set(desired.names) != set(desired.leg.joint_names):
        raise click.UsageError(
            f"{run.path.file}: got joints {', '.join(desired.names)}, expected those of the leg: "
            f"{', '.join(desired.leg.joint_names)}."
        )
    if desired.foot is not None:
        run.plan.method = "foot-optimal"
    if requests is None:
        with Progress(len(desired.names)) as progress:
            plan = plan_of(desired, progress, bounded=False)
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
