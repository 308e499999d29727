"""``request-planner refine``: executed requests and measured angles in, the next requests out."""

from __future__ import annotations

from pathlib import Path

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, warn
from planner.cli.settings import SMOOTHING, Run


@click.command()
@click.argument("requests", type=options.REWRITTEN)
@click.argument("measured", type=options.INPUT, nargs=-1, required=True)
@options.option(
    "--desired path",
    "The path that the requests were planned for: of joints, or of a foot with --leg.",
    options.INPUT,
    required=True,
)
@options.settings(
    f"leg: {options.LEG} unreachable",
    "model: file",
    "path: joints rate_hz",
    "plan: cyclic",
    "start: deg",
    f"plan: method load norm solver weights {SMOOTHING}",
    "limits: deg",
)
@options.option(
    "--history", "File with the trials so far: read if it exists, then written.", options.OUTPUT
)
@options.option("--cycles", "Cycles to take from MEASURED; by default all.", click.IntRange(1))
@options.option(
    "--sensor-delay-ms",
    "How late the measured angles are; 0 to take them as they are.  [default: estimated]",
    float,
)
@options.option(
    "--reidentify/--no-reidentify", "Whether the cycles may identify the models anew.", default=True
)
@options.output
@options.report("Write a page (HTML) about what was learnt.")
@options.answers
def refine(
    *,
    run: Run,
    path: str,  # noqa: ARG001
    requests: str,
    measured: tuple[str, ...],
    history: str | None,
    cycles: int | None,
    sensor_delay_ms: float | None,
    reidentify: bool,
    output: str,
    report: str | None,
) -> Answer:
    """Learn from executed REQUESTS and the angles MEASURED meanwhile: write the next requests.

    REQUESTS is what `plan` or `refine` wrote. MEASURED has the same columns, or those of a log, a
    row for each request, and as many cycles as were recorded; by its times single lost rows are
    filled. Several files are several recordings of the same requests. Joints that MEASURED has no
    column for keep their requests. Give the path, the leg, the models and the limits as to `plan`.
    After `plan --robust` what was measured takes the place of the drawn models: the next requests
    are for the nominal model and what was learnt.

    \b
    Example, the same line after every execution:
        request-planner plan path.csv --model arm.toml -o requests.csv
        request-planner refine requests.csv measured.csv --desired path.csv --model arm.toml \\
            --history learning.json -o requests.csv
    """  # noqa: D301
    from planner.cli.learning import (
        document,
        learning_report,
        read_executed,
        read_measured,
        recorded_in_a_cycle,
        refined,
        summary,
        write_states,
    )
    from planner.cli.planning import prepare

    desired = prepare(run)
    if history is None or not Path(history).is_file():  # else the first trial has said it
        options.warn_of(desired.remarks)
    if desired.foot is not None and "method" not in run.plan.keys_set:
        warn(
            f"learning joint by joint, as --method is {run.plan.method}: after a plan for the foot "
            "give --method foot-optimal here too"
        )
    executed = read_executed(requests, desired)
    angles = read_measured(measured, desired, executed, cycles=cycles)
    if words := recorded_in_a_cycle(desired, executed.angles, angles):
        options.warn_of([words])
    if angles.unused:
        warn(f"{angles.unused} measured rows after the last whole cycle are not used")
    with Progress(len(desired.names)) as progress:
        answer = refined(
            desired,
            executed.angles,
            angles,
            history=history,
            sensor_delay=None if sensor_delay_ms is None else 1e-3 * sensor_delay_ms,
            reidentify=reidentify,
            progress=progress,
        )
    if answer.not_measured:
        warn(answer.about_not_measured)
    if history is not None:
        write_states(history, answer)
    page = ""
    if report is not None:
        files = [("requests", output), ("history", history)]
        page = learning_report(answer, page=report, written=files)
    return Answer(
        document(answer),
        summary(answer),
        lambda file: desired.write(file, answer.requests, answer.loads),
        pages=[(report, page)],
    )
