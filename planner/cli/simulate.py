"""``request-planner simulate``: joints under requests."""

from __future__ import annotations

from typing import Literal

from planner.cli import options
from planner.cli.console import Answer, warn
from planner.cli.declared import Source, argument, option
from planner.cli.settings import Run
from planner.exceptions import InvalidFile, about


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
