"""``request-planner record``: a log of servos that something else moves, or a hand."""

from __future__ import annotations

from typing import Any

import click

from planner.cli import buses, types
from planner.cli.console import summarise


@click.command()
@buses.bus_options()
@buses.model_option("The servos of the joints, as calibrate writes them.")
@click.option(
    "--rate-hz",
    type=types.above_0("hertz"),
    default=50.0,
    metavar="HZ",
    help="Rows per second.",
)
@click.option(
    "--duration-s",
    type=types.above_0("seconds"),
    metavar="S",
    help="How long.  [default: until Ctrl-C]",
)
@click.option(
    "--by-hand",
    is_flag=True,
    help="Switch the torque off first, and write a path of the angles alone, which plan takes; a "
    "row in which a servo did not answer is left out.",
)
@click.option("-o", "--output", type=types.OUTPUT, default="log.csv", help="The log.")
def record(
    *,
    model: str,
    rate_hz: float,
    duration_s: float | None,
    by_hand: bool,
    output: str,
    **choices: Any,
) -> None:
    """Log requested and actual angles while something else moves the servos, or a hand does.

    Nothing is requested. What was requested is read from the servos, by one sync read more.

    \b
    Example, a motion that a hand shows, at twice its speed:
        request-planner record --bus feetech --port /dev/ttyACM0 --model arm.toml --by-hand \\
            -o shown.csv
        request-planner plan shown.csv --no-cyclic --model arm.toml --speed 2 --rate-hz 50 \\
            -o requests.csv
    """  # noqa: D301
    from contextlib import suppress

    import numpy as np

    from planner.files.joint_model import read_servos
    from planner.files.paths import GrowingLog

    servos = read_servos(model)
    kinds = ("",) if by_hand else ("requested", "actual")
    with (
        buses.open_arm(choices, servos, model) as arm,
        GrowingLog(output, list(servos), kinds=kinds) as log,
        buses.stopping(f"the log until then is {log.unfinished}"),
    ):
        if by_hand:
            for servo in servos.values():
                arm.bus.write(servo.id, "torque", 0)
        port, begin, row = arm.bus.port, arm.bus.port.now(), 0
        last_read = np.full(len(servos), begin)
        with suppress(KeyboardInterrupt):  # the end, where no duration is set
            while duration_s is None or row / rate_hz < duration_s:
                wait = begin + row / rate_hz - port.now()
                if wait > 0.0:
                    port.sleep(wait)
                measured = arm.measure()
                columns = [measured.angles] if by_hand else [arm.goals(), measured.angles]
                if not (by_hand and np.isnan(measured.angles).any()):
                    log.keep(measured.time - begin, *columns)
                last_read[np.isfinite(measured.angles)] = measured.time
                arm.check_heard(last_read, measured.time)
                row = max(row + 1, int((port.now() - begin) * rate_hz))
        log.finish()
    lost = arm.bus.lost / max(1, arm.bus.asked)
    summarise(f"{log.rows} rows of {', '.join(servos)} in {output}; {lost:.1%} of answers lost")
