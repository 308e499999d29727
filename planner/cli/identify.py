"""``request-planner identify`` and ``excite``: the model of a joint, and signals that show it."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import click

from planner.cli import options
from planner.cli.console import Answer, Progress, remark, warn
from planner.cli.declared import Count, Positive, Source, Span, argument, option
from planner.cli.settings import Run
from planner.exceptions import InvalidFile, InvalidInput, PlannerError, about, in_degrees
from planner.files.text import write_text

if TYPE_CHECKING:
    from planner.files.logs.rows import LogOptions
    from planner.identification.log import Log
    from planner.identification.result import Identification
    from planner.report.page import Page

FEW_ROWS = 20_000
"""Most rows for which joints are identified in this process: others would start more slowly."""


@options.command("Also write a page with pictures, as HTML.")
def identify(
    *,
    logs: tuple[Source, ...] = argument(form="LOG..."),
    log: Any = options.log_options(
        joint=(
            str | None,
            option("The joint to read where a log has several, or 'all'.", form="NAME"),
        )
    ),
    tick_ms: Positive | None = option(
        "Time step of the model.", otherwise="chosen from the rate of the log"
    ),
    hold: Count | None = option(
        "Ticks for which one request is held.", otherwise="chosen from the rate of the log"
    ),
    output: options.Output = option(
        "Where to write the model as TOML; '-' is standard output.",
        option="-o --output",
        default="-",
    ),
) -> Answer:
    """Find the parameters of a joint from LOGs of requested against actual angles.

    A LOG is CSV with columns such as t_s, requested_deg and actual_deg, a LeRobot dataset, a JSON
    of BAM, or a ROS bag; several of one joint are fitted together. With --joint all every joint
    gets a table in the model file. Of a model file that -o replaces, other joints, servos, legs and
    the bus stay. A model that is not to be planned with is written all the
    same, with its verdict; the exit status is 1.

    \b
    Example, step tests, the model that they determine, and a plan with it:
        request-planner excite --limits-deg -45:45 -o test.csv
        (play test.csv on the robot, record log.csv)
        request-planner identify log.csv -o joint.toml --report report.html
        request-planner plan desired.csv --model joint.toml -o requests.csv
    """  # noqa: D301
    from planner.files.joint_model import has_content, models_text, read_model_file
    from planner.model.evidence import with_reasons
    from planner.report.identification_text import REMARKS, identification_text, model_comments

    others, above = list[str](), ""
    try:
        if has_content(output):
            file = read_model_file(output)
            others, above = [name for name in file.models if name], file.joint
    except InvalidFile as error:
        words = "remove the file to replace it, or choose another name for the model"
        raise InvalidFile(output, f"is no valid model file ({error}); {words}") from error
    by_joint = _by_joint(logs, log)
    choices = {"tick": tick_ms and 1e-3 * tick_ms, "hold": hold}
    identifications, left_out = _identify_joints(by_joint, choices)
    tables, of_joint = identifications, ""
    document: dict[str, Any]
    if log.joint == "all":
        document = {"joints": {joint: each.to_dict() for joint, each in tables.items()}}
    else:
        ((joint, identification),) = identifications.items()
        # A single model is written above all tables: it then holds for a joint of any name.
        # Beside the tables of other joints it gets its own.
        own = joint or (others[0] if len(others) == 1 else "")
        if above not in ("", own) and own:
            others.append(above)
        tables = {own if others else "": identification}
        of_joint = "" if others else own or above
        document = {"joint": joint, **identification.to_dict()}
    if kept := [joint for joint in others if joint not in tables]:
        remark(f"{output}: the models of {', '.join(kept)} stay")
    text = models_text(
        {joint: each.model for joint, each in tables.items()},
        beside=output,
        remarks=REMARKS,
        about=model_comments(tables),
        of_joint=of_joint,
    )

    def page() -> Page:
        from planner.report.identification_page import identification_page

        return identification_page(identifications)

    refused = {name: each.reason for name, each in identifications.items() if not each.accepted}
    failure = ""
    if left_out:
        failure = f"no model of {', '.join(left_out)}; the others are written"
    elif refused:
        reasons = {name or "the joint": reason for name, reason in refused.items()}
        which = "the model" if len(refused) == 1 else "the models"
        failure = f"do not plan with {which} of {with_reasons(reasons)}; written all the same"
    return Answer(
        document,
        identification_text(identifications, "joint.toml" if output == "-" else output),
        lambda file: write_text(file, text),
        page,
        linked=[*(("log", file) for file in logs), ("model", output)],
        failure=failure,
        status=2 if any(isinstance(each, InvalidInput) for each in left_out.values()) else 1,
    )


def _by_joint(paths: Sequence[str], choices: LogOptions) -> dict[str, list[Log]]:
    """The logs by joint; assumptions of the reader are printed on standard error."""
    from planner.files.logs import read_logs
    from planner.identification.log import Doubt

    logs = read_logs(paths, options=choices)
    by_joint: dict[str, list[Log]] = {}
    for log in sorted(logs, key=lambda log: bool(log.joint)):  # those without a name first
        by_joint.setdefault(log.joint, []).append(log)
    named = [joint for joint in by_joint if joint]
    if choices.joint != "all" and len(named) > 1:
        raise click.UsageError(
            f"the logs are of different joints ({', '.join(named)}): choose one with --joint, or "
            "'all' for a model of each."
        )
    about_logs: dict[str, list[str]] = {}  # each note once for all logs
    for log in logs:
        rate = f"{len(log.times)} rows, one every {1e3 * log.period:.3g} ms"
        for note in (*log.notes, rate):
            name = f"{log.name} ({log.joint})" if log.joint else log.name
            about_logs.setdefault(note, []).append(name)
    doubted = all(any(isinstance(note, Doubt) for note in log.notes) for log in logs)
    for note, names in about_logs.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        unit = {"radians?": "rad", "degrees?": "deg"}.get(note.rpartition(" ")[2])
        advice = f" then rename the column, or give --unit {unit} where it has no unit"
        # a joint that moves far shows that the unit of all is right
        sure = not note.endswith("?") or (isinstance(note, Doubt) and not doubted)
        say = remark if sure else warn
        say(f"{names[0]}{more}: {note}{advice if unit else ''}")
    if choices.joint == "all":
        return by_joint
    return {named[0] if named else "": list(logs)}


def _identify_joints(
    logs: Mapping[str, Sequence[Log]], choices: Mapping[str, Any]
) -> tuple[dict[str, Identification], dict[str, PlannerError]]:
    """The identification of each joint, and the errors of those of several that are left out."""
    from planner.files.results import Task

    tasks = [Task(joint or "the joint", (tuple(own), choices)) for joint, own in logs.items()]
    rows = sum(len(log.times) for own in logs.values() for log in own)
    several = len(tasks) > 1 and rows > FEW_ROWS
    found: dict[str, Identification | PlannerError] = {}
    with Progress(len(tasks), parallel=several) as progress:
        if several:
            from planner.parallel import executor_of, outcomes

            with executor_of() as executor:
                for task, outcome in outcomes(identified, tasks, executor):
                    own = outcome.result  # of our own process
                    found[task.name] = pickle.loads(own) if own else PlannerError(outcome.reason)
                    progress(task.name)
        else:
            for task in tasks:
                progress(f"identifying {task.name}")
                found[task.name] = pickle.loads(identified(task.argument))
    by_joint = {joint: found[joint or "the joint"] for joint in logs}
    left_out = {name: each for name, each in by_joint.items() if isinstance(each, PlannerError)}
    if len(left_out) == len(by_joint):  # the only joint, or the first of as many as there are
        first, error = next(iter(left_out.items()))
        with about(first or ", ".join(log.name for log in logs[first])):
            raise error
    for joint, reason in left_out.items():
        warn(f"{joint} is left out: {in_degrees(reason)}")
    rest = {name: each for name, each in by_joint.items() if not isinstance(each, PlannerError)}
    return rest, left_out


def identified(arguments: Any) -> bytes:
    """The identification by logs and options, or its error: a task of :mod:`planner.parallel`."""
    from planner.identification.identify import identify as run

    logs, options = arguments
    try:
        return pickle.dumps(run(logs, **options))
    except PlannerError as error:
        return pickle.dumps(error)


Kind = Literal["combined", "steps", "multisine", "random-steps", "slow-triangle"]

UNNAMED = "requested"  # the joint of a signal without a name, whose column is requested_deg


@options.command()
def excite(
    *,
    kind: Kind = option(
        "A slow triangle, sines and steps in one recording, or one signal of its own; steps are "
        "the tests of Equation 1.",
        default="combined",
    ),
    limits_deg: Span = option(
        "Range of the requests; in percent where --model is in shares of the joint's range.",
        example=[-27, 147],
    ),
    rate_hz: Positive | None = option(
        "Requests per second.", otherwise="those of the expected model"
    ),
    duration_s: float | None = option(
        "Length of the signal, rests included.", otherwise="60 for combined, else 20"
    ),
    amplitude_deg: tuple[float, ...] = option(
        "Height of a step test. Repeat the option for several.",
        otherwise="an eighth, half and the whole of the range",
    ),
    cycles: int | None = option(
        "Cycles of each step test.", otherwise="3; 1 in each half of combined"
    ),
    joint: str = option("Name of the joint, for the column.", default=UNNAMED, form="NAME"),
    run: Run = options.settings("model: file"),
    expected_log: options.Output | None = option(
        "Also write the log of a simulated joint, as an input for identify."
    ),
    output: str = options.output,  # noqa: ARG001
) -> Answer:
    """Write test requests within limits, and print which parameters they determine.

    Move the joint slowly to the centre, play the requests one by one at their times, and record
    t_s, requested_deg and actual_deg (or _percent) right after each. The expected intervals come
    from simulating the joint of --model, with noise, and identifying it again.

    \b
    Example, a minute within 45 degrees either way, and a joint that is like the Aibo's:
        request-planner excite --limits-deg -45:45 -o test.csv --expected-log log.csv
    Steps of random height at 50 Hz for a joint that was identified before:
        request-planner excite --kind random-steps --limits-deg -60:30 --rate-hz 50 \\
            --model joint.toml --joint elbow -o elbow.csv
    """  # noqa: D301
    import numpy as np

    from planner.cli.desired import model_of
    from planner.files.columns import SHARES
    from planner.files.paths import write_joint_path
    from planner.files.table import table_text
    from planner.identification.excitation import excite as make
    from planner.identification.excitation import expect
    from planner.report.identification_text import excitation_results, excitation_text
    from planner.report.wording import UNITS

    model, (low, high), turns = model_of(run, joint), limits_deg, 720.0
    unit = UNITS[model.unit]
    if model.unit == "1" and not 0.0 <= low < high <= 100.0:
        raise click.UsageError(
            f"--limits-deg: got {low:g}:{high:g}, expected percent of the range, 0 to 100, as the "
            "model is in shares of it."
        )
    if high - low > turns:
        raise click.UsageError(
            f"--limits-deg: got {low:g}:{high:g}, expected at most {turns:g} degrees from one to "
            "the other, two turns; are they counts of a sensor?"
        )
    for height in amplitude_deg:
        if not 0.0 < height <= high - low:
            words = f"expected more than 0 and at most {high - low:g}, from one limit to the other."
            raise click.UsageError(f"--amplitude-deg: got {height:g}, {words}")
    for name, value in (("--amplitude-deg", amplitude_deg), ("--cycles", cycles)):
        if value not in (None, ()) and kind not in ("combined", "steps"):
            raise click.UsageError(f"{name} has no effect with --kind {kind}.")
    usual = 60.0 if kind == "combined" else 20.0
    excitation = make(
        kind.replace("-", "_"),
        limits=(low / unit.factor, high / unit.factor),
        period=model.period if rate_hz is None else 1.0 / rate_hz,
        duration=usual if duration_s is None else duration_s,
        amplitudes=[height / unit.factor for height in amplitude_deg],
        cycles=cycles,
    )
    expected = expect(excitation, model, noise=0.2 / unit.factor, resolution=0.3 / unit.factor)
    (fit,) = expected.fits
    prefix, log = "" if joint == UNNAMED else f"{joint}_", fit.log
    both = unit.factor * np.column_stack([log.requests, log.angles])
    simulated = np.column_stack([log.times, both])
    names = ["t_s", f"{prefix}requested_{unit.name}", f"{prefix}actual_{unit.name}"]
    carried = excitation.requests[:, None] * (SHARES["range"] if model.unit == "1" else 1.0)
    return Answer(
        excitation_results(excitation, expected),
        excitation_text(excitation, expected, model=run.model.file),
        lambda file: write_joint_path(
            file, [joint], carried, period=excitation.period, units=[unit.name]
        ),
        files=[(expected_log, table_text(names, simulated))],
    )
