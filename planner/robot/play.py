"""Send requests to a robot, each at its time: those of a plan, or of a stream as it plans them."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from planner.arrays import MOST_SAMPLES, Array, as_count, as_positive, as_rows, shown
from planner.exceptions import InvalidInput

if TYPE_CHECKING:
    from planner.planning.stream import Stream

Send = Callable[[Array], Any]  # sends one row of requests [rad], shape (k,), to the joints
JUDGED = 10  # ticks after which it is known whether the stream keeps its period


@dataclass(frozen=True, kw_only=True)
class Playback:
    """Counts of the requests of a player, and their lateness.

    Attributes:
        sent: Requests that were sent, including the ramp.
        skipped: Requests that were not, because the next one was due when they could be.
        held: Ticks of a stream at which the last request of a joint was repeated.
        overruns: Requests that were not yet sent, ``send`` having returned, when the next was due.
        latest: Largest time by which ``send`` was called after a request was due [s].
        mean_lateness: Mean of these times [s].
        interrupted: Whether Ctrl-C ended it.
        failed: Whether an error ended it. A request in whose ``send`` it came is not among those
            sent.
    """

    sent: int = 0
    skipped: int = 0
    held: int = 0
    overruns: int = 0
    latest: float = 0.0
    mean_lateness: float = 0.0
    interrupted: bool = False
    failed: bool = False

    def __str__(self) -> str:
        end = "failed" if self.failed else "interrupted" if self.interrupted else "finished"
        held = f", {self.held} held" if self.held else ""
        return (
            f"{end} after {self.sent} requests: {1e3 * self.mean_lateness:.2f} ms late on average, "
            f"{1e3 * self.latest:.2f} ms at most, {self.overruns} overruns, {self.skipped} skipped"
            f"{held}"
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
    """Send every request at its time, and return how late and how many were sent.

    Request k is due at k periods from the first one, so that lateness does not add up. A request
    that is late is sent at once, but skipped where the next one is due already: the robot stays in
    step with the clock. On the ramp nothing is skipped; where it is late, the rest waits.

    Args:
        requests: Requests for the joints [rad], shape (n, k), or (n,) for one joint.
        period: Time between requests [s].
        send: Takes one row, shape (k,), read-only, and sends it.
        cycles: How often to go through the requests; until Ctrl-C by default. A plan from
            rest, which does not end where it begins, is for once.
        current: Where the joints are [rad], shape (k,): they are led from there to the first
            request. Without it, the first request is sent at once, however far it is.
        speed: Top speed on the way there [rad/s]; needed with ``current``.
        on_stop: Called once at the end: after the last request, Ctrl-C, or an error.
            Nothing is sent any more: the joints hold the last request that reached them, unless
            this function does otherwise, such as take their torque.
        report: Called once after ``on_stop``, with the counts and the lateness, whatever ended it:
            after an error, which returns nothing, the only source of them.
        now: A clock that never goes back [s].
        sleep: Waits for a time [s].

    Returns:
        The counts and the lateness, also where Ctrl-C was the end; any other error passes through
        after ``on_stop`` and ``report``.

    Raises:
        InvalidInput: Before anything is sent: a period, speed or number of cycles that is not
            positive, or ``current`` without ``speed``.
        InvalidTrajectory: Requests that are not a finite array of one of these shapes.

    Example:
        >>> sent = []
        >>> report = play([[0.1], [0.2]], period=0.002, cycles=2, send=sent.append)
        >>> len(sent) + report.skipped
        4
    """
    rows = as_rows(requests, name="requests")
    as_positive("period", period, "a positive number of seconds")
    last = math.inf
    if cycles is not None:
        last = as_count("cycles", cycles, "a whole number from 1 up") * len(rows) - 1
    if (current is None) != (speed is None):
        raise InvalidInput("current and speed: got one of them, expected both or none")
    way: Iterable[Array] = ()
    if current is not None and speed is not None:
        way = ramp(current, rows[0], speed=speed, period=period)

    def answer(tick: int, _: int) -> tuple[Array, bool] | None:
        return (rows[tick % len(rows)], False) if tick <= last else None

    return _play(answer, send, now, sleep, period, on_stop, report, way=way, last=last)


def check_functions(*, optional: bool = False, **functions: object) -> None:
    """Raise InvalidInput for an object that cannot be called."""
    for name, each in functions.items():
        if not callable(each) and not (optional and each is None):
            raise InvalidInput(f"{name}: got {shown(each)}, expected a function")


def _play(
    answer: Callable[[int, int], tuple[Array, bool] | None],
    send: Send,
    now: Callable[[], float],
    sleep: Callable[[float], object],
    period: float,
    on_stop: Callable[[], object] | None,
    report: Callable[[Playback], object] | None,
    *,
    way: Iterable[Array] = (),
    last: float = math.inf,
) -> Playback:
    """Lead along a way, then answer at each tick, to the end, Ctrl-C or an error: :func:`play`.

    ``answer`` takes the number of a tick that is due, and how many were missed before it, and
    returns the requests [rad], (k,), sent if finite, and whether one of them is repeated; or None
    at the end. The tick ``last`` is not missed, however late.
    """
    check_functions(send=send, now=now, sleep=sleep)
    check_functions(optional=True, on_stop=on_stop, report=report)
    counts = dict.fromkeys(("sent", "skipped", "held", "overruns"), 0)
    late = latest = 0.0
    interrupted, failed = False, True

    def wait_until(due: float) -> None:
        while (remaining := due - now()) > 0.0:
            sleep(remaining)

    def send_at(due: float, row: Array) -> float:
        """Send a row when it is due, or at once where it is late; the time at which that was."""
        nonlocal late, latest
        wait_until(due)
        begun = now()
        send(row)
        counts["sent"] += 1
        late += begun - due
        latest = max(latest, begun - due)
        return begun

    try:
        try:
            due = now()
            for row in way:  # each a full period after the one before
                due = send_at(due, row) + period
                counts["overruns"] += now() >= due
            start, tick = max(due, now()), 0
            while True:
                missed = max(int(min((now() - start) / period, last)) - tick, 0)
                tick += missed
                counts["skipped"] += missed
                due = start + tick * period
                wait_until(due)
                reply = answer(tick, missed)
                if reply is None:
                    break
                requests, held = reply
                counts["held"] += held
                if np.isfinite(requests).all():
                    send_at(due, requests)
                counts["overruns"] += now() >= due + period
                tick += 1
            failed = False
        except KeyboardInterrupt:
            interrupted, failed = True, False
        finally:
            if on_stop is not None:
                on_stop()
    finally:
        playback = Playback(
            **counts,
            latest=latest,
            mean_lateness=late / max(counts["sent"], 1),
            interrupted=interrupted,
            failed=failed,
        )
        if report is not None:
            report(playback)
    return playback


def ramp(current: npt.ArrayLike, first: Array, *, speed: float, period: float) -> Array:
    """Requests every period [s] from the present angles to the first request, without both.

    The joints set out and arrive together, at ``speed`` [rad/s] at most: [rad], (m, k), none where
    one period suffices.
    """
    as_positive("speed", speed, "a positive number of rad/s")
    try:
        array = np.asarray(current)
    except ValueError:  # rows of different lengths
        array = np.empty((0, 0))
    if array.ndim > 1:
        got = shown(current)
        raise InvalidInput(f"current: got {got}, expected one angle per joint, shape (k,)")
    (start,) = as_rows(np.atleast_2d(array), name="current")
    if start.shape != first.shape:
        raise InvalidInput(
            f"current: got {len(start)} angles, expected {len(first)}, one per joint of the "
            "requests"
        )
    steps = float(np.max(np.abs(first - start))) / (speed * period)
    if steps > MOST_SAMPLES:
        raise InvalidInput(
            f"speed: got {speed:g} rad/s, for a ramp of {steps * period:.3g} s; expected a faster "
            "one"
        )
    shares = np.arange(1, math.ceil(steps))[:, None] / max(math.ceil(steps), 1)
    rows: Array = start + shares * (first - start)
    return rows


Desired = Callable[[int], "npt.ArrayLike | None"]
"""The next stretch of the desired path at a tick [rad], shape (m, k), or None at the end."""


def follow(
    stream: Stream,
    desired: npt.ArrayLike | Desired,
    *,
    send: Send,
    measure: Callable[[], npt.ArrayLike] | None = None,
    on_stop: Callable[[], object] | None = None,
    report: Callable[[Playback], object] | None = None,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
) -> Playback:
    """Plan and send requests at every tick of a stream, and return how late and how many were sent.

    Tick k is due at k periods from the first one, so that lateness does not add up. When it is due,
    the stretch of the path is taken, the angles are measured, and the requests are planned and
    sent. Ticks that were missed, because one before took too long, are left out, and the stream
    counts them: the robot held its requests.

    Args:
        stream: The stream, as it is: a new one, or one that goes on.
        desired: A path [rad], shape (n, k), followed once; or a function that is given the number
            of the tick and returns the stretch that begins there, shape (m, k), or None at the end.
        send: Takes one row, shape (k,), read-only, and sends it.
        measure: Returns the measured angles [rad], shape (k,), NaN where there is none.
        on_stop: Called once at the end, as in :func:`planner.play`.
        report: Called once after ``on_stop``, with the counts and the lateness.
        now: A clock that never goes back [s].
        sleep: Waits for a time [s].

    Returns:
        The counts and the lateness, the planning included; also where Ctrl-C was the end. Any other
        error passes through after ``on_stop`` and ``report``.

    Warns:
        UserWarning: Once, after ten ticks: planning alone takes longer than a period.

    Raises:
        InvalidInput: Before anything is sent: something that cannot be called, or is no stream.
        InvalidTrajectory: A path that is not a finite array of that shape.

    Example:
        >>> from planner import JointModel, Stream
        >>> stream = Stream(JointModel.ers210a(), preview=25)
        >>> sent = []
        >>> report = follow(stream, [[0.1], [0.1], [0.1]], send=sent.append)
        >>> len(sent) + report.skipped
        3
    """
    check_functions(optional=True, measure=measure)
    if not callable(getattr(stream, "step", None)):
        raise InvalidInput(f"stream: got {shown(stream)}, expected a planner.Stream")
    as_positive("period", stream.period, "a positive number of seconds")
    end = math.inf
    if callable(desired):
        at = desired
    else:
        path = as_rows(desired, name="desired")
        at = lambda tick: path[tick:] if tick < len(path) else None  # noqa: E731
        end = len(path)  # of ticks beyond it none is missed
    times: list[float] = []

    def answer(tick: int, missed: int) -> tuple[Array, bool] | None:
        stretch = at(tick)
        if stretch is None:
            return None
        measured = None if measure is None else measure()
        begun = now()
        requests = stream.step(stretch, measured, missed=missed)
        if len(times) < JUDGED:
            times.append(now() - begun)
            if len(times) == JUDGED and (used := median(times)) >= stream.period:
                warnings.warn(
                    f"stream: planning a tick takes {1e3 * used:.3g} ms here, and the period is "
                    f"{1e3 * stream.period:g} ms: requests are late, and ticks are skipped; "
                    "expected a longer period, a shorter preview, or no cycle",
                    UserWarning,
                    stacklevel=2,
                )
        return requests, "held" in stream.status

    return _play(answer, send, now, sleep, stream.period, on_stop, report, last=end)
