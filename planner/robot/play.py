"""Drive a robot: every request at its time, through whatever function sends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.robot.ramp import ramp
from planner.robot.schedule import as_rows
from planner.robot.timed_requests import TimedRequest, timed_requests
from planner.trajectory import Array
from planner.validation import shown

Send = Callable[[Array], Any]
"""Sends one row of requests [rad], shape (k,), to the joints."""


@dataclass(frozen=True, kw_only=True)
class Playback:
    """How well a player kept its times.

    Attributes:
        sent: Requests that were sent, those of the ramp included.
        skipped: Requests that were not, because the next one was due when they could be.
        overruns: Requests that were not yet sent, ``send`` having returned, when the next was due.
        latest: Largest time by which ``send`` was called after a request was due [s].
        mean_lateness: Mean of these times [s].
        interrupted: Whether Ctrl-C ended it.
        failed: Whether an error ended it. A request in whose ``send`` it came is not among those
            sent.
    """

    sent: int = 0
    skipped: int = 0
    overruns: int = 0
    latest: float = 0.0
    mean_lateness: float = 0.0
    interrupted: bool = False
    failed: bool = False

    def __str__(self) -> str:
        end = "failed" if self.failed else "interrupted" if self.interrupted else "finished"
        return (
            f"{end} after {self.sent} requests: {1e3 * self.mean_lateness:.2f} ms late on average, "
            f"{1e3 * self.latest:.2f} ms at most, {self.overruns} overruns, {self.skipped} skipped"
        )


def play(
    requests: npt.ArrayLike,
    *,
    period: float,
    send: Send,
    cycles: int | None = None,
    current: npt.ArrayLike | None = None,
    speed: float | None = None,
    on_stop: Callable[[], object] | None = None,
    report: Callable[[Playback], object] | None = None,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
) -> Playback:
    """Send every request at its time, and say afterwards how well that went.

    Request k is due at k periods from the first one, so that lateness does not add up. A request
    that is late is sent at once, but skipped where the next one is due already: the robot stays in
    step with the clock. On the ramp nothing is skipped; where it is late, the rest waits.

    Args:
        requests: What to send to the joints [rad], shape (n, k), or (n,) for one joint.
        period: Time between requests [s].
        send: Takes one row, shape (k,), read-only, and sends it.
        cycles: How often to go through the requests; until Ctrl-C by default. A plan from
            rest, which does not end where it begins, is for once.
        current: Where the joints are [rad], shape (k,): they are led from there to the first
            request. Without it, the first request is sent at once, however far it is.
        speed: Top speed on the way there [rad/s]; needed with ``current``.
        on_stop: Called once at the end, whatever ends it: the last request, Ctrl-C, or an error.
            Nothing is sent any more: the joints hold the last request that reached them, unless
            this function does otherwise, such as take their torque.
        report: Called once after ``on_stop``, with what was sent and how late, whatever ended it:
            after an error, which leaves no answer, the one way to know.
        now: A clock that never goes back [s].
        sleep: Waits for a time [s].

    Returns:
        What was sent, and how late. Ctrl-C is an end like any other and is told there; any other
        error passes through after ``on_stop`` and ``report``.

    Raises:
        InvalidInput: Before anything is sent: a period, speed or number of cycles that is not
            positive, or ``current`` without ``speed``.
        InvalidTrajectory: Requests that are not a finite array of one of these shapes.
    """
    _check_functions(send=send, now=now, sleep=sleep)
    _check_functions(optional=True, on_stop=on_stop, report=report)
    rows = as_rows(requests, name="requests")
    timed = timed_requests(rows, period=period, cycles=cycles)
    if (current is None) != (speed is None):
        raise InvalidInput("current and speed: got one of them, expected both or none")
    way: Iterable[Array] = ()
    if current is not None and speed is not None:
        way = ramp(current, rows[0], speed=speed, period=period)
    player = _Player(send, now, sleep, period)
    interrupted, failed = False, True
    try:
        try:
            player.keep_to_times(timed, start=player.lead(way))
            failed = False
        except KeyboardInterrupt:
            interrupted, failed = True, False
        finally:
            if on_stop is not None:
                on_stop()
    finally:
        playback = player.playback(interrupted=interrupted, failed=failed)
        if report is not None:
            report(playback)
    return playback


def _check_functions(*, optional: bool = False, **given: object) -> None:
    for name, each in given.items():
        if not callable(each) and not (optional and each is None):
            raise InvalidInput(f"{name}: got {shown(each)}, expected a function")


class _Player:
    """Sends requests and keeps the books about it."""

    def __init__(
        self,
        send: Send,
        now: Callable[[], float],
        sleep: Callable[[float], object],
        period: float,
    ) -> None:
        self._send, self._now, self._sleep, self._period = send, now, sleep, period
        self._sent = self._skipped = self._overruns = 0
        self._late = self._latest = 0.0

    def lead(self, way: Iterable[Array]) -> float:
        """Send each row a full period after the one before; the time at which the next is due."""
        due = self._now()
        for row in way:
            due = self._send_at(due, row) + self._period
            self._overruns += self._now() >= due
        return due

    def keep_to_times(self, timed: Iterable[TimedRequest], *, start: float) -> None:
        """Send each request at its time from ``start`` on, and hold the last for its period."""
        for request, following in pairwise(chain(timed, [None])):
            assert request is not None, "only the end has nothing to send"
            if following is not None and self._now() >= start + following.time:
                self._skipped += 1
                continue
            self._send_at(start + request.time, request.requests)
            self._overruns += self._now() >= start + request.time + self._period
            if following is None:
                self._wait_until(start + request.time + self._period)

    def playback(self, *, interrupted: bool, failed: bool) -> Playback:
        return Playback(
            sent=self._sent,
            skipped=self._skipped,
            overruns=self._overruns,
            latest=self._latest,
            mean_lateness=self._late / max(self._sent, 1),
            interrupted=interrupted,
            failed=failed,
        )

    def _send_at(self, due: float, row: Array) -> float:
        """Send a row when it is due, or at once where it is late; the time at which that was."""
        self._wait_until(due)
        begun = self._now()
        self._send(row)
        self._sent += 1
        self._late += begun - due
        self._latest = max(self._latest, begun - due)
        return begun

    def _wait_until(self, due: float) -> None:
        while (left := due - self._now()) > 0.0:
            self._sleep(left)
