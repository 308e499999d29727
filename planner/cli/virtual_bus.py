"""``request-planner virtual-bus``: servos to try with, behind a pseudo-terminal."""

from __future__ import annotations

import re
from typing import Any

import click

from planner.cli import types
from planner.cli.buses import KINDS

TIMED = ("stall", "overheat", "saturate")
"""Faults of a single servo, from a given time on."""


def _fault(text: str) -> tuple[str, int, float]:
    """A fault, its servo (0 for the bus), and its share or time."""
    kind, _, value = text.partition("=")
    if kind in ("drop", "disconnect", "power-off"):
        number = types.finite(value)
        if number < 0.0 or (kind == "drop" and number > 1.0):
            raise ValueError
        return kind, 0, number
    if kind not in TIMED or not (parts := re.fullmatch(r"(\d{1,3})@(.+)", value)):
        raise ValueError
    return kind, int(parts[1]), types.finite(parts[2])


FAULT = types.Parsed(
    _fault,
    "drop=SHARE, disconnect=S, power-off=S, or stall, overheat or saturate=ID@S, such as stall=3@5",
)


@click.command()
@click.option(
    "--servos",
    type=click.IntRange(1, 32),
    default=6,
    metavar="N",
    help="Servos, with the identifiers 1 to N.",
)
@click.option(
    "--protocol",
    type=click.Choice(["feetech", "dynamixel", "xl320"]),
    help="What they speak.  [default: feetech, or that of the kind]",
)
@click.option(
    "--kind",
    type=click.Choice(KINDS),
    help="What they are.  [default: sts3215, xl430 or xl-320, by the protocol]",
)
@click.option(
    "--step-ms",
    type=types.above_0("milliseconds"),
    metavar="MS",
    help="Lock step: so much time passes from one sync write to the next, however long it takes.  "
    "[default: real time]",
)
@click.option(
    "--fault",
    "faults",
    type=FAULT,
    multiple=True,
    metavar="FAULT",
    help="drop=0.05 (of the packets), disconnect=10 (seconds from now), power-off=10, stall=3@5 "
    "(servo 3 after 5 s), overheat=3@5, saturate=3@5 (its supply sags); several times for several.",
)
def virtual_bus(
    *,
    servos: int,
    protocol: str | None,
    kind: str | None,
    step_ms: float | None,
    faults: tuple[tuple[str, int, float], ...],
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
    from planner.virtual.servo_bus import Faults, VirtualServos, serve, terminal

    protocols = {name: each.protocol.name for name, each in servo_bus.KINDS.items()}
    if kind is None:
        kind = next(name for name, each in protocols.items() if each == (protocol or each))
    elif protocol not in (None, protocols[kind]):
        raise click.UsageError(
            f"--protocol: got {protocol}, but --kind {kind} is {protocols[kind]}."
        )
    fault_settings: dict[str, Any] = {kind: {} for kind in TIMED}
    for fault, servo, value in faults:
        if fault not in TIMED:
            fault_settings[fault.replace("-", "_")] = value
        elif servo in range(1, servos + 1):
            fault_settings[fault][servo] = value
        else:
            raise click.UsageError(f"--fault: got servo {servo}, expected 1 to {servos}.")
    virtual_servos = VirtualServos(
        servos,
        servo_bus.KINDS[kind],
        faults=Faults(**fault_settings),
        step=None if step_ms is None else 1e-3 * step_ms,
    )
    virtual_servos.run(0.01)  # compiles its functions before a program waits for answers
    with terminal() as (end, path):
        click.echo(path)
        serve(virtual_servos, end)
