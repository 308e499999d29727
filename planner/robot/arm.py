"""Joints on a bus of servos: radians with a zero and a direction, and a guard on every motion.

A tick is one sync write and one sync read, whatever the number of joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from planner.arrays import Array
from planner.exceptions import BusError, InvalidInput, angle_text
from planner.robot.bus import Bus
from planner.robot.play import Playback, play

Numbers = TypeVar("Numbers", float, Array)

STUCK_ERROR, STUCK_MOTION, STUCK_TIME = math.radians(12.0), math.radians(1.0), 0.7
"""A joint that misses its request by more than the first, and has moved by less than the second
[rad] in the last time [s], does not follow; nor does one that has moved by less than the second for
as long after its requests had a range of twice the first. A loaded servo at a gain of 16 rests up
to 8 degrees off its request."""

SETTINGS = {
    "p_gain": "P",
    "i_gain": "I",
    "d_gain": "D",
    "profile_speed": "profile speed",
    "profile_acceleration": "profile acceleration",
}
"""The settings of a servo that shape its motion, with their labels."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """How a servo turns a joint: angle = direction (count - zero_tick) 2π / ticks_per_turn."""

    id: int = 0  # on the bus
    zero_tick: int = 2048  # count at angle 0
    direction: int = 1  # -1 for a servo that is mounted the other way round
    ticks_per_turn: float = 4096  # counts of a turn
    limits: tuple[float, float] = (-math.pi, math.pi)  # least and largest request [rad]
    settings: Mapping[str, int] = field(default_factory=dict)  # `SETTINGS` at calibration

    def __post_init__(self) -> None:
        if not 0 <= self.id <= 252:
            raise InvalidInput(f"servo: got the identifier {self.id}, expected 0 to 252")
        if self.direction not in (1, -1):
            raise InvalidInput(f"direction: got {self.direction}, expected 1 or -1")
        if not 2 <= self.ticks_per_turn < math.inf:
            raise InvalidInput(f"ticks_per_turn: got {self.ticks_per_turn}, expected 2 or more")
        if not self.limits[0] < self.limits[1]:
            raise InvalidInput(f"limits: got {list(self.limits)}, expected the lower one first")

    def count(self, angle: Numbers) -> Numbers:
        """The count of an angle [rad], or of an array of them, before it is rounded."""
        return self.zero_tick + angle * (self.direction * self.ticks_per_turn / (2.0 * math.pi))

    def angle(self, count: float) -> float:
        """The angle of a count [rad]."""
        turns = (count - self.zero_tick) / self.ticks_per_turn
        return self.direction * 2.0 * math.pi * turns


def servos_of(
    ids: Mapping[str, int], like: Servo, zeros: Mapping[str, int], reversed_: Collection[str]
) -> dict[str, Servo]:
    """Servos of joints by their identifiers, like one but for single zeros and directions."""
    for key, names in (("zero tick", zeros), ("reverse", reversed_)):
        if unknown := [name for name in names if name not in ids]:
            raise InvalidInput(f"{key}: no joint '{unknown[0]}'; joints: {', '.join(ids)}")
    servos = {name: replace(like, id=number) for name, number in ids.items()}
    for name in reversed_:
        servos[name] = replace(servos[name], direction=-1)
    return servos | {name: replace(servos[name], zero_tick=zero) for name, zero in zeros.items()}


class Measured(NamedTuple):
    """Readings of the servos at a tick; one entry per joint."""

    time: float  # when they were read [s], on the port's clock
    angles: Array  # [rad], NaN where none answered
    errors: tuple[int, ...]  # that the answers carried, 0 for none


class Arm:
    """Named joints on a bus."""

    def __init__(self, bus: Bus, servos: Mapping[str, Servo]) -> None:
        """Take a bus and the servos of the joints, of which no two may share one."""
        self.bus, self.servos = bus, dict(servos)
        self.names = tuple(servos)
        self._sent: Array | None = None
        self._ids = [servo.id for servo in servos.values()]
        if len(set(self._ids)) != len(self._ids):
            raise InvalidInput(f"servos: got the identifiers {self._ids}, expected each once")

    def send(self, requests: npt.ArrayLike) -> None:
        """Request an angle of every joint [rad], in one packet; NaN requests nothing of a joint."""
        self._sent = np.array(requests, dtype=float)
        pairs = zip(self.servos.values(), self._sent.tolist(), strict=True)
        counts = {
            servo.id: round(servo.count(angle)) for servo, angle in pairs if math.isfinite(angle)
        }
        self.bus.sync_write("goal", counts)

    def measure(self) -> Measured:
        """The state of every joint, read by one packet."""
        now = self.bus.port.now()
        readings = self.bus.sync_read(self._ids)
        errors = tuple(readings[each]["error"] if each in readings else 0 for each in self._ids)
        return Measured(now, self._angles(readings, "position"), errors)

    def goals(self) -> Array:
        """The last request to every joint, from any sender [rad]; NaN where none answers."""
        return self._angles(self.bus.sync_read(self._ids, ("goal",)), "goal")

    def _angles(self, readings: Mapping[int, Mapping[str, int]], name: str) -> Array:
        """The angles in a register [rad], NaN where a servo did not answer."""
        angles = [
            servo.angle(readings[servo.id][name]) if servo.id in readings else np.nan
            for servo in self.servos.values()
        ]
        return np.array(angles)

    def angles(self, *, silent: bool = False) -> Array:
        """Angle of every joint [rad], read again where an answer was lost.

        A servo that stays silent raises BusError, or has NaN where one may be ``silent``.
        """
        angles = self.measure().angles
        for k in np.flatnonzero(np.isnan(angles)):
            servo = self.servos[self.names[k]]
            try:
                angles[k] = servo.angle(self.bus.read(servo.id, "position"))
            except BusError:
                if not silent:
                    raise
        return angles

    def settings(self) -> dict[str, dict[str, int]]:
        """By joint, those registers that shape its motion and that its servo has."""
        names = [each for each in SETTINGS if each in self.bus.protocol.registers]
        return {
            name: {each: self.bus.read(servo.id, each) for each in names}
            for name, servo in self.servos.items()
        }

    def hold(self) -> None:
        """Stop every joint that answers where it is; one near its last request keeps that."""
        angles = self.angles(silent=True)
        if self._sent is not None:
            near = np.abs(self._sent - angles) < STUCK_ERROR
            angles = np.where(near, self._sent, angles)
        self.send(angles)

    @contextmanager
    def powered(self) -> Iterator[None]:
        """Torque on in the block; afterwards as before, once joints that answer are stopped."""
        before = {servo.id: self.bus.read(servo.id, "torque") for servo in self.servos.values()}
        try:
            if not all(before.values()):
                self.hold()
                for servo in before:
                    self.bus.write(servo, "torque", 1)
            yield
        finally:
            with suppress(BusError):
                self.hold()
            for servo, torque in before.items():
                if not torque:
                    with suppress(BusError):
                        self.bus.write(servo, "torque", 0)

    def perform(
        self,
        requests: Array,
        *,
        period: float,
        cycles: int = 1,
        keep: Callable[[float, Array, Array], object] = lambda *_: None,
    ) -> Playback:
        """Lead the joints to the first request, play all (n, k) [rad], and measure after each.

        ``keep`` is called at every tick after the lead, until Ctrl-C, with the time since the first
        request [s], the requests and the measured angles [rad], (k,), NaN where none was read.

        Raises InvalidInput, before anything moves, for a request beyond the limits of its joint,
        and BusError where the guard stops the motion or the bus is gone.
        """
        check_ranges({name: each.limits for name, each in self.servos.items()}, requests)
        port, start = self.bus.port, self.angles()
        guard, begin = _Guard(self, start), math.nan

        def tick(row: Array) -> Measured:
            self.send(row)
            measured = self.measure()
            guard.check(row, measured)
            return measured

        def kept_tick(row: Array) -> None:
            nonlocal begin
            measured = tick(row)
            begin = measured.time if math.isnan(begin) else begin
            keep(measured.time - begin, row, measured.angles)

        timed = partial(play, period=period, now=port.now, sleep=port.sleep)
        rest = np.tile(requests[0], (math.ceil(0.5 / period), 1))  # for half a second
        led = timed(rest, cycles=1, send=tick, current=start, speed=0.5)  # [rad/s]
        return led if led.interrupted else timed(requests, cycles=cycles, send=kept_tick)

    def check_heard(self, heard: Array, now: float) -> None:
        """Raise BusError where a joint was last heard of long before now [s]."""
        if np.any(late := now - heard > 0.5):  # [s]
            name = self.names[int(np.argmax(late))]
            raise BusError(f"{name}: the servo has stopped answering; check cable and supply")


def check_ranges(limits: Mapping[str, tuple[float, float]], requests: Array) -> None:
    """Raise InvalidInput where requests [rad], (n, k), are beyond the limits of their joints."""
    for (name, (low, high)), column in zip(limits.items(), requests.T, strict=True):
        rounding = 1e-6  # of files [rad]
        beyond = ~((column >= low - rounding) & (column <= high + rounding))  # NaN, too
        if beyond.any():
            row = int(np.argmax(beyond))
            raise InvalidInput(
                f"{name}: request {row} is {angle_text(column[row])}, expected "
                f"{angle_text(low, high)}, its range; plan within it"
            )


class _Guard:
    """Stops a motion that goes wrong."""

    def __init__(self, arm: Arm, start: Array) -> None:
        limits = np.array([servo.limits for servo in arm.servos.values()])
        beyond = math.radians(15.0)  # of its range a joint may be before its motion is stopped
        self._low = np.minimum(limits[:, 0], start) - beyond
        self._high = np.maximum(limits[:, 1], start) + beyond
        self._arm, self._anchors, self._places = arm, start.copy(), start.copy()
        self._moved, self._heard, self._called = np.full((3, len(start)), arm.bus.port.now())
        self._least, self._most = np.full(len(start), np.inf), np.full(len(start), -np.inf)

    def check(self, requests: Array, measured: Measured) -> None:
        """Raise BusError where a joint is silent, stuck, beyond its range or reports a fault."""
        now, angles = measured.time, measured.angles
        heard = np.isfinite(angles)
        self._heard[heard] = now
        errors = np.abs(requests - angles)
        free = heard & ~((errors > STUCK_ERROR) & (np.abs(angles - self._anchors) < STUCK_MOTION))
        self._anchors[free], self._moved[free] = angles[free], now
        away = heard & (np.abs(angles - self._places) >= STUCK_MOTION)
        self._places[away] = angles[away]
        self._least[away], self._most[away] = np.inf, -np.inf
        self._least = np.fmin(self._least, requests)
        self._most = np.fmax(self._most, requests)
        little = self._most - self._least <= 2.0 * STUCK_ERROR
        self._called[little] = now  # since then the requests call for a motion
        self._arm.check_heard(self._heard, now)
        for k, name in enumerate(self._arm.names):
            words = self._arm.bus.protocol.error_words(measured.errors[k])
            if words:
                raise BusError(f"{name}: the servo reports {words}; stopped")
            if now - min(self._moved[k], self._called[k]) > STUCK_TIME:
                raise BusError(
                    f"{name}: does not follow: at {angle_text(angles[k])}, requested "
                    f"{angle_text(requests[k])}; stopped: what holds it?"
                )
            if heard[k] and not self._low[k] < angles[k] < self._high[k]:
                raise BusError(
                    f"{name}: at {angle_text(angles[k])}, far beyond its range; stopped: is its "
                    "direction right?"
                )
