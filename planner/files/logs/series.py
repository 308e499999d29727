"""Angles over time as the messages of one topic tell them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.trajectory import Array

MOST_COMPARED = 1000
"""Messages of which the stamps are compared with the receipt."""


class Series(NamedTuple):
    """One joint's angles over time.

    Attributes:
        stamps: When [ns], shape (n,), in the order of receipt.
        values: Angles, shape (n,).
    """

    stamps: npt.NDArray[np.int64]
    values: Array


class _Rows(NamedTuple):
    """Of every message that tells of a joint: receipt [ns], stamp [ns] and angle."""

    received: array[int]
    stamps: array[int]
    values: array[float]


@dataclass
class Track:
    """What one topic tells of the joints, as it is gathered.

    Attributes:
        topic: The topic.
        stamped: Whether every message had a stamp.
    """

    topic: str
    stamped: bool = True
    _by_joint: dict[str, _Rows] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints, in the order in which they appeared."""
        return tuple(self._by_joint)

    def add(
        self, received: int, stamp: int, joints: Sequence[str], angles: Iterable[float]
    ) -> None:
        """Add a message that was received and stamped [ns]; 0 is no stamp."""
        self.stamped = self.stamped and stamp > 0
        for joint, angle in zip(joints, angles, strict=True):
            rows = self._by_joint.get(joint)
            if rows is None:
                rows = self._by_joint[joint] = _Rows(array("q"), array("q"), array("d"))
            rows.received.append(received)
            rows.stamps.append(stamp)
            rows.values.append(angle)

    def lead(self) -> float:
        """How far the stamps are ahead of the receipt [ns], in the median."""
        leads = [
            stamp - received
            for rows in self._by_joint.values()
            for stamp, received in zip(
                rows.stamps[:MOST_COMPARED], rows.received[:MOST_COMPARED], strict=True
            )
        ]
        return float(np.median(leads)) if leads else 0.0

    def series(self, joint: str, *, stamped: bool) -> Series:
        """A joint's angles, at their stamps or as they were received."""
        rows = self._by_joint[joint]
        return Series(
            np.array(rows.stamps if stamped else rows.received, dtype=np.int64),
            np.array(rows.values),
        )
