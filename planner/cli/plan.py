"""``request-planner plan``: a joint or foot path in, requests out."""

from __future__ import annotations

from planner.cli import options
from planner.cli.console import Answer, Progress
from planner.cli.declared import argument
from planner.cli.settings import SMOOTHING, Run


@options.command("Write a page (HTML) about the plan.")
def plan(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: joints rate_hz speed",
        "plan: cyclic",
        "start: deg",
        f"plan: method segments rule load norm solver weights {SMOOTHING} robust",
        "limits: deg",
        "tolerance: deg cm",
        path=argument(),
    ),
    output: str = options.output,
) -> Answer:
    """Plan requests that make the joints follow PATH, a CSV; '-' is standard input.

    PATH holds desired angles (columns <joint>_deg or <joint>_rad), or positions of a foot (x_m,
    y_m, z_m, or _cm, _mm) for a leg.

    \b
    Example, requests for a foot path inside the joints' limits, joint by joint and all at once:
        request-planner plan foot.csv --leg front-left -o requests.csv
        request-planner plan foot.csv --leg front-left --method foot-optimal -o requests.csv

    \b
    Example, the first of them with requests that change by at most 500 degrees per second:
        request-planner plan foot.csv --leg front-left --max-request-speed-deg-s 500 -o requests.csv

    \b
    Example, requests that are good for every model that the intervals of an identified one allow:
        request-planner plan path.csv --model joint.toml --robust worst -o requests.csv

    \b
    Example, a second opinion on the first of them:
        request-planner plan foot.csv --leg front-left --solver ipopt -o requests.csv
    """  # noqa: D301
    from planner.cli.planning import answer_of, inputs_of, origins_of, page_of, plan_of, prepare

    desired = prepare(run)
    options.warn_of(desired.remarks)
    with Progress(len(desired.names)) as progress:
        result = plan_of(desired, progress)
    answer, remarks = answer_of(desired, result)
    options.warn_of(remarks)
    missed = "; ".join(answer.missed or ())
    return Answer(
        answer.document(),
        answer.text(),
        lambda file: desired.write(file, result.requests, result.task.load),
        lambda: page_of(desired, answer),
        origins_of(run),
        [*inputs_of(desired), ("requests", output)],
        failure=f"{missed}; the requests are written all the same" if missed else "",
    )
