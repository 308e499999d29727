"""``request-planner calibrate`` and ``check``: models of servos, and whether they still hold."""

from __future__ import annotations

import math
import select
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from planner.cli import options, servos
from planner.cli.console import Answer, Progress, remark, summarise, warn
from planner.cli.declared import Positive, option
from planner.cli.settings import Tick
from planner.exceptions import InvalidFile, InvalidInput, about
from planner.files.staging import check_writable
from planner.files.text import within, write_text

if TYPE_CHECKING:
    from planner.robot.arm import Arm
    from planner.robot.calibration import Compared

RATE = within(ge=16.0, words="16 Hz or more")  # less has too few for the sines of the test motion
TICKS = options.of_kind(Tick, "[JOINT=]N", "knee=2048")


@options.command("Also write a page with pictures, as HTML.")
def calibrate(
    *,
    port: Mapping[str, Any] = servos.bus_options(),
    ids: Annotated[Mapping[str, int], servos.IDS] = option(
        "Identifiers of the servos: 1-6, or with names for the joints pan=1,lift=2."
    ),
    joint: tuple[str, ...] = option(
        "Calibrate this joint only. Repeat the option for several joints.", otherwise="all"
    ),
    reverse: tuple[str, ...] = option("The servo of this joint is mounted the other way round."),
    zero_tick: Annotated[tuple[tuple[str, int], ...], TICKS] = option(
        "Count of the servo at angle 0.", otherwise="the middle, 2048, or 512 of an XL-320"
    ),
    rate_hz: Annotated[float, RATE] = option(
        "Requests per second, as the joints will get them later.", default=100.0
    ),
    duration_s: Positive = option(
        "Time for which each joint is excited; its test motions take another half a minute.",
        default=60.0,
    ),
    reach_deg: Positive = option(
        "How far a joint may go from where it is, unless its range is shown by hand.", default=45.0
    ),
    yes: bool = option("Ask nothing: ranges by the servos' limits, and go."),
    resume: bool = option("Take the logs of an interrupted run as they are."),
    dry_run: bool = option("Check the servos, say what would be done, and end."),
    output: Annotated[str, options.Place("file", None, check_writable)] = option(
        "Where to write the models and servos; joints that are there already stay.",
        option="-o --output",
        default="arm.toml",
    ),
) -> Answer | None:
    """Move every joint, identify its model, and compare the ways to make it follow a path.

    Each joint goes slowly to the middle of its range, moves there for a minute (a slow triangle,
    sines, steps), and then plays a test motion in five ways. What was closest is recommended, and
    its model is written, with servo, zero, direction and range. A servo that does not follow, that
    reports a fault, or that falls silent ends it, as does Ctrl-C: joints stay where they are, and
    the torque is as it was before. All that was measured is kept beside OUTPUT.

    \b
    Example, an arm of six virtual servos, then a plan for them that is played:
        request-planner calibrate --bus virtual --ids 1-6 --yes -o arm.toml
        request-planner plan path.csv --model arm.toml -o requests.csv
        request-planner play requests.csv --bus virtual --model arm.toml -o log.csv
    """  # noqa: D301
    from planner.files.joint_model import BUS, models_text
    from planner.report.calibration_text import (
        calibration_page,
        calibration_results,
        calibration_text,
        servos_text,
    )
    from planner.report.identification_text import REMARKS, model_comments
    from planner.robot import calibration
    from planner.robot.arm import Arm, Servo, servos_of

    ids = servos.ids_by_joint(port, ids)
    joints = _chosen(joint, ids)
    zeros: dict[str, int] = dict(zero_tick)
    folder = Path(output).with_name(f"{Path(output).stem}_logs")
    results: dict[str, Compared] = {}
    with servos.open_bus(port, ids) as bus:
        zero, turn = zeros.pop("", bus.protocol.middle), bus.protocol.ticks_per_turn
        arm = Arm(bus, servos_of(ids, Servo(zero_tick=zero, ticks_per_turn=turn), zeros, reverse))
        with Progress() as progress:
            progress("asking the servos")
            checked = calibration.check(arm)
        period = 1.0 / rate_hz
        summarise(servos_text(checked, period))
        for name, noise in checked.noise.items():
            if noise > math.radians(0.5):
                varies = f"{name}: its angle varies by {math.degrees(noise):.2f} deg at rest"
                warn(f"{varies}; is something moving it?")
        busy = 0.5  # largest share of the time between requests that a tick may take on the bus
        if checked.tick_time > busy * period:
            most, rate = 1e3 * busy * period, busy / checked.tick_time
            raise click.UsageError(
                f"--rate-hz: a tick takes {1e3 * checked.tick_time:.2g} ms on this bus, expected "
                f"at most {most:.2g}; choose {rate:.0f} Hz or less."
            )
        ranges = calibration.servo_ranges(arm, checked.angles, math.radians(reach_deg))
        if not (yes or dry_run):
            ranges = _asked_ranges(arm, ranges)
        arm = calibration.with_ranges(arm, ranges)
        tests = 32.0  # of a joint, with the ways to their beginnings [s]
        seconds = len(joints) * (duration_s + tests)
        earlier = [name for name in joints if Path(folder, f"{name}.csv").exists()]
        if earlier and not resume:
            warn(
                f"{folder} has logs of {', '.join(earlier)} by an earlier calibration, which new "
                "ones replace: move the folder to keep them, or take them with --resume"
            )
        remark(
            f"each of {', '.join(joints)} will move within its range, one after the other, for "
            f"{seconds / 60.0:.1f} min in all; Ctrl-C stops it; logs go to {folder}"
        )
        if dry_run:
            return None
        if not yes:
            _asked(click.confirm, "Is the way free, and may they move?", abort=True)
        advice = f"what was measured is in {folder}; go on with --resume"
        with servos.stopping(advice), arm.powered():
            for name in joints:
                with Progress() as progress, about(name):
                    results[name] = calibration.calibrate(
                        arm,
                        name,
                        period=period,
                        duration=duration_s,
                        folder=folder,
                        resume=resume,
                        progress=progress,
                    )
                text = models_text(  # bus, models and servos; other joints of the file stay
                    {name: each.model for name, each in results.items()},
                    beside=output,
                    remarks=REMARKS,
                    about=model_comments({n: each.identification for n, each in results.items()}),
                    servos={
                        name: replace(arm.servos[name], settings=checked.settings[name])
                        for name in results
                    },
                    bus={name: port[name] for name in BUS if port[name]},
                )
                write_text(output, text)

    origins = [("bus", port["bus"]), ("port", port["port"]), ("logs", str(folder))]
    return Answer(
        calibration_results(results, arm.servos, checked.tick_time),
        calibration_text(results, output),
        page=lambda: calibration_page(results, output),
        origins=[*filter(all, origins), ("rate", f"{rate_hz:g} Hz")],
        linked=[("models", output)],
    )


def _chosen(chosen: tuple[str, ...], joints: Iterable[str]) -> tuple[str, ...]:
    """The joints of --joint, which are among these; all of them by default."""
    for name in chosen:
        if name not in joints:
            raise click.UsageError(f"--joint: got {name}, expected one of {', '.join(joints)}.")
    return chosen or tuple(joints)


def _asked(ask: Callable[..., Any], question: str, **more: Any) -> Any:
    """The answer to a question; where standard input ends before it, what to do."""
    try:
        return ask(question, err=True, **more)
    except click.Abort as error:
        if isinstance(error.__context__, EOFError):
            click.echo(err=True)
            raise InvalidInput("standard input: no answer; --yes asks no questions") from None
        raise


def _asked_ranges(arm: Arm, ranges: dict[str, Any]) -> dict[str, Any]:
    """These ranges [rad], or those that a hand shows, as the user chooses."""
    from planner.robot.calibration import ranges_by_hand

    spans = ", ".join(
        f"{name} {math.degrees(low):.0f}:{math.degrees(high):.0f}"
        for name, (low, high) in ranges.items()
    )
    click.echo(f"Ranges [deg]: {spans}", err=True)
    answer = _asked(
        click.prompt,
        "Enter to keep them, or h to show them by hand (the torque goes off: hold the arm)",
        type=click.Choice(["", "h"]),
        default="",
        show_choices=False,
        show_default=False,
    )
    if answer != "h":
        return ranges
    for servo in arm.servos.values():
        arm.bus.write(servo.id, "torque", 0)
    click.echo("Turn every joint to both ends of its range, then press Enter.", err=True)

    def ended() -> bool:
        return bool(select.select([sys.stdin], [], [], 0.0)[0]) and sys.stdin.readline() is not None

    return ranges_by_hand(arm, ended, 0.02)


@options.command()
def check(
    *,
    port: Mapping[str, Any] = servos.bus_options(
        "The models and servos of the joints, as calibrate writes them."
    ),
    joint: tuple[str, ...] = option("Check this joint only.", otherwise="all"),
    duration_s: Positive = option("How long each joint moves.", default=20.0),
    rate_hz: Positive | None = option("Requests per second.", otherwise="those of the model"),
) -> Answer:
    """Move each joint briefly, and say whether its model still holds and what has changed.

    A battery, wear or a load changes a joint. The exit status is 1 where a model no longer holds.
    It holds up to the largest error that its own test expects. Parts of the motion that are beyond
    the logs of the calibration are not compared; where all of it is, or a new model of the motion
    is hardly better, a large error is no verdict.

    \b
    Example:
        request-planner check --bus virtual --model arm.toml
    """  # noqa: D301
    from tempfile import TemporaryDirectory

    from planner.files.joint_model import read_model_file, read_servos
    from planner.report.calibration_text import recheck_answer
    from planner.report.wording import UNITS
    from planner.robot import calibration

    document, lines, outdated = {}, [], []
    joints = _chosen(joint, read_servos(port["model"]))
    models = dict(zip(joints, read_model_file(port["model"]).for_joints(joints), strict=True))
    for name, joint_model in models.items():
        if joint_model.evidence is None or math.isnan(joint_model.evidence.error):
            raise InvalidFile(
                port["model"],
                f"[{name}] has no expected_error to compare with; calibrate the joint first",
            )
    with (
        servos.open_arm(port, advice="nothing was changed") as arm,
        TemporaryDirectory() as folder,
        Progress() as progress,
    ):
        settings = calibration.check(arm).settings
        with arm.powered():
            for name in joints:
                progress(f"{name}: moving, {duration_s:g} s")
                period = models[name].period if rate_hz is None else 1.0 / rate_hz
                twice = calibration.excitation(arm, name, period=period, duration=2.0 * duration_s)
                requests = twice[: (len(twice) + 1) // 2]  # as slow as a calibration of twice that
                log = calibration.move(
                    arm, name, requests, period=period, log=Path(folder, "log.csv")
                )
                progress(f"{name}: comparing")
                if models[name].unit == "1":
                    low, high = arm.servos[name].limits
                    requests, angles = (
                        (each - low) / (high - low) for each in (log.requests, log.angles)
                    )
                    log = replace(log, unit="1", requests=requests, angles=angles)
                result = calibration.recheck(models[name].requested_every(period), log)
                registers = arm.servos[name].settings, settings[name]
                unit = UNITS[log.unit]
                document[name], line = recheck_answer(name, result, *registers, unit)
                lines.append(line)
                if result.holds is False:
                    outdated.append(name)
    failure = f"calibrate {', '.join(outdated)} again" if outdated else ""
    return Answer({"joints": document}, "\n".join(lines), failure=failure)
