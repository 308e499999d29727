"""Feed a stream at a fixed rate: plan, send and measure while the robot moves."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from statistics import median

import numpy.typing as npt

from planner.exceptions import InvalidInput
from planner.planning.streaming.stream import Stream
from planner.robot.play import Playback, Player, Send, check_functions, conduct
from planner.robot.schedule import check_period
from planner.trajectory import Array, as_rows
from planner.validation import shown

Desired = Callable[[int], "npt.ArrayLike | None"]
"""The next stretch of the desired path at a tick [rad], shape (m, k), or None at the end."""

JUDGED = 10
"""Ticks after which it is known whether the stream keeps its period."""


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
    check_functions(send=send, now=now, sleep=sleep)
    check_functions(optional=True, measure=measure, on_stop=on_stop, report=report)
    if not callable(getattr(stream, "step", None)):
        raise InvalidInput(f"stream: got {shown(stream)}, expected a planner.Stream")
    check_period(stream.period)
    at = desired if callable(desired) else _stretches(as_rows(desired, name="desired"))
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
            if len(times) == JUDGED:
                _check_times(median(times), stream.period)
        return requests, "held" in stream.status

    player = Player(send, now, sleep, stream.period)
    return conduct(player, lambda: player.keep_in_step(answer), on_stop=on_stop, report=report)


def _stretches(rows: Array) -> Desired:
    """The rest of a path at each tick."""
    return lambda tick: rows[tick:] if tick < len(rows) else None


def _check_times(used: float, period: float) -> None:
    """Warn where a tick, which took so long [s], does not fit into a period [s]."""
    if used >= period:
        warnings.warn(
            f"stream: planning a tick takes {1e3 * used:.3g} ms here, and the period is "
            f"{1e3 * period:g} ms: requests are late, and ticks are skipped; expected a longer "
            "period, a shorter preview, or no cycle",
            UserWarning,
            stacklevel=2,
        )
