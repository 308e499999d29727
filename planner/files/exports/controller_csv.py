"""CSV at a controller's rate: time, and every joint in angles, a servo's ticks or microseconds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.files.clock import TIME
from planner.files.table import DECIMALS, csv_text, write_table
from planner.files.text import write_text
from planner.files.units import ANGLES
from planner.robot.schedule import Schedule
from planner.validation import shown

UNITS = (*ANGLES, "ticks", "us")
"""Units of the columns, which are also the ends of their names."""

PULSES = (500, 2500)
"""Shortest and longest pulse of a hobby servo [us]."""

MOST_TICKS = 2**31
"""Most ticks of a turn: counters have 32 bits."""


@dataclass(frozen=True)
class Ticks:
    """How a servo counts its angle: in ticks, or a hobby servo in microseconds of its pulses.

    Attributes:
        per_turn: Ticks of a full turn.
        zero: The tick at angle 0, of every joint.
        zeros: Zero ticks of single joints, by name.
        reversed: Joints whose servo is mounted the other way round.
        unit: "ticks" or "us".
    """

    per_turn: int = 4096
    zero: int = 2048
    zeros: Mapping[str, int] = field(default_factory=dict)
    reversed: Sequence[str] = ()
    unit: str = "ticks"

    @property
    def range(self) -> tuple[int, int]:
        """Least and largest tick that a servo takes."""
        return PULSES if self.unit == "us" else (0, self.per_turn - 1)

    def __post_init__(self) -> None:
        if not 2 <= self.per_turn <= MOST_TICKS:
            raise InvalidInput(
                f"ticks per turn: got {shown(self.per_turn)}, expected 2 to {MOST_TICKS}"
            )


def write_controller_csv(
    path: Path | str, schedule: Schedule, *, unit: str = "rad", ticks: Ticks | None = None
) -> None:
    """Write ``t_s`` and one ``<joint>_<unit>`` column per joint; ``-`` is standard output.

    Raises:
        InvalidInput: A unit not in :data:`UNITS`, or requests beyond a servo's turn.
        InvalidFile: The file cannot be written.
    """
    names = [TIME, *(f"{name}_{unit}" for name in schedule.names)]
    if unit in ANGLES:
        angles = schedule.requests / ANGLES[unit]
        write_table(path, names, np.column_stack([schedule.times, angles]))
        return
    if unit not in UNITS:
        raise InvalidInput(f"unit: got '{unit}', expected {', '.join(UNITS)}")
    times = np.round(schedule.times, DECIMALS).tolist()
    rows = zip(times, to_ticks(schedule, ticks or Ticks()).tolist(), strict=True)
    write_text(path, csv_text(names, ([time, *row] for time, row in rows)))


def to_ticks(schedule: Schedule, ticks: Ticks) -> npt.NDArray[np.int64]:
    """The nearest tick to every request, shape (n, k).

    Raises:
        InvalidInput: A zero for an unknown joint, or a request outside a turn.
    """
    check_zeros(schedule, ticks)
    zeros = np.array([ticks.zeros.get(name, ticks.zero) for name in schedule.names])
    signs = np.array([-1.0 if name in ticks.reversed else 1.0 for name in schedule.names])
    counted = np.rint(zeros + signs * schedule.requests * (ticks.per_turn / (2.0 * math.pi)))
    least, most = ticks.range
    beyond = np.argwhere((counted < least) | (counted > most))
    if beyond.size:
        k, j = beyond[0]
        raise InvalidInput(
            f"{schedule.names[j]}: request {k}, {np.degrees(schedule.requests[k, j]):.2f} deg, is "
            f"{_NAMES[ticks.unit].format(counted[k, j])}, expected {least} to {most}; check the "
            "zero tick, the ticks per turn and the direction"
        )
    return counted.astype(np.int64)


_NAMES = {"ticks": "tick {:.0f}", "us": "a pulse of {:.0f} us"}


def check_zeros(schedule: Schedule, ticks: Ticks) -> None:
    """Make sure that every joint with its own zero or direction exists.

    Raises:
        InvalidInput: One does not.
    """
    for key, names in (("zero tick", ticks.zeros), ("reverse", ticks.reversed)):
        for name in names:
            if name not in schedule.names:
                raise InvalidInput(f"{key}: no joint '{name}'; joints: {', '.join(schedule.names)}")
