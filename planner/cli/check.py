"""``request-planner check``: whether the models of calibrated servos still hold."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from planner.cli import buses, options, types
from planner.cli.console import Progress, print_answer
from planner.exceptions import InvalidFile

if TYPE_CHECKING:
    from planner.identification.log import Log
    from planner.identification.result import Identification
    from planner.model.joint import JointModel

WORSE = 2.0
"""A model still holds while it misses the motion by at most this factor over its own test, by
:data:`SMALL`, or by at most this factor over rows that a model of this motion had not seen."""

SMALL = math.radians(0.3)
"""Error that is never worth a new calibration [rad]: three counts of a sensor of 12 bits."""

UNKNOWN = 0.1
"""Share by which a parameter without an interval may be off."""

PHYSICAL = ("v_max", "theta_0", "lag", "dead_band", "offset")
"""The parameters whose change is reported."""


@click.command()
@buses.bus_options()
@buses.model_option("The models and servos of the joints, as calibrate writes them.")
@click.option(
    "--joint",
    "chosen",
    multiple=True,
    metavar="NAME",
    help="Check this joint only.  [default: all]",
)
@click.option(
    "--duration-s",
    type=types.above_0("seconds"),
    default=20.0,
    metavar="S",
    help="How long each joint moves.",
)
@click.option(
    "--rate-hz",
    type=types.above_0("hertz"),
    metavar="HZ",
    help="Requests per second.  [default: those of the model]",
)
@options.as_json
def check(
    *,
    model: str,
    chosen: tuple[str, ...],
    duration_s: float,
    rate_hz: float | None,
    as_json: bool,
    **choices: Any,
) -> None:
    """Move each joint briefly, and say whether its model still holds and what has changed.

    A battery, wear or a load changes a joint. The exit status is 1 where a model no longer holds.

    \b
    Example:
        request-planner check --bus virtual --model arm.toml
    """  # noqa: D301
    from tempfile import TemporaryDirectory

    from planner.calibration.measure import check as look
    from planner.calibration.measure import excitation, move
    from planner.files.joint_model import read_model_file, read_servos
    from planner.identification.identify import identify

    servos = read_servos(model)
    joints = chosen or tuple(servos)
    for name in joints:
        if name not in servos:
            raise click.UsageError(f"--joint: got {name}, expected one of {', '.join(servos)}.")
    models = dict(zip(joints, read_model_file(model).for_joints(joints), strict=True))
    befores = {
        name: _error_before(model, name, joint_model) for name, joint_model in models.items()
    }
    document, lines, outdated = {}, [], []
    with (
        buses.open_arm(choices, servos, model) as arm,
        TemporaryDirectory() as folder,
        Progress() as progress,
        buses.stopping("nothing was changed"),
    ):
        checked = look(arm)
        with arm.powered():
            for name in joints:
                progress(f"{name}: moving, {duration_s:g} s")
                period = models[name].period if rate_hz is None else 1.0 / rate_hz
                requests = excitation(arm, name, period=period, duration=duration_s)
                log = move(arm, name, requests, period=period, log=Path(folder, "log.csv"))
                before = befores[name]
                error = _error(models[name].requested_every(period), log)
                holds = error <= max(WORSE * before, SMALL)
                changes = _settings_changed(servos[name].settings, checked.settings[name])
                if not holds:
                    progress(f"{name}: identifying")
                    identification = identify(log)
                    reference = (
                        identification.rms
                        if identification.held_out_rms is None
                        else identification.held_out_rms
                    )
                    holds = error <= WORSE * reference  # the motion is hard for any model
                    if not holds:
                        changes += _changes(models[name], identification)
                        outdated.append(name)
                verdict = "holds" if holds else "no longer holds"
                document[name] = {
                    "holds": holds,
                    "rms_deg": math.degrees(error),
                    "rms_before_deg": math.degrees(before),
                    "changes": changes,
                }
                lines.append(
                    f"{name}: the model {verdict}: misses {math.degrees(error):.2f} deg rms, "
                    f"{math.degrees(before):.2f} when it was calibrated"
                    + "".join(f"; {change}" for change in changes)
                )
    print_answer({"joints": document}, "\n".join(lines), as_json=as_json)
    if outdated:
        raise click.ClickException(f"calibrate {', '.join(outdated)} again")


def _error(model: JointModel, log: Log) -> float:
    """How far the model misses the measured angles, rms [rad]; a servo holds its last request."""
    import numpy as np

    from planner.model.response import simulate

    due = np.rint((log.times - log.times[0]) / model.period).astype(int)
    requests = log.requests[np.searchsorted(due, np.arange(due[-1] + 1), side="right") - 1]
    predicted = simulate(model, requests, cyclic=False, start=float(log.angles[0]))[due]
    return float(np.sqrt(np.mean((predicted - log.angles)[log.measured] ** 2)))


def _error_before(path: str, name: str, model: JointModel) -> float:
    """The test error in a model file, rms [rad]."""
    error = math.nan if model.evidence is None else model.evidence.error
    if math.isnan(error):
        raise InvalidFile(
            path, f"[{name}] has no expected_error to compare with; calibrate the joint first"
        )
    return error


def _settings_changed(before: Any, now: Any) -> list[str]:
    """Registers that have changed since the calibration."""
    from planner.robot.arm import SETTINGS

    return [
        f"{words} is {now[key]}, and was {before[key]}"
        for key, words in SETTINGS.items()
        if key in before and key in now and before[key] != now[key]
    ]


def _changes(model: JointModel, identification: Identification) -> list[str]:
    """Parameters of a new model that differ by more than both intervals allow."""
    intervals = {} if model.evidence is None else model.evidence.intervals
    changes = []
    for name in PHYSICAL:
        if name not in identification.intervals:
            continue
        old, new = getattr(model, name), getattr(identification.model, name)
        low, high = intervals.get(name, (old - UNKNOWN * abs(old), old + UNKNOWN * abs(old)))
        interval = identification.intervals[name]
        if interval.lower > high or interval.upper < low:
            changes.append(f"{name} is {new:.3g}, and was {old:.3g}")
    return changes
