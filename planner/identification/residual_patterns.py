"""What the residuals show that the model does not have: a note for each, with its rows.

Everywhere ``fit`` is what a model makes of a log, and ``noise`` the standard deviation of the
sensor's noise [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, Indices, stretches
from planner.identification.log import Log
from planner.identification.result import (
    Finding,
    Interval,
    LogFit,
    at_even_times,
    runs_of_fits,
    told,
)
from planner.identification.terms import Backlash
from planner.model.evidence import errors_of_motion
from planner.model.joint import JointModel

FEW_ROWS = 20  # fewer rows show neither a stop nor where a joint rests
CLEAR = 5.0  # standard deviations of the noise that a pattern has to exceed
REST = 0.3  # time over which a joint at rest is observed, and an acceleration averaged [s]

SETTLED = 3.0
"""A step shows where a joint rests if no other follows within so many of its latencies."""

APART = 5  # rows that show a pattern and are at most so many apart are one place
STILL = 0.005  # share of its travel within which a joint does not move

REFUSED = (0.1, 0.3)
"""Shares of its travel by which the requests are at least to either side of a joint that is stuck,
and to one of them: no friction holds it there."""


class Held(NamedTuple):
    """Rows of a log in which something other than its servo holds a joint."""

    rows: Indices  # increasing
    name: str  # what holds it: its sentence in ``findings.txt``
    # of contact in how many places of rest, and how far the joint rests beside its model there at
    # most [rad]
    known: dict[str, Any]

    def finding(self, log: Log, fate: str) -> Finding:
        """What holds it in this log, and what becomes of its rows."""
        rows = {"count": len(self.rows), "first": self.rows[0], "last": self.rows[-1]}
        return told("log", self.name, log.unit, log=log.name, fate=fate, **rows, **self.known)


def stops(fit: LogFit, noise: float) -> list[Held]:
    """Where a joint is held at its largest, or least, angle while it is requested to go on.

    A joint with friction waits at one angle, too, but at another one each time: a stop is met
    twice or more, and the model goes beyond it by different amounts.
    """
    log, used = fit.log, np.flatnonzero(fit.used)
    found: list[Held] = []
    if len(used) < FEW_ROWS:
        return found
    width = 0.005 * float(np.ptp(log.angles[used]))
    clear = CLEAR * max(noise, width)
    for way, end in ((1.0, "largest"), (-1.0, "least")):
        angles = way * log.angles
        extreme = float(np.max(angles[used]))
        rows = used[angles[used] >= extreme - max(width, 2.0 * noise)]
        beyond = way * fit.predicted[rows] - extreme > clear
        visits = [visit for visit in _places(rows, 1) if beyond[np.isin(rows, visit)].any()]
        if np.sum(beyond) < max(FEW_ROWS, 0.5 * len(rows)) or len(visits) < 2:
            continue
        held = np.concatenate(visits)
        if np.ptp(log.requests[held]) > clear:
            found.append(Held(held, "stop", {"end": end, "angle": way * extreme}))
    return found


def stuck(log: Log) -> list[Held]:
    """Where a joint stays where it is while it is requested far to one side and the other.

    Far to one side is enough if it goes there elsewhere, from the same angle. A joint on which
    something rests, or which its load overcomes, moves at least one way.
    """
    length, late = (max(5, round(time / log.period)) for time in (REST, REST / 2.0))
    rows = np.flatnonzero(log.torque_on & log.measured)
    if len(rows) < FEW_ROWS + length:
        return []
    angles, travel = log.angles[rows], float(np.ptp(log.angles[rows]))
    still = np.convolve(_spans(angles, length) <= STILL * travel, np.ones(length)) > 0.5
    found = []
    for part in stretches(still):
        held = rows[part]
        asked = log.requests[held[:-late]] - np.median(angles[part])
        if len(asked) and np.ptp(asked) > 0.0:
            sides = np.sort([np.max(asked), -np.min(asked)])
            if np.all(sides > np.multiply(REFUSED, travel)) or _passed(log, rows, part, length):
                away = float(np.max(np.abs(log.requests[held] - log.angles[held])))
                found.append(Held(held, "stuck", {"away": away}))
    return found


def _passed(log: Log, rows: Indices, part: slice, late: int) -> bool:
    """Whether a joint that stays still for 2 s is requested far to where it goes elsewhere.

    There it passes the same angle with half of the error: no stop is there, and no load that
    overcomes it.
    """
    if (part.stop - part.start) * log.period < 2.0 or part.stop - part.start <= late:
        return False
    angles, requests = log.angles[rows], log.requests[rows]
    here, travel = float(np.median(angles[part])), float(np.ptp(angles))
    near, asked = STILL * travel, requests[part][:-late] - here
    farthest = float(asked[np.argmax(np.abs(asked))])
    side, far = math.copysign(1.0, farthest), abs(farthest)
    if far <= REFUSED[1] * travel:
        return False
    outside = np.ones(len(rows), dtype=bool)
    outside[max(part.start - late, 0) : part.stop - 1 + late] = False
    moved = side * (angles[late:] - angles[:-late])
    error = side * (requests[:-late] - angles[:-late])
    passes = (side * (here - angles[:-late]) >= 0.0) & (side * (angles[late:] - here) >= near)
    return bool(np.any(passes & (moved > near) & (error <= 0.5 * far) & outside[:-late]))


def joined(contacts: Sequence[Held]) -> Held:
    """Contact of the same log in different rows."""
    places, most = ([each.known[name] for each in contacts] for name in ("places", "most"))
    rows = np.unique(np.concatenate([contact.rows for contact in contacts]))
    return Held(rows, "contact", {"places": sum(places), "most": max(most)})


def contacts(fits: Sequence[LogFit], noise: float) -> list[list[Held]]:
    """Where a joint rests much farther beside its model than in other places, at most one each log.

    An arm that stands on a table, or on itself, stays there however far the request is beyond, and
    its other joints are pushed back. Friction holds a joint to both sides of the model, by the same
    amount everywhere: what is far from the median of all places of rest is none. Where many places
    are, it is the model that errs, and fewer than ten places do not tell. (Of an arm that pushed on
    its table they are 4.4 to 10 standard deviations of all places away, within friction up to 3.)
    """
    places = [(k, rows) for k, fit in enumerate(fits) for rows in _rests(fit, noise)]
    contacts: list[list[Held]] = [[] for _ in fits]
    if len(places) < 10:
        return contacts
    beside = np.array([np.median(fits[k].residuals[rows]) for k, rows in places])
    middle = float(np.median(beside))
    usual = float(np.median(np.abs(beside - middle))) / 0.6745
    motion = max(float(np.ptp(fit.log.angles[fit.used])) for fit in fits if fit.used.any())
    clear = max(4.0 * usual, CLEAR * noise, 0.01 * motion)
    touching = np.flatnonzero(np.abs(beside - middle) > clear)
    if len(touching) > 0.25 * len(places):
        return contacts
    for k in sorted({places[place][0] for place in touching.tolist()}):
        held = [place for place in touching.tolist() if places[place][0] == k]
        rows = np.zeros(len(fits[k].used), dtype=bool)
        for place in held:
            way = math.copysign(1.0, beside[place] - middle)
            off = way * (fits[k].residuals - middle) > 0.5 * clear
            first, last = places[place][1][[0, -1]].tolist()
            off[first : last + 1] = True
            rows[next(part for part in stretches(off) if part.stop > first)] = True
        most = float(np.max(np.abs(beside[held] - middle)))
        contacts[k].append(
            Held(np.flatnonzero(rows), "contact", {"places": len(held), "most": most})
        )
    return contacts


def _rests(fit: LogFit, noise: float) -> list[Indices]:
    """Rows before which the request, the joint and its model have rested, by place."""
    length = max(5, round(REST / fit.log.period))
    if len(fit.used) < length:
        return []
    rests = fit.used.copy()
    rests[: length - 1] = False
    for series in (fit.log.requests, fit.log.angles, fit.predicted):
        rests[length - 1 :] &= _spans(series, length) <= CLEAR * noise
    return _places(np.flatnonzero(rests), APART)


def _spans(series: Array, length: int) -> Array:
    """Range of each so many values in a row."""
    windows = np.lib.stride_tricks.sliding_window_view(series, length)
    return np.asarray(np.ptp(windows, axis=1))


def _places(rows: Indices, apart: int) -> list[Indices]:
    """Increasing rows, those together that are at most so many apart."""
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > apart) + 1)
    return [part for part in parts if len(part)]


def with_weights(fits: Sequence[LogFit], noise: float) -> tuple[Log, ...] | None:
    """The logs with rows weighed by the error to expect of them; None where that is about even.

    What a model lacks shows most where the joint accelerates most, as test signals do and the
    motions to be planned do not. Rows that count alike would make calm motion pay for it. The error
    is taken to rise with the acceleration on a straight line, from that of the calmest parts of
    :func:`errors_of_motion`, at rest, to the largest. (By what that function tells itself rows at
    rest count so much that the lift of an SO-101 misses unseen motions by 10.3 mrad, not 8.3.)
    """
    from scipy.ndimage import uniform_filter1d

    pairs, _ = errors_of_motion(runs_of_fits(fits, held_out=False))
    if not pairs:
        return None
    most = pairs[-1][1]
    calm, largest = max(pairs[0][1], noise), min(size for size, error in pairs if error == most)
    if most <= 1.25 * calm:
        return None
    logs = []
    for fit in fits:
        count = max(1, round(REST / fit.log.period))
        weights = np.ones(len(fit.used))
        for rows in stretches(fit.used):
            if rows.stop - rows.start < 3:
                continue
            angles, period = at_even_times(fit.log, rows, fit.predicted[rows])
            changes = np.diff(angles, 2) / period**2
            around = uniform_filter1d(np.pad(changes**2, 1, mode="edge"), count, mode="nearest")
            sizes = np.sqrt(np.maximum(around, 0.0))
            weights[rows] = calm / np.maximum(calm, np.interp(sizes, (0.0, largest), (calm, most)))
        logs.append(replace(fit.log, weights=fit.log.weights * weights))
    return tuple(logs)


def patterns(
    model: JointModel,
    fits: Sequence[LogFit],
    noise: float,
    asymmetry: Interval | None = None,
    backlash: Backlash | None = None,
) -> list[Finding]:
    """A note for each pattern that shows; ``asymmetry`` is the interval of the model's v_offset."""
    unit = fits[0].log.unit
    found = [] if backlash is None else [_backlash(backlash, fits)]
    determined = asymmetry is not None and asymmetry.lower * asymmetry.upper > 0.0
    if determined and abs(model.v_offset) > 0.05 * model.v_max:
        up, down = model.v_max + model.v_offset, model.v_max - model.v_offset
        found.append(told("pattern", "asymmetry", unit, up=up, down=down))
    for fit in fits:
        found += [*_ringing(model, fit, noise), *_drift(fit, noise)]
    return [*found, *_contradiction(fits)]


def shaken(model: JointModel, fits: Sequence[LogFit]) -> list[Finding]:
    """A note on each log in which a joint moves to and fro under requests that do not change.

    Whatever shakes it, other joints or the ground, dry friction holds it less than in calm motion.
    (Of an arm such a log shows a dead band of 0.009 rad, slow motion 0.034. Joints that were shaken
    moved by 0.44 to 0.67 of the model's error, others by 0.22 or less.) Noise of a sensor has no
    correlation of neighbouring rows.
    """
    found = []
    for fit in fits:
        log = fit.log
        length = max(10, round(REST / log.period))
        settled = length + math.ceil(SETTLED * max(model.latency, REST / 3.0) / log.period)
        rows = np.arange(len(log.times))
        moves = np.abs(np.diff(fit.predicted, prepend=np.nan))  # NaN where a row is not used
        resting = (moves <= 0.01 * fit.rms) & (np.diff(log.requests, prepend=np.nan) == 0.0)
        since = rows - np.maximum.accumulate(np.where(resting, 0, rows))
        ends = np.flatnonzero(since >= settled)
        if len(ends) < length:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(log.angles, length)[ends - length + 1]
        moved = windows - np.mean(windows, axis=1, keepdims=True)
        size = float(np.sqrt(np.mean(moved**2)))
        alike = float(np.mean(moved[:, 1:] * moved[:, :-1])) / max(size**2, 1e-300)
        if alike > 0.5 and size > 0.35 * fit.rms:
            found.append(told("shaken", "shaken", log.unit, log=log.name, size=size))
    return found


def _backlash(found: Backlash, fits: Sequence[LogFit]) -> Finding:
    """The play, in how many places of the logs it shows, and the clearest of them."""
    ends = np.cumsum([np.sum(fit.used) for fit in fits])[:-1]
    pieces = (np.split(each, ends) for each in (found.difference, found.gained))
    places = []
    for fit, difference, gained in zip(fits, *pieces, strict=True):
        shows = difference > 0.3 * float(np.max(found.difference))
        of_row = np.zeros(len(fit.used))
        of_row[fit.used] = gained
        for place in _places(np.flatnonzero(fit.used)[shows], APART):
            first, last = int(place[0]), int(place[-1])
            times = fit.log.times[[first, last]].tolist()
            places.append((float(np.sum(of_row[place])), fit.log.name, first, last, *times))
    return told(
        "pattern",
        "backlash",
        fits[0].log.unit,
        play=found.size,
        rms=found.rms,
        without=found.without,
        several=len(fits) > 1,
        places=sorted(places, key=lambda place: -place[0]),
    )


def _contradiction(fits: Sequence[LogFit]) -> list[Finding]:
    """That the joint rests beside the model by other amounts, or to other sides, in two logs."""
    named = [(fit.log.name, fit.residuals[fit.used]) for fit in fits]
    means = {name: (np.mean(left), np.std(left)) for name, left in named if len(left) >= FEW_ROWS}
    if len(means) < 2:
        return []
    low, high = (choose(means, key=lambda name: means[name][0]) for choose in (min, max))
    apart = float(means[high][0] - means[low][0])
    if apart <= 2.0 * max(means[low][1], means[high][1]):
        return []
    unit = fits[0].log.unit
    return [told("pattern", "contradiction", unit, apart=apart, high=high, low=low)]


def _ringing(model: JointModel, fit: LogFit, noise: float) -> list[Finding]:
    """Steps after which the joint goes farther beyond where it comes to rest than its model."""
    log = fit.log
    changes = np.flatnonzero(np.diff(log.requests)) + 1
    ends = np.append(changes, len(log.times))[1:]
    steps, over = 0, []
    for begin, end in zip(changes.tolist(), ends.tolist(), strict=True):
        step = float(log.requests[begin] - log.requests[begin - 1])
        short = log.times[end - 1] - log.times[begin] < SETTLED * model.latency
        if short or end - begin <= 3 or abs(step) < CLEAR * noise:
            continue
        angles = np.stack([log.angles[begin:end], fit.predicted[begin:end]])
        angles = np.where(np.isnan(angles), log.angles[begin], angles)
        moved = math.copysign(1.0, step) * (angles - log.angles[begin])
        last = max((end - begin) // 5, 3)
        rests = np.median(moved[:, -last:], axis=1)
        if rests[0] < 0.5 * abs(step):
            continue
        steps += 1
        beyond, modelled = np.max(moved[:, :-last], axis=1) - rests
        own = modelled > 0.67 * beyond  # an overshoot by its time constant
        if not own and beyond > max(0.05 * rests[0], CLEAR * noise):
            over.append((begin, beyond / rests[0], max(modelled, 0.0) / rests[0]))
    if len(over) < max(2, 0.5 * steps):
        return []
    _, share, modelled = np.median(over, axis=0).tolist()
    known = {"count": len(over), "steps": steps, "share": share, "modelled": modelled}
    return [told("pattern", "ringing", log=log.name, row=over[0][0], **known)]


def _drift(fit: LogFit, noise: float) -> list[Finding]:
    """Residuals that follow a straight line through the log."""
    log, used = fit.log, np.flatnonzero(fit.used)
    if len(used) < FEW_ROWS:
        return []
    times, left = log.times[used], fit.residuals[used]
    line = np.polynomial.Polynomial.fit(times, left, 1)
    change = float(line(times[-1]) - line(times[0]))
    explained = float(np.var(line(times)) / max(np.var(left), 1e-300))
    if explained <= 0.3 or abs(change) <= CLEAR * noise:
        return []
    rows = {"first": used[0], "last": used[-1]}
    return [told("pattern", "drift", log.unit, log=log.name, change=change, **rows)]
