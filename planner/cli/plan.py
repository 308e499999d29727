"""``request-planner plan``, ``compare``, ``fit`` and ``simulate``: what works on a joint path."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, summarise, terminal_width, warn
from planner.cli.declared import Positive, Source, argument, option
from planner.cli.settings import SMOOTHING, Run
from planner.exceptions import InvalidFile, PlannerError, about
from planner.files.text import write_text
from planner.report.wording import fitted_to


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

    PATH holds desired angles (columns <joint>_deg, _rad or _percent), or positions of a foot (x_m,
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


@options.command("Write a page (HTML) about the comparison.")
def compare(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: joints rate_hz",
        "plan: cyclic load segments norm",
        "limits: deg",
        path=argument(),
        norm="Error that optimised requests make small.",
        load="Torque on the joints: gravity at the desired angles by the masses of the leg's URDF, "
        "all of its dynamics, or columns <joint>_load_Nm of the path.",
    ),
    level: Literal["slope", "envelope", "exact"] = option(
        "Sharpest bound to compute; 'exact' takes seconds to a minute.", default="envelope"
    ),
) -> Answer:
    """Plan PATH by the closed form, by optimisation, and by CasADi with IPOPT, and compare.

    PATH is what `plan` takes. Prints the error of each plan and the lower bound of any, how far
    the requests differ, and whether the plans agree with an independent simulation and with each
    other. Exit status 1 if they do not.

    \b
    Example, a foot path, with a page about it:
        request-planner gait -o foot.csv
        request-planner compare foot.csv --leg reference --unreachable clamp --report compare.html
    """  # noqa: D301
    from planner.cli.desired import desired_of, model_words, scaled, units_in_messages
    from planner.cli.planning import inputs_of, notes_of, origins_of
    from planner.evaluation.cross_check import cross_check
    from planner.files.columns import SHARES
    from planner.report import comparison_page as report
    from planner.report.wording import CARRIED, renamed, rendered_text

    desired = desired_of(run)
    options.warn_of(desired.remarks)
    leg, units = desired.leg, desired.shown_units
    whole = leg if leg is not None and set(desired.names) == set(leg.joint_names) else None
    desired = desired if whole is None else desired.of_leg(whole)  # in its order
    steps = len(desired.names) + (whole is not None)
    with Progress(steps) as progress, units_in_messages(units):
        check = cross_check(
            desired.models,
            desired.angles,
            cyclic=desired.cyclic,
            limits=desired.limits,
            segments=run.plan.segments,
            leg=whole,
            norm=run.plan.norm,
            level=level,
            names=desired.names,
            load=desired.torques,
            progress=progress,
        )
    check = report.in_units(check, units)
    title, unreachable, notes = desired.title, desired.unreachable, notes_of(desired)
    with fitted_to(terminal_width(sys.stdout)):
        text = rendered_text("comparison.txt", **report.spoken_of(check, units))
    verdict = report.verdict_line(check)
    words = [f"{unreachable} samples were out of the leg's reach"] if unreachable else []
    words += [verdict] if check.passed else []
    document = {**check.to_dict(), "unreachable_samples": unreachable}
    for name, model in zip(desired.names, desired.models, strict=True):
        if units[name] == "percent":
            own = renamed(document["joints"][name], CARRIED["percent"])
            own["model"] = scaled(model, 1.0 / SHARES["range"]).parameters()  # as in its file
            document["joints"][name] = own
    return Answer(
        document,
        "\n".join(words),
        lambda _: click.echo(f"{model_words(run.model)}\n{text}"),
        lambda: report.comparison_page(
            check, units, title=title, leg=whole, unreachable=unreachable, notes=notes
        ),
        [*origins_of(run), ("bounds up to", level)],
        inputs_of(desired),
        failure="" if check.passed else verdict,
    )


def _knot(text: str) -> tuple[float, float | None]:
    """Time [s] and angle [rad] of a required knot, from '0.4' or '0.4=12.5'."""
    time, equals, angle = text.partition("=")
    return float(time), math.radians(float(angle)) if equals else None


KNOT = options.Parsed(_knot, "S[=DEG]", "seconds (0.4) or seconds=degrees (0.4=12.5)")


@options.command("Write a page (HTML) about the lines, and the error for other numbers of them.")
def fit(
    *,
    run: Run = options.settings(
        "model: file",
        "path: joints rate_hz",
        "plan: cyclic segments",
        path=argument(form="DESIRED"),
        rate_hz="Samples of DESIRED per second: the models take it.",
    ),
    max_error: Positive | None = option(
        "Use as few lines as stay this close to the path everywhere.", form="DEG"
    ),
    max_rms: Positive | None = option(
        "Use as few lines as stay this close to the path in root mean square.", form="DEG"
    ),
    knot_s: tuple[float, ...] = option(
        "Time of a knot. Repeat the option for each knot. Only their angles are then sought."
    ),
    required_s: Annotated[tuple[tuple[float, float | None], ...], KNOT] = option(
        "Time at which there must be a knot, and perhaps its angle. Repeat it for more."
    ),
    exact: bool = option(
        "With --segments or --max-rms: prove that no other knots on samples are better."
    ),
    knots: options.Output | None = option(
        "Also write the knots of a single joint: knot_s and value_deg or value_percent."
    ),
    output: str = options.output,
) -> Answer:
    """Approximate DESIRED, a CSV of <joint>_deg, _rad or _percent columns, by lines within ±v_max.

    \b
    Example, six lines per joint, and their knots:
        request-planner fit desired.csv --segments 6 --json
    As few lines as stay within 2 degrees, with a page:
        request-planner fit desired.csv --max-error 2 --report fit.html
    """  # noqa: D301
    import numpy as np

    from planner.approximation.fit_pwl import choices, fit_pwl
    from planner.cli.desired import load_joints, model_words, units_in_messages
    from planner.cli.planning import inputs_of, origins_of
    from planner.files.paths import write_curve
    from planner.report.fit_page import fit_page, fit_results, fits_table, proof_words
    from planner.report.wording import CARRIED

    path = load_joints(run)
    options.warn_of(path.remarks)
    units = {name: CARRIED[unit] for name, unit in path.shown_units.items()}
    if knots is not None and len(path.names) > 1:
        raise click.UsageError(
            f"--knots writes one joint, got {', '.join(path.names)}; choose one with --joint."
        )
    arguments: dict[str, Any] = {
        "cyclic": path.cyclic,
        "segments": run.plan.segments,
        "max_error": None if max_error is None else math.radians(max_error),
        "max_rms": None if max_rms is None else math.radians(max_rms),
        "knots": [_samples(time, path.period) for time in knot_s] or None,
        "required": {
            _samples(time, path.period): angle
            for time, angle in options.by_name("--required-s", required_s).items()
        },
        "exact": exact,
    }
    required = [
        f"{at:g}" if to is None else f"{at:g}={math.degrees(to):g}" for at, to in required_s
    ]
    asked = {"max error": max_error, "max rms": max_rms, "exact": exact and "true"}
    asked |= {"knots [s]": ", ".join(map(str, knot_s)), "required [s]": ", ".join(required)}
    fits = {}
    with Progress(len(path.names)) as progress:
        for j, (name, joint) in enumerate(zip(path.names, path.models, strict=True)):
            progress(name)
            with units_in_messages(path.shown_units), about(name), _in_seconds(path.period):
                fits[name] = fit_pwl(
                    path.angles[:, j], v_max=joint.v_max, tick=joint.period, **arguments
                )
    document = {
        "cyclic": path.cyclic,
        "period_s": path.period,
        "joints": {name: fit_results(curve, units[name]) for name, curve in fits.items()},
    }
    words = (
        f"lines within the top speed; {model_words(run.model)}\n{fits_table(fits, units).text()}"
    )
    words += f"\nproved: {proof}" if (proof := proof_words(fits)) else ""
    angles = np.column_stack([curve.angles for curve in fits.values()])
    if knots is not None:
        ((name, curve),) = fits.items()
        write_curve(knots, curve, unit=path.shown_units[name])
    return Answer(
        document,
        words,
        lambda file: path.write(file, angles),
        lambda: fit_page(fits, {name: choices(curve) for name, curve in fits.items()}, units),
        [*origins_of(run), *((name, f"{value}") for name, value in asked.items() if value)],
        [*inputs_of(path), ("lines", output), ("knots", knots)],
    )


@contextmanager
def _in_seconds(period: float) -> Iterator[None]:
    """Let errors inside the block name the times [s] of samples, as their user has."""
    try:
        yield
    except PlannerError as error:
        message, number = str(error), r"\bsample (-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
        error.args = (re.sub(number, lambda each: f"{period * float(each[1]):.6g} s", message),)
        raise


def _samples(time: float, period: float) -> float:
    """Time in samples; whole where the seconds were a multiple of the period but for rounding."""
    count = time / period
    if not math.isfinite(count):
        return count  # which the fit refuses
    return float(round(count)) if abs(count - round(count)) < 1e-6 else count


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
    """Simulate the joints under REQUESTS, a CSV of <joint>_deg, _rad or _percent columns.

    \b
    Example, the angles under a plan and their distances from the desired ones:
        request-planner simulate requests.csv --desired desired.csv -o angles.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli import desired as of
    from planner.files.paths import read_joint_path
    from planner.model.response import simulate as simulate_joint
    from planner.report.plan_results import simulation_answer

    inputs = of.load_joints(run)
    path = None if desired is None else read_joint_path(desired, joints=inputs.names)
    if path is not None:
        advice, expected = "give the path that the requests were planned for", len(inputs.angles)
        path.check_period(inputs.period, advice)
        if (count := len(path.values)) != expected:
            words = f"got {count} samples, expected {expected}, one per request; {advice}"
            raise InvalidFile(path.path, words)
    cyclic, remarks = inputs.cyclic, inputs.remarks
    if path is not None:  # its ends are better evidence than the ends of its requests
        cyclic, closing = of.repeats(path.values, run.plan.cyclic)
        remarks = closing, of.refused_models(inputs.names, inputs.models)
    options.warn_of(remarks)
    rest = of.starts_of(run.start, inputs.names, cyclic=cyclic)
    loads = None if load is None else inputs.loads
    if load is not None and loads is None:
        raise InvalidFile(
            str(run.path.file), "no columns <joint>_load_Nm, which --load column takes", line=1
        )
    if load is None and inputs.loads is not None:
        warn("the load in the columns is not used: ask for it with --load column")
    predicted = np.empty_like(inputs.angles)
    for j, (name, model) in enumerate(zip(inputs.names, inputs.models, strict=True)):
        start, load_of_joint = rest.get(name), None if loads is None else loads[:, j]
        with of.units_in_messages(inputs.shown_units), about(name):
            predicted[:, j] = simulate_joint(
                model, inputs.angles[:, j], cyclic=cyclic, start=start, load=load_of_joint
            )
    joints, words = simulation_answer(
        inputs.names,
        inputs.models,
        predicted,
        units=[*inputs.shown_units.values()],
        desired=None if path is None else path.values,
        cyclic=cyclic,
        loads=loads,
    )
    summary = f"{len(predicted)} requests of {', '.join(inputs.names)}; {of.model_words(run.model)}"
    document = {"cyclic": cyclic, "period_s": inputs.period, "joints": joints}
    return Answer(document, summary + words, lambda file: inputs.write(file, predicted))


@options.command(answers=False)
def view(
    *,
    run: Run = options.settings(
        f"leg: {options.LEG} unreachable",
        "model: file",
        "path: rate_hz",
        "plan: cyclic",
        path=argument(),
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
