"""What the residuals show that the model does not have: a note for each, with its rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planner.identification.log import Log
from planner.identification.result import (
    Finding,
    Interval,
    LogFit,
    angle_in,
    at_even_times,
    runs_of_fits,
)
from planner.identification.terms import Backlash
from planner.model.evidence import errors_of_motion
from planner.model.joint import JointModel

FEW_ROWS = 20
"""Fewer rows show neither a stop nor where a joint rests."""


@dataclass(frozen=True, kw_only=True)
class PatternOptions:
    """Bounds from which on a pattern is named.

    Attributes:
        clear: Standard deviations of the noise that a pattern has to exceed.
        explained: Share of the overshoot of a joint that rings above which it is the model's own,
            by its time constant.
        settled: A step can ring where no other follows within so many latencies of the joint.
        rest: Time over which a joint at rest is observed [s].
        shaken: Share of the error of the model by which a joint at rest moves that is shaken.
            Shaken joints of an arm move by 0.44 to 0.67, others by 0.22 or less (at half one calm
            recording counts as shaken, at twice none does).
        shaken_alike: Correlation of neighbouring rows of such motion; noise of a sensor has none.
        shown: Share of the largest difference that play makes to the angles from which on a row
            shows it.
        apart: Rows that show it and are fewer than so many apart are one place.
        touching: A joint rests against something where it is beside its model by so many standard
            deviations of what it is beside it in other places of rest. (Of an arm that pushed on
            its table 4.4 to 10; of joints that touched nothing, within their friction, up to 3.)
        places: Fewer places of rest do not tell how far a joint rests beside its model.
        some: Largest share of the places of rest at which something is touched.
        still: Share of its travel within which a joint does not move.
        refused: Shares of it by which the requests are at least to either side of a joint that is
            stuck, and to one of them: no friction holds it there.
        held: Least time for which it stays where it is requested to go to one side alone [s].
        uneven: Rows count alike where the fastest motion is missed by no more than so many times
            what the calmest is.
        around: Time over which the acceleration of a row is averaged [s].
    """

    clear: float = 5.0
    explained: float = 0.67
    settled: float = 3.0
    rest: float = 0.3
    shaken: float = 0.35
    shaken_alike: float = 0.5
    shown: float = 0.3
    apart: int = 5
    touching: float = 4.0
    places: int = 10
    some: float = 0.25
    still: float = 0.005
    refused: tuple[float, float] = (0.1, 0.3)
    held: float = 2.0
    uneven: float = 1.25
    around: float = 0.3


OPTIONS = PatternOptions()


class Stop(NamedTuple):
    """Rows at the largest, or the least, angle of a log while the model goes beyond it.

    Attributes:
        rows: The rows, increasing.
        largest: Whether it is the largest.
        angle: The angle [rad].
    """

    rows: npt.NDArray[np.int_]
    largest: bool
    angle: float

    def finding(self, log: Log, fate: str) -> Finding:
        """The stop, in this log, and what becomes of its rows."""
        end = "largest" if self.largest else "least"
        angle = angle_in(log.unit, self.angle)
        return Finding(
            "log",
            f"{log.name}: a mechanical stop: in {len(self.rows)} rows between {self.rows[0]} and "
            f"{self.rows[-1]} the joint stays at its {end} angle, {angle}, "
            f"while it is requested to go on; {fate}",
        )


def stops(fit: LogFit, noise: float) -> list[Stop]:
    """Where a joint is held at its largest, or least, angle while it is requested to go on.

    A joint with friction waits at one angle, too, but at another one each time: a stop is met
    twice or more, and the model goes beyond it by different amounts.

    Args:
        fit: What a model makes of the log.
        noise: Standard deviation of the noise [rad].
    """
    log, used = fit.log, np.flatnonzero(fit.used)
    found: list[Stop] = []
    if len(used) < FEW_ROWS:
        return found
    width = 0.005 * float(np.ptp(log.angles[used]))
    clear = OPTIONS.clear * max(noise, width)
    for way in (1.0, -1.0):
        angles = way * log.angles
        extreme = float(np.max(angles[used]))
        rows = used[angles[used] >= extreme - max(width, 2.0 * noise)]
        beyond = way * fit.predicted[rows] - extreme > clear
        visits = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1)
        visits = [visit for visit in visits if beyond[visit].any()]
        if np.sum(beyond) < max(FEW_ROWS, 0.5 * len(rows)):
            continue
        if len(visits) < 2:
            continue
        held = rows[np.concatenate(visits)]
        if np.ptp(log.requests[held]) > clear:
            found.append(Stop(held, way > 0.0, way * extreme))
    return found


def stuck(log: Log) -> list[npt.NDArray[np.int_]]:
    """Rows in which a joint stays where it is while it is requested far to one side and the other.

    Far to one side is enough if it goes there elsewhere, from the same angle.

    Something holds it, or its sensor stands still. A joint on which something rests, or which its
    load overcomes, moves at least one way.
    """
    length, late = (max(5, round(time / log.period)) for time in (OPTIONS.rest, OPTIONS.rest / 2.0))
    rows = np.flatnonzero(log.torque_on & log.measured)
    if len(rows) < FEW_ROWS + length:
        return []
    angles, travel = log.angles[rows], float(np.ptp(log.angles[rows]))
    windows = np.lib.stride_tricks.sliding_window_view(angles, length)
    still = np.convolve(np.ptp(windows, axis=1) <= OPTIONS.still * travel, np.ones(length)) > 0.5
    found = []
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(still)) + 1):
        asked = log.requests[rows[part[:-late]]] - np.median(angles[part])
        if still[part[0]] and len(part) > late and np.ptp(asked) > 0.0:
            sides = np.sort([np.max(asked), -np.min(asked)])
            if np.all(sides > np.multiply(OPTIONS.refused, travel)) or _passed(
                log, rows, part, length
            ):
                found.append(rows[part])
    return found


def _passed(log: Log, rows: npt.NDArray[np.int_], part: npt.NDArray[np.int_], late: int) -> bool:
    """Whether a joint that stays still for long is requested far to where it goes elsewhere.

    There it passes the same angle with half of the error: no stop is there, and no load that
    overcomes it.
    """
    if len(part) * log.period < OPTIONS.held or len(part) <= late:
        return False
    angles, requests = log.angles[rows], log.requests[rows]
    here, travel = float(np.median(angles[part])), float(np.ptp(angles))
    near, asked = OPTIONS.still * travel, requests[part[:-late]] - here
    farthest = float(asked[np.argmax(np.abs(asked))])
    side, far = math.copysign(1.0, farthest), abs(farthest)
    if far <= OPTIONS.refused[1] * travel:
        return False
    outside = np.ones(len(rows), dtype=bool)
    outside[max(part[0] - late, 0) : part[-1] + late] = False
    moved = side * (angles[late:] - angles[:-late])
    error = side * (requests[:-late] - angles[:-late])
    passes = (side * (here - angles[:-late]) >= 0.0) & (side * (angles[late:] - here) >= near)
    return bool(np.any(passes & (moved > near) & (error <= 0.5 * far) & outside[:-late]))


class Contact(NamedTuple):
    """Rows of a log in which something other than its servo holds a joint, or pushes it.

    Attributes:
        rows: The rows, increasing.
        places: In how many places of rest.
        most: How far the joint rests beside its model there at most [rad].
    """

    rows: npt.NDArray[np.int_]
    places: int
    most: float

    def finding(self, log: Log, fate: str) -> Finding:
        """The contact, in this log, and what becomes of its rows."""
        places = "place of rest" if self.places == 1 else "places of rest"
        return Finding(
            "log",
            f"{log.name}: contact: in {self.places} {places} the joint is up to "
            f"{angle_in(log.unit, self.most, digits=2)} beside where its servo would hold it, as "
            f"where an arm stands on a table or on itself: {len(self.rows)} rows between "
            f"{self.rows[0]} and {self.rows[-1]}; {fate}",
        )


def joined(contacts: Sequence[Contact]) -> Contact:
    """Contact of the same log in different rows."""
    rows = np.unique(np.concatenate([contact.rows for contact in contacts]))
    places = sum(contact.places for contact in contacts)
    return Contact(rows, places, max(contact.most for contact in contacts))


def contacts(fits: Sequence[LogFit], noise: float) -> dict[int, Contact]:
    """Where a joint rests much farther beside its model than in other places, by number of the log.

    An arm that stands on a table, or on itself, stays there however far the request is beyond, and
    its other joints are pushed back. Friction holds a joint to both sides of the model, by the same
    amount everywhere: what is far from the median of all places of rest is none. Where many places
    are, it is the model that errs.

    Args:
        fits: What a model makes of each log.
        noise: Standard deviation of the noise [rad].
    """
    places = [(k, rows) for k, fit in enumerate(fits) for rows in _rests(fit, noise)]
    if len(places) < OPTIONS.places:
        return {}
    beside = np.array([np.median(fits[k].residuals[rows]) for k, rows in places])
    middle = float(np.median(beside))
    usual = float(np.median(np.abs(beside - middle))) / 0.6745
    motion = max(float(np.ptp(fit.log.angles[fit.used])) for fit in fits if fit.used.any())
    clear = max(OPTIONS.touching * usual, OPTIONS.clear * noise, 0.01 * motion)
    touching = np.flatnonzero(np.abs(beside - middle) > clear)
    if len(touching) > OPTIONS.some * len(places):
        return {}
    found: dict[int, list[int]] = {}
    for place in touching.tolist():
        found.setdefault(places[place][0], []).append(place)
    contacts = {}
    for k, held in found.items():
        rows = np.zeros(len(fits[k].used), dtype=bool)
        for place in held:
            way = math.copysign(1.0, beside[place] - middle)
            off = way * (fits[k].residuals - middle) > 0.5 * clear
            inside = _around(off, places[place][1])
            rows[inside] = True
        most = float(np.max(np.abs(beside[held] - middle)))
        contacts[k] = Contact(np.flatnonzero(rows), len(held), most)
    return contacts


def _rests(fit: LogFit, noise: float) -> list[npt.NDArray[np.int_]]:
    """Rows before which the request, the joint and its model have rested, by place."""
    length = max(5, round(OPTIONS.rest / fit.log.period))
    if len(fit.used) < length:
        return []
    rests = fit.used.copy()
    for series in (fit.log.requests, fit.log.angles, fit.predicted):
        windows = np.lib.stride_tricks.sliding_window_view(series, length)
        rests[: length - 1] = False
        rests[length - 1 :] &= np.ptp(windows, axis=1) <= OPTIONS.clear * noise
    rows = np.flatnonzero(rests)
    turns = np.flatnonzero(np.diff(rows) > OPTIONS.apart) + 1
    return [place for place in np.split(rows, turns) if len(place)]


def _around(off: npt.NDArray[np.bool_], rows: npt.NDArray[np.int_]) -> slice:
    """The rows without a gap that are off around these."""
    before = np.flatnonzero(~off[: rows[0]])
    after = np.flatnonzero(~off[rows[-1] :])
    first = int(before[-1]) + 1 if len(before) else 0
    return slice(first, int(rows[-1] + after[0]) if len(after) else len(off))


def with_weights(fits: Sequence[LogFit], noise: float) -> tuple[Log, ...] | None:
    """The logs with rows weighed by the error to expect of them; None where that is about even.

    What a model lacks shows most where the joint accelerates most, as test signals do and the
    motions to be planned do not. Rows that count alike would make calm motion pay for it. The error
    is taken to rise with the acceleration on a straight line, from that of the calmest parts of
    :func:`errors_of_motion`, at rest, to the largest. (By what that function tells itself rows at
    rest count so much that the lift of an SO-101 misses unseen motions by 10.3 mrad, not 8.3.)

    Args:
        fits: The logs with a fit to them.
        noise: Standard deviation of the noise of the sensor [rad].
    """
    from scipy.ndimage import uniform_filter1d

    pairs = errors_of_motion(runs_of_fits(fits, held_out=False)).by_acceleration
    if not pairs:
        return None
    most = pairs[-1][1]
    calm, largest = max(pairs[0][1], noise), min(size for size, error in pairs if error == most)
    if most <= OPTIONS.uneven * calm:
        return None
    logs = []
    for fit in fits:
        count = max(1, round(OPTIONS.around / fit.log.period))
        weights, used = np.ones(len(fit.used)), np.flatnonzero(fit.used)
        for rows in np.split(used, np.flatnonzero(np.diff(used) > 1) + 1):
            if len(rows) < 3:
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
    """A note for each pattern that shows.

    Args:
        model: The identified joint.
        fits: What it makes of each log.
        noise: Standard deviation of the noise [rad].
        asymmetry: 95 % interval of its v_offset, where it was identified [rad/s].
        backlash: What :func:`planner.identification.terms.backlash_of` found.
    """
    found = [] if backlash is None else [_backlash(backlash, fits)]
    determined = asymmetry is not None and asymmetry.lower * asymmetry.upper > 0.0
    if determined and abs(model.v_offset) > 0.05 * model.v_max:
        up, down = (model.v_max + way * model.v_offset for way in (1.0, -1.0))
        up_words, down_words = (angle_in(fits[0].log.unit, each, "/s") for each in (up, down))
        found.append(
            Finding(
                "pattern",
                f"asymmetry: the joint reaches {up_words} upwards and {down_words} downwards, as "
                "under a load",
            )
        )
    for fit in fits:
        found += [*_ringing(model, fit, noise), *_drift(fit, noise)]
    return found + _contradictions(fits)


def shaken(model: JointModel, fits: Sequence[LogFit]) -> list[Finding]:
    """A note on each log in which a joint moves to and fro under requests that do not change.

    Whatever shakes it, other joints or the ground, dry friction holds it less than in calm motion.
    On recordings of an arm the dead band that such a log shows is 0.009 rad where slow motion
    shows 0.034; models of two such logs missed up to 56 % of calm motions.
    """
    found = []
    for fit in fits:
        log = fit.log
        length = max(10, round(OPTIONS.rest / log.period))
        settled = length + math.ceil(
            OPTIONS.settled * max(model.latency, OPTIONS.rest / 3.0) / log.period
        )
        rows = np.arange(len(log.times))
        resting = np.zeros(len(rows), dtype=bool)
        resting[1:] = fit.used[1:] & fit.used[:-1]
        resting[1:] &= np.abs(np.diff(fit.predicted)) <= 0.01 * fit.rms
        resting &= np.diff(log.requests, prepend=log.requests[:1]) == 0.0
        since = rows - np.maximum.accumulate(np.where(resting, 0, rows))
        ends = np.flatnonzero(since >= settled)
        if len(ends) < length:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(log.angles, length)[ends - length + 1]
        moved = windows - np.mean(windows, axis=1, keepdims=True)
        size = float(np.sqrt(np.mean(moved**2)))
        alike = float(np.mean(moved[:, 1:] * moved[:, :-1])) / max(size**2, 1e-300)
        if alike > OPTIONS.shaken_alike and size > OPTIONS.shaken * fit.rms:
            found.append(
                Finding(
                    "shaken",
                    f"{log.name}: the joint moves by {angle_in(log.unit, size)} (rms) while its "
                    "request does not change: shaking hides dry friction, and calm motion may be "
                    "further off; record slow motion in which nothing shakes it, such as excite "
                    "--kind slow-triangle",
                )
            )
    return found


def _backlash(found: Backlash, fits: Sequence[LogFit]) -> Finding:
    """The play, in how many places of the logs it shows, and the clearest of them."""
    ends = np.cumsum([np.sum(fit.used) for fit in fits])[:-1]
    pieces = (np.split(each, ends) for each in (found.difference, found.gained))
    places = []
    for fit, difference, gained in zip(fits, *pieces, strict=True):
        shows = difference > OPTIONS.shown * float(np.max(found.difference))
        rows, gains = np.flatnonzero(fit.used)[shows], gained[shows]
        turns = np.flatnonzero(np.diff(rows) > OPTIONS.apart) + 1
        name = f"{fit.log.name} " if len(fits) > 1 and fit.log.name else ""
        for place, gain in zip(np.split(rows, turns), np.split(gains, turns), strict=True):
            if len(place):
                first, last = int(place[0]), int(place[-1])
                times = float(fit.log.times[first]), float(fit.log.times[last])
                words = f"{name}rows {first} to {last} ({times[0]:.2f} to {times[1]:.2f} s)"
                places.append((float(np.sum(gain)), words))
    clearest = sorted(places, key=lambda place: -place[0])[:2]
    angle = partial(angle_in, fits[0].log.unit)
    return Finding(
        "pattern",
        "backlash: after a reversal the joint starts late, as with a play of about "
        f"{angle(found.size, digits=2)} (the error is {angle(found.rms)} with it and "
        f"{angle(found.without)} without, rms); it shows in {len(places)} places, most in "
        f"{' and '.join(words for _, words in clearest)}; friction that gives way late looks "
        "alike: move the joint by hand while the motor holds, where play is free",
    )


def _contradictions(fits: Sequence[LogFit]) -> list[Finding]:
    """Logs in which the joint rests beside the model to different sides, or to other amounts."""
    means = {}
    for fit in fits:
        left = fit.residuals[fit.used]
        if len(left) >= FEW_ROWS:
            means[fit.log.name] = float(np.mean(left)), float(np.std(left))
    if len(means) < 2:
        return []
    low, high = (choose(means, key=lambda name: means[name][0]) for choose in (min, max))
    apart = means[high][0] - means[low][0]
    if apart <= 2.0 * max(means[low][1], means[high][1]):
        return []
    return [
        Finding(
            "pattern",
            "the logs contradict each other: against one model the joint is "
            f"{angle_in(fits[0].log.unit, apart)} higher in {high} than in {low}; was the load, "
            "the zero or the pose another? Identify them apart",
        )
    ]


def _ringing(model: JointModel, fit: LogFit, noise: float) -> list[Finding]:
    """Steps after which the joint goes farther beyond where it comes to rest than its model."""
    log = fit.log
    changes = np.flatnonzero(np.diff(log.requests)) + 1
    ends = np.append(changes, len(log.times))[1:]
    steps, over = 0, []
    for begin, end in zip(changes.tolist(), ends.tolist(), strict=True):
        step = float(log.requests[begin] - log.requests[begin - 1])
        if log.times[end - 1] - log.times[begin] < OPTIONS.settled * model.latency:
            continue
        if abs(step) < OPTIONS.clear * noise:
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
        if modelled > OPTIONS.explained * beyond:
            continue
        if beyond > max(0.05 * rests[0], OPTIONS.clear * noise):
            over.append((begin, beyond / rests[0], max(modelled, 0.0) / rests[0]))
    if len(over) < max(2, 0.5 * steps):
        return []
    _, share, modelled = np.median(over, axis=0)
    return [
        Finding(
            "pattern",
            f"{log.name}: ringing: after {len(over)} of {steps} steps the joint goes "
            f"{100.0 * share:.0f} % too far before it rests, first after row {over[0][0]}; "
            f"the model goes {100.0 * modelled:.0f} % too far",
        )
    ]


def _drift(fit: LogFit, noise: float) -> list[Finding]:
    """Residuals that follow a straight line through the log."""
    used = np.flatnonzero(fit.used)
    if len(used) < FEW_ROWS:
        return []
    times, left = fit.log.times[used], fit.residuals[used]
    line = np.polynomial.Polynomial.fit(times, left, 1)
    change = float(line(times[-1]) - line(times[0]))
    explained = float(np.var(line(times)) / max(np.var(left), 1e-300))
    if explained <= 0.3 or abs(change) <= OPTIONS.clear * noise:
        return []
    first, last = used[[0, -1]]
    return [
        Finding(
            "pattern",
            f"{fit.log.name}: a slow drift: the angles leave the model by "
            f"{angle_in(fit.log.unit, change)} from row {first} to row {last}",
        )
    ]
