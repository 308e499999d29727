"""``request-planner play`` and ``record``: a motion of the servos, and its log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from planner.cli import buses, options
from planner.cli.console import Answer, summarise, warn
from planner.cli.declared import Count, Positive, Source, argument, option
from planner.exceptions import InvalidFile

if TYPE_CHECKING:
    from planner.arrays import Array


@options.command()
def play(
    *,
    requests: Source = argument(),
    port: Mapping[str, Any] = buses.bus_options(
        "The servos of the joints, with zeros and ranges, as calibrate writes them."
    ),
    cycles: Count = option("How often to play them.", default=1),
    measured: options.Output | None = option(
        "Also write the measured angles, a row for each request, as refine takes them."
    ),
    output: options.Output = option(
        "The log of requested and actual angles.", option="-o --output", default="log.csv"
    ),
) -> Answer:
    """Play REQUESTS, as `plan` or `refine` writes them, on servos, and log what the joints do.

    The joints are led slowly to the first request. Requests beyond the range of a joint are refused
    before anything moves. Ctrl-C, a fault or a silent servo stops the motion: the joints stay where
    they are, the torque is as it was before, and the log has every row until then.

    \b
    Example, a plan, its motion, and the next requests after learning from it:
        request-planner plan path.csv --model arm.toml -o requests.csv
        request-planner play requests.csv --bus virtual --model arm.toml --measured measured.csv
        request-planner refine requests.csv measured.csv --desired path.csv --model arm.toml
    """  # noqa: D301
    import numpy as np

    from planner.files.columns import SHARES
    from planner.files.paths import growing_log, read_joint_path, write_joint_path

    path = read_joint_path(requests)
    for name, unit in zip(path.names, path.units, strict=True):
        if unit in SHARES:
            raise InvalidFile(
                requests,
                f"'{name}' is in shares of its range, expected an angle; leave its column out",
            )
    if path.times is None:
        raise InvalidFile(requests, "no column t_s, so no time between requests; add it")
    period, rows = path.step, list["tuple[float, Array]"]()
    log = growing_log(output, path.names)
    advice = f"the log until then is {output}.part"
    with buses.open_arm(port, path.names, advice=advice) as arm, log as write_row:

        def keep(time: float, row: Array, angles: Array) -> None:
            write_row(time, row, angles)
            rows.append((time, angles))

        with arm.powered():
            performance = arm.perform(path.values, period=period, cycles=cycles, keep=keep)
            if performance.interrupted:
                raise KeyboardInterrupt
    count = cycles * len(path.values)
    times, angles = np.array([time for time, _ in rows]), np.array([each for _, each in rows])
    if measured is not None:
        from planner.robot.calibration import by_request  # with the identification of joints

        write_joint_path(
            measured, path.names, by_request(times, angles, count, period), period=period
        )
    lost = int(np.isnan(angles).sum())
    if performance.skipped or lost:
        warn(
            f"{performance.skipped} of {count} requests were not sent in time and {lost} of "
            f"{angles.size} angles were not read; a longer period, or a better cable, helps"
        )
    return Answer(
        {
            "rows": len(rows),
            "requests": count,
            "skipped": performance.skipped,
            "overruns": performance.overruns,
            "latest_s": performance.latest,
            "angles_lost": lost,
            "answers_asked": arm.bus.asked,
            "answers_lost": arm.bus.lost,
        },
        f"{len(rows)} rows of {', '.join(path.names)} in {output}\nplayed: {performance}",
    )


@options.command(answers=False)
def record(
    *,
    port: Mapping[str, Any] = buses.bus_options(
        "The servos of the joints, as calibrate writes them."
    ),
    rate_hz: Positive = option("Rows per second.", default=50.0),
    duration_s: Positive | None = option("How long.", otherwise="until Ctrl-C"),
    by_hand: bool = option(
        "Switch the torque off first, and write a path of the angles alone, which plan takes; a "
        "row in which a servo did not answer is left out."
    ),
    output: options.Output = option("The log.", option="-o --output", default="log.csv"),
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
    import numpy as np

    from planner.files.paths import growing_log
    from planner.robot.play import play as play_at_times

    kinds = ("",) if by_hand else ("requested", "actual")
    advice = f"the log until then is {output}.part"
    with (
        buses.open_arm(port, advice=advice) as arm,
        growing_log(output, list(arm.servos), kinds=kinds) as write_row,
    ):
        if by_hand:
            for servo in arm.servos.values():
                arm.bus.write(servo.id, "torque", 0)
        clock, kept = arm.bus.port, 0
        begin = clock.now()
        last_read = np.full(len(arm.servos), begin)

        def keep(_: Array) -> None:
            nonlocal kept
            measured = arm.measure()
            columns = [measured.angles] if by_hand else [arm.goals(), measured.angles]
            if not (by_hand and np.isnan(measured.angles).any()):
                write_row(measured.time - begin, *columns)
                kept += 1
            last_read[np.isfinite(measured.angles)] = measured.time
            arm.check_heard(last_read, measured.time)

        rows = None if duration_s is None else math.ceil(duration_s * rate_hz)
        play_at_times(
            [0.0], period=1.0 / rate_hz, cycles=rows, send=keep, now=clock.now, sleep=clock.sleep
        )
    lost = arm.bus.lost / max(1, arm.bus.asked)
    summarise(
        f"{kept} rows of {', '.join(arm.servos)} in {output}; {100.0 * lost:.1f} % of answers lost"
    )
