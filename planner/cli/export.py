"""``request-planner export``: requests in, files for robots out; for other commands, too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

from planner.cli import options
from planner.cli.console import Answer, BadSetting, marked
from planner.cli.declared import Source, argument, option
from planner.cli.settings import Export, Run
from planner.exceptions import InvalidFile, InvalidInput

if TYPE_CHECKING:
    from planner.arrays import Array
    from planner.files.exports import Schedule
    from planner.files.paths import SampledPath
    from planner.robot.arm import Servo


@options.command()
def export(
    *,
    requests: Source = argument(),
    run: Run = options.settings("export", "path: joints"),
    output: str = options.output_or_folder,
    model: Source | None = option(
        "csv in ticks: zero, direction and ticks of a turn of each joint's servo, as calibrate "
        "writes them, instead of --zero-tick, --reverse and --ticks-per-turn."
    ),
) -> Answer:
    """Write REQUESTS, a CSV as `plan` writes it, in a format that robots take; '-' is standard input.

    \b
    csv      one row at every tick of a controller, in rad, deg or a servo's ticks
    yaml     a ROS 2 message trajectory_msgs/JointTrajectory, for `ros2 topic pub`
    bag      a ROS 2 bag (SQLite) with that message, for `ros2 bag play`; a folder
    mcap     the same with MCAP inside
    lerobot  a LeRobot dataset v3.0 with the requests as actions; a folder

    \b
    Example, ten cycles for a Dynamixel at 50 Hz, and for a trajectory controller of ROS 2:
        request-planner plan path.csv --rate-hz 50 -o requests.csv
        request-planner export requests.csv --format csv --unit ticks --cycles 10 -o ticks.csv
        request-planner export requests.csv --format yaml --lead-s 2 --joint-names lf_hip,lf_knee
    """  # noqa: D301, E501
    from planner.files.exports import Schedule
    from planner.files.paths import read_joint_path

    (export,) = run.export
    path = read_joint_path(requests, joints=run.path.joints)
    if path.times is None:
        raise InvalidFile(requests, "no column t_s, so no time between requests; add it")
    schedule, servos = Schedule(path.names, path.values, path.step, path.units), None
    if model is not None:
        angles, servos = _by_servos(model, export, path)
        schedule = Schedule(path.names, angles, path.step)
    check_place("export.format", export.format, output)
    advice = "export with --model, whose limits of its servo are its range, or "
    advice = advice if export.unit == "ticks" else ""
    return Answer(*exported(export, schedule, servos, advice=advice))


def _by_servos(model: str, export: Export, path: SampledPath) -> tuple[Array, dict[str, Servo]]:
    """The angles of the servos in a model file, and these by the joints' names in the export."""
    from planner.cli.servos import in_servos
    from planner.files.joint_model import read_servos

    if export.unit != "ticks":
        raise click.UsageError("--model needs --unit ticks: it has no effect on other units.")
    if export.zero_tick or export.zero_ticks or export.reverse or export.ticks_per_turn:
        raise click.UsageError(
            "--model sets zeros, directions and ticks: leave out --zero-tick, --reverse and "
            "--ticks-per-turn."
        )
    servos = read_servos(model, path.names)
    angles, *_ = in_servos(servos, path)
    # that there are as many names as joints is checked with the rows
    names = export.joint_names or path.names
    return angles, dict(zip(names, servos.values(), strict=False))


FOLDERS = ("bag", "mcap", "lerobot")  # formats that are a folder, which standard output cannot be
COUNTED = ("ticks", "us")  # units in which servos count


def check_place(setting: str, form: str, output: str) -> None:
    """Refuse standard output for a format that is a folder."""
    if form in FOLDERS and output == "-":
        raise BadSetting(f"{marked(setting, form)} is a folder: name it with --output")


def exported(
    export: Export,
    schedule: Schedule,
    servos: Mapping[str, Servo] | None = None,
    *,
    advice: str = "",
) -> tuple[dict[str, Any], str, Callable[[str], None]]:
    """The rows of requests for machines and for people, and the function that writes them.

    Refuses what has no effect, and what the format cannot hold. ``servos`` count the angles of an
    export in their units, by default those of the settings. ``advice`` says how else to count
    joints in shares of their range.
    """
    from planner.files.exports import check_installed, frame_rate, repeated, resampled

    export.check_effect("export", "format")
    for name in ("ticks_per_turn", "zero_tick", "zero_ticks", "reverse"):
        if getattr(export, name) not in (None, {}) and export.unit not in COUNTED:
            raise BadSetting(f'‹export.{name}› needs ‹export.unit = "ticks"›')
    if (names := export.joint_names) is not None:
        if len(names) != len(schedule.names) or len({*names}) < len(names):
            raise InvalidInput(
                f"joint names: got {', '.join(names) or 'none'}, expected "
                f"{len(schedule.names)} different names, one per column of the requests"
            )
        schedule = schedule._replace(names=names)
    rows = repeated(schedule, export.cycles)
    if export.rate_hz is not None:
        rows = resampled(rows, export.rate_hz)
    check_installed(export.format)
    if export.format == "lerobot":
        frame_rate(rows.period)
    if export.unit in COUNTED and servos is None:
        if rows.in_shares:
            raise InvalidInput(
                f"'{rows.in_shares[0]}' is in shares of its range, expected an angle to count; "
                f"{advice}leave it out"
            )
        from planner.files.columns import PULSE_ZERO, PULSES_PER_TURN
        from planner.robot.arm import Servo, servos_of

        zero, turn = (PULSE_ZERO, PULSES_PER_TURN) if export.unit == "us" else (2048, 4096)
        zero = zero if export.zero_tick is None else export.zero_tick
        like = Servo(zero_tick=zero, ticks_per_turn=export.ticks_per_turn or turn)
        ids = dict.fromkeys(rows.names, 0)
        servos = servos_of(ids, like, export.zero_ticks or {}, export.reverse or ())
    rate = f"{1.0 / rows.period:.6g} Hz, {rows.duration:.6g} s"
    summary = f"{len(rows.requests)} rows of {', '.join(rows.names)} at {rate}"
    if rows.in_shares and servos is None and export.format != "csv":
        summary += f"\n{', '.join(rows.in_shares)} in shares of the range, 0 to 1, not in rad"
    document = {
        "format": export.format,
        "joints": list(rows.names),
        "rows": len(rows.requests),
        "period_s": rows.period,
        "duration_s": rows.duration,
    }
    return document, summary, lambda file: _write(file, export, rows, servos)


def _write(file: str, export: Export, rows: Schedule, servos: Mapping[str, Servo] | None) -> None:
    """Write the rows; to a folder where the format is one."""
    from planner.files import exports

    if export.format == "csv":
        exports.write_controller_csv(file, rows, unit=export.unit, servos=servos)
    elif export.format == "lerobot":
        rate = exports.frame_rate(rows.period)
        layout = exports.Layout(features={"action": rows.names}, rate=rate)
        with exports.lerobot_dataset(file, layout) as add:
            add({"action": rows.written()[1]}, export.task)
    else:
        message = exports.joint_trajectory(rows, lead=export.lead_s)
        if export.format == "yaml":
            exports.write_trajectory_yaml(file, message)
        else:
            storage: Any = "mcap" if export.format == "mcap" else "sqlite3"
            exports.write_bag(file, message, storage=storage, topic=export.topic)
