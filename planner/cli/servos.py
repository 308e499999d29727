"""``request-planner play``, ``record`` and ``virtual-bus``, and options of all that move servos."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import click

from planner.cli import options
from planner.cli.console import Answer, complain, remark, summarise, warn
from planner.cli.declared import Count, Positive, Source, argument, option
from planner.exceptions import BusError, InvalidFile, InvalidInput, in_degrees
from planner.files.text import within
from planner.robot import EXPECTED_BUS, KINDS, bus_name

if TYPE_CHECKING:
    from planner.arrays import Array
    from planner.files.paths import SampledPath
    from planner.robot.arm import Arm, Servo
    from planner.robot.bus import Bus


def bus_options(model: str = "") -> Any:
    """The options of :func:`open_bus`, or with a help of ``model`` those of :func:`open_arm`."""
    by_file = "that of the model file" if model else ""
    bus = "What the servos speak: feetech, dynamixel (protocol 2.0: X series, MX) or xl320; "
    bus += "lerobot:ROBOT, such as lerobot:so101, is a robot by LeRobot's own classes; virtual are "
    bus += f"simulated servos, here and at once, as is virtual:KIND of {', '.join(KINDS)}."
    name = options.Parsed(bus_name, "BUS", EXPECTED_BUS)
    rate = Annotated[int | None, within("a whole number from 9600 on", ge=9600)]
    usual = f"{by_file}, else 1000000" if model else "1000000"
    file = {"model": (Source, option(model))} if model else {}
    return options.group(
        bus=(Annotated[str | None if model else str, name], option(bus, otherwise=by_file)),
        port=(str | None, option("The serial port, such as /dev/ttyACM0.", form="P")),
        baud_rate=(rate, option("Bits per second.", otherwise=usual)),
        **file,
    )


def _ids(text: str) -> dict[str, int]:
    """Identifiers by joint: 1-6, or pan=1,lift=2."""
    ids: dict[str, int] = {}
    for part in text.split(","):
        if equals := re.fullmatch(r"\s*([^=]+)=\s*(\d{1,3})\s*", part):
            named = {equals[1].strip(): int(equals[2])}
        elif ends := re.fullmatch(r"\s*(\d{1,3})(?:-(\d{1,3}))?\s*", part):
            first, last = int(ends[1]), int(ends[2] or ends[1])
            named = {f"joint_{each}": each for each in range(first, last + 1)}
        else:
            raise ValueError
        if not named or ids.keys() & named.keys():
            raise ValueError
        ids |= named
    if max(ids.values()) > 252 or len(set(ids.values())) < len(ids):
        raise ValueError
    return ids


def ids_by_joint(choices: Mapping[str, Any], ids: Mapping[str, int]) -> Mapping[str, int]:
    """Identifiers by joint; servos of a LeRobot robot take its joint names by default."""
    kind, _, which = choices["bus"].partition(":")
    if kind != "lerobot":
        return ids
    from planner.robot.bus import robot_of

    joint_names = {motor.id: joint for joint, motor in robot_of(which, "").bus.motors.items()}
    return {
        joint_names.get(servo, name) if name == f"joint_{servo}" else name: servo
        for name, servo in ids.items()
    }


IDS = options.Parsed(_ids, "IDS", "identifiers of servos, such as 1-6 or pan=1,lift=2, each once")


@contextmanager
def open_bus(choices: Mapping[str, Any], ids: Mapping[str, int]) -> Iterator[Bus]:
    """The bus that the options name, in the block; a virtual one has servos 1 to the largest."""
    from planner.robot.bus import Bus, SerialPort
    from planner.robot.protocols import PROTOCOLS

    (kind, _, which), path = choices["bus"].partition(":"), choices["port"]
    if kind == "virtual":
        if path is not None:
            raise click.UsageError("--port has no effect with --bus virtual; leave it out.")
        from planner.virtual import servo_bus

        servo_kind = servo_bus.KINDS[which or KINDS[0]]
        servos = servo_bus.VirtualServos(max(1, *ids.values()), servo_kind)
        yield Bus(servo_bus.VirtualPort(servos), servo_kind.protocol)
        return
    if path is None:
        raise click.UsageError(f"--bus {kind} needs --port, such as --port /dev/ttyACM0.")
    if kind == "lerobot":
        from planner.robot.bus import lerobot_bus

        with lerobot_bus(which, path) as bus:
            yield bus
        return
    with closing(SerialPort(path, choices["baud_rate"] or 1_000_000)) as port:
        yield Bus(port, PROTOCOLS[kind])


@contextmanager
def open_arm(
    choices: Mapping[str, Any], joints: Sequence[str] | None = None, *, advice: str
) -> Iterator[Arm]:
    """Joints of a model file, by default all, on the bus of the options, or else of the file.

    The ``advice`` follows where Ctrl-C or a fault ends the block.
    """
    from planner.files.joint_model import read_bus, read_servos
    from planner.robot.arm import Arm

    model = choices["model"]
    servos, own = read_servos(model, joints), {} if choices["bus"] else read_bus(model)
    if not (choices["bus"] or "bus" in own):
        raise click.UsageError(
            f"{model} does not name the bus of its servos: name it with --bus, such as --bus "
            "feetech --port /dev/ttyACM0."
        )
    choices = {**choices, **{key: choices[key] or each for key, each in own.items()}}
    ids = {name: servo.id for name, servo in servos.items()}
    with open_bus(choices, ids) as bus, stopping(advice):
        yield Arm(bus, servos)


def in_servos(servos: Mapping[str, Servo], path: SampledPath) -> tuple[Array, Array, Array]:
    """Angles of the requests to servos [rad], (n, k), at the value 0, and per value, (k,); checked.

    The range of a joint in shares of it is that of its servo, from one limit to the other. Requests
    beyond it, as a plan makes them for a joint that sags, are clipped up to a twentieth of it.
    """
    import numpy as np

    from planner.files.columns import SHARES, shown_units
    from planner.robot.arm import check_ranges

    whole, values, scales = SHARES["range"], path.values.copy(), list[tuple[float, float]]()
    for j, (name, unit) in enumerate(shown_units(path.names, path.units).items()):
        low, high = limits = servos[name].limits
        scale = 0.0, 1.0
        if unit == "percent":
            inside = np.clip(values[:, j], 0.0, whole)
            most = math.degrees(np.max(np.abs(values[:, j] - inside)))
            ends = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg"
            more = f"; requests beyond, by up to {most:.2g} %, are clipped"
            more = more if 0.01 < most <= 5.0 else ""
            remark(f"{name}: 0 to 100 % of its range are {ends}, the limits of its servo{more}")
            limits, scale = (0.0, whole), (low, (high - low) / whole)
            values[:, j] = inside if most <= 5.0 else values[:, j]
        scales.append(scale)
        try:
            check_ranges({name: limits}, values[:, [j]])
        except InvalidInput as error:
            raise InvalidInput(in_degrees(error, unit)) from error
    zeros, factors = np.transpose(scales)
    return zeros + factors * values, zeros, factors


@contextmanager
def stopping(advice: str) -> Iterator[None]:
    """Report Ctrl-C or a bus fault in the block in one line; the bus is already stopped."""
    try:
        yield
    except KeyboardInterrupt as stop:
        complain(f"stopped by Ctrl-C: the joints stay where they are, torque as before; {advice}")
        raise click.exceptions.Exit(130) from stop
    except BusError as error:
        raise BusError(f"{error}; {advice}") from error


@options.command()
def play(
    *,
    requests: Source = argument(),
    port: Mapping[str, Any] = bus_options(
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
    before anything moves; those in shares of the range are clipped if they are at most 5 % beyond.
    Ctrl-C, a fault or a silent servo stops the motion: the joints stay where they are, the torque
    is as it was before, and the log has every row until then.

    \b
    Example, a plan, its motion, and the next requests after learning from it:
        request-planner plan path.csv --model arm.toml -o requests.csv
        request-planner play requests.csv --bus virtual --model arm.toml --measured measured.csv
        request-planner refine requests.csv measured.csv --desired path.csv --model arm.toml
    """  # noqa: D301
    import numpy as np

    from planner.files.columns import shown_units
    from planner.files.paths import growing_log, read_joint_path, write_joint_path

    path = read_joint_path(requests)
    if path.times is None:
        raise InvalidFile(requests, "no column t_s, so no time between requests; add it")
    period, rows = path.step, list["tuple[float, Array]"]()
    log = growing_log(output, path.names, units=shown_units(path.names, path.units))
    advice = f"the log until then is {output}.part"
    with open_arm(port, path.names, advice=advice) as arm, log as write_row:
        angles, zeros, factors = in_servos(arm.servos, path)

        def keep(time: float, row: Array, angles: Array) -> None:
            measured = (angles - zeros) / factors
            write_row(time, (row - zeros) / factors, measured)
            rows.append((time, measured))

        with arm.powered():
            performance = arm.perform(angles, period=period, cycles=cycles, keep=keep)
            if performance.interrupted:
                raise KeyboardInterrupt
    count = cycles * len(path.values)
    times, angles = np.array([time for time, _ in rows]), np.array([each for _, each in rows])
    if measured is not None:
        from planner.robot.calibration import by_request  # with the identification of joints

        actual, units = by_request(times, angles, count, period), path.units
        write_joint_path(measured, path.names, actual, period=period, units=units)
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
    port: Mapping[str, Any] = bus_options("The servos of the joints, as calibrate writes them."),
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
        open_arm(port, advice=advice) as arm,
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


def _fault(text: str) -> tuple[str, int, float]:
    """A fault, its servo (0 for the bus), and its share or time."""
    parts = re.fullmatch(
        r"(drop|disconnect|power-off)=(.+)|(stall|overheat|saturate)=(\d{1,3})@(.+)", text
    )
    if parts is None:
        raise ValueError
    kind, number = parts[1] or parts[3], float(parts[2] or parts[5])
    most = 1.0 if kind == "drop" else math.inf
    if not math.isfinite(number) or (parts[1] and not 0.0 <= number <= most):
        raise ValueError
    return kind, int(parts[4] or 0), number


FAULT = options.Parsed(
    _fault,
    "FAULT",
    "drop=SHARE, disconnect=S, power-off=S, or stall, overheat or saturate=ID@S, such as stall=3@5",
)


@options.command(answers=False)
def virtual_bus(
    *,
    servos: Annotated[int, within(ge=1, le=32)] = option(
        "Servos, with the identifiers 1 to N, at most 32.", default=6
    ),
    kind: Annotated[str, click.Choice(KINDS)] = option(
        "What they are: an sts3215 speaks Feetech's protocol, an xl-320 its own, and the others "
        "Dynamixel 2.0.",
        default=KINDS[0],
    ),
    step_ms: Positive | None = option(
        "Lock step: so much time passes from one sync write to the next, however long it takes.",
        otherwise="real time",
    ),
    fault: Annotated[tuple[tuple[str, int, float], ...], FAULT] = option(
        "drop=0.05 (of the packets), disconnect=10 (seconds from now), power-off=10, stall=3@5 "
        "(servo 3 after 5 s), overheat=3@5, saturate=3@5 (its supply sags). Repeat it for several."
    ),
) -> None:
    """Put moving virtual servos behind a pseudo-terminal, and print the port; Ctrl-C ends it.

    Packets are those of the real protocol, so that any program that talks to such servos can be
    tried, a vendor's SDK included. Behind every identifier a motor moves, with friction, delay and
    load; nothing jumps to its goal.

    \b
    Example, six servos and a calibration of the first:
        request-planner virtual-bus --servos 6
        request-planner calibrate --bus feetech --port /dev/pts/3 --ids 1 -o arm.toml
    """  # noqa: D301
    from planner.virtual import servo_bus

    fault_settings: dict[str, Any] = {}
    for what, servo, value in fault:
        if what in ("drop", "disconnect", "power-off"):
            fault_settings[what.replace("-", "_")] = value
        elif servo in range(1, servos + 1):
            fault_settings.setdefault(what, {})[servo] = value
        else:
            raise click.UsageError(f"--fault: got servo {servo}, expected 1 to {servos}.")
    virtual_servos = servo_bus.VirtualServos(
        servos,
        servo_bus.KINDS[kind],
        faults=servo_bus.Faults(**fault_settings),
        step=None if step_ms is None else 1e-3 * step_ms,
    )
    virtual_servos.run(0.01)  # compiles its functions before a program waits for answers
    with servo_bus.terminal() as (end, path):
        click.echo(path)
        servo_bus.serve(virtual_servos, end)
