"""``request-planner gait``: parameters of a walk in, the path of a foot or of four legs out."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal, get_args

import click

from planner.cli import options
from planner.cli.console import Answer, Progress
from planner.cli.declared import option
from planner.cli.settings import HalfEllipse, Run
from planner.exceptions import InvalidFile, InvalidInput
from planner.files.text import within
from planner.report.wording import table_of

PERIOD = within(ge=1e-6, le=1e3, words="1e-06 to 1000 seconds")  # beyond, the unit is mistaken
Pattern = Literal["walk", "trot", "pace", "bound"]  # as of planner.gait.stride, slow to import


@options.command()
def gait(
    *,
    run: Run = options.settings(
        "path.half_ellipse",
        f"leg: {options.LEG}",
        "model: file",
        "tolerance: cm",
        cm="With --fastest: largest distance of the foot from its path.",
    ),
    fastest: bool = option(
        "Find the shortest cycle at which the foot of a leg, planned with the joints of --model, "
        "stays within --tolerance-cm."
    ),
    pattern: Pattern | None = option(
        "Four legs, those of the robot that --model describes, in this gait, one of "
        f"{', '.join(get_args(Pattern))}: angles of all their joints instead of a foot path.",
        form="GAIT",
    ),
    period: Annotated[float, PERIOD] = option("Time between samples [s].", default=0.008),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
    """Make the half-ellipse foot path of a walk, in the hip's frame; by default the paper's.

    With a leg the path is in the base's frame, around the foot of the leg's standing pose (--near),
    and as large as the leg can trace it well; options overrule that.

    \b
    Example, a longer and flatter step, and one as large as a leg can trace:
        request-planner gait --half-stroke 0.055 --height 0.03 -o foot.csv
        request-planner gait --leg front-left -o foot.csv

    \b
    Example, the four legs of the ERS-210A in a trot, and a plan for their twelve joints:
        request-planner gait --pattern trot -o trot.csv
        request-planner plan trot.csv -o requests.csv

    \b
    Example, the shortest cycle at which the foot stays within half a centimetre:
        request-planner gait --leg front-left --fastest --tolerance-cm 0.5 -o foot.csv
    """  # noqa: D301
    from planner.cli.desired import leg_of, models_of, refused_models
    from planner.files.paths import write_foot_path
    from planner.gait.half_ellipse import half_ellipse
    from planner.gait.stride import in_samples, shortest_cycle, stride
    from planner.report.gait_results import shortest_answer, stride_results, stride_text

    if fastest != (run.tolerance.cm is not None):
        raise click.UsageError("--fastest and --tolerance-cm go together: give both, or neither.")
    walk = run.path.half_ellipse or HalfEllipse()
    samples = walk.samples
    leg = leg_of(run)
    if pattern is not None:
        if leg is not None or fastest:
            raise click.UsageError(
                "--pattern moves the four legs of --model: leave out --leg and --fastest."
            )
        return _whole_robot(run, walk, pattern, period)
    if not fastest and "file" in run.model.keys_set:
        raise click.UsageError("--model has no effect without --fastest or --pattern.")
    if fastest and leg is None:
        raise click.UsageError("--fastest needs a leg: name it with --leg.")
    document: dict[str, Any] = {"period_s": period}
    words = f"a cycle of {samples} samples, {samples * period:g} s"
    if leg is None:
        path = half_ellipse(**walk.arguments())
    else:
        leg_stride = stride(leg, **walk.arguments(given_only=True))
        path = leg_stride.foot
        stretched = 1.0
        if run.tolerance.cm is not None:
            run.path.rate_hz = 1.0 / period
            models = models_of(run, leg.joint_names, leg)
            options.warn_of([refused_models(leg.joint_names, models)])
            with Progress() as progress:
                cycle = shortest_cycle(
                    models,
                    leg,
                    partial(in_samples, path),
                    tolerance=0.01 * run.tolerance.cm,
                    samples=len(path),
                    progress=progress,
                )
            document["fastest"], words = shortest_answer(cycle, run.tolerance.cm)
            path = in_samples(path, len(cycle.requests))
            stretched = len(path) / samples
        document["stride"] = stride_results(leg, leg_stride, stretched * period)
        words += f"\n{stride_text(document['stride'])}"
    document |= {f"{axis}_m": path[:, k].tolist() for k, axis in enumerate("xyz")}
    return Answer(document, words, lambda file: write_foot_path(file, path, period=period))


def _whole_robot(run: Run, walk: HalfEllipse, pattern: Pattern, period: float) -> Answer:
    import numpy as np

    from planner.cli.desired import legs_of
    from planner.files.paths import write_joint_path
    from planner.gait.stride import check_legs
    from planner.gait.stride import gait as gait_of
    from planner.report.gait_results import stride_results

    legs = legs_of(run)
    try:
        check_legs(legs)
    except InvalidInput as error:
        raise InvalidFile(
            run.model.file,
            f"{error}; describe each in a table [leg.front-left] with urdf, base and foot",
        ) from error
    gaits = gait_of(legs, pattern, **walk.arguments(given_only=True))
    document, rows = {}, []
    for name, each in gaits.items():
        figures = stride_results(legs[name], each, period)
        document[name] = {"phase": each.phase, **figures}
        row = dict(zip("xyz", figures["centre_m"], strict=True)) | document[name]
        rows.append((name, row | {"fastest": max(figures["speeds_deg_s"].values())}))
    stride = next(iter(gaits.values()))
    names = [joint for leg in legs.values() for joint in leg.joint_names]
    angles = np.hstack([each.angles for each in gaits.values()])
    columns = {
        "phase": "phase .4g",
        **{f"{axis} [m]": f"{axis} .4g" for axis in "xyz"},
        "fastest [deg/s]": "fastest .0f",
    }
    return Answer(
        {"pattern": pattern, "period_s": period, "legs": document}
        | {f"{name}_deg": np.degrees(angles[:, j]).tolist() for j, name in enumerate(names)},
        f"{pattern}: a cycle of {walk.samples} samples, {walk.samples * period:g} s, of "
        f"{len(names)} joints; half stroke {stride.length:.4g} m, height {stride.height:.4g} m\n"
        + table_of("leg", rows, columns).text(),
        lambda file: write_joint_path(file, names, angles, period=period),
    )
