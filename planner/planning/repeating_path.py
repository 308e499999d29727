"""A path that about repeats, such as that of a walking robot, and how it will probably go on.

The rows that followed the nearest of the stretches that ended about a cycle ago, shifted to end at
the same angles, continue the path. Their weight is the coefficient of determination, times the
share by which earlier continuations were nearer to the present preview than the last row known
then: the nearest of many stretches explains a share of any path, also of one that never repeats.

Compiled as a part of ``tick``: import this module where it is used, inside functions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.compilation import compiled, inner


class Repeating(NamedTuple):
    """The path over the last cycle, as far as it was known; k joints."""

    rows: Array  # angles, the present preview at the end [rad], (k, longest cycle + preview)
    expected: Array  # rows from the first of the preview on, and the row held, (2, k, m)
    counts: Array  # weights of the expected rows, (m,)
    errors: Array  # sums of squares of the errors of both [rad^2], (2,)
    preview: int  # rows that are known at every tick
    cycle: int  # rows after which the path about repeats
    shortest: int  # cycle
    ahead: int  # rows by which the known ones are continued; 0 where no cycle is expected


def repeating_path(joints: int, preview: int, cycle: int, *, ahead: int) -> Repeating:
    """Allocate the memory for joints that repeat together, continued by ``ahead`` rows at most."""
    # Cycles vary by a quarter. Over walks whose speed changes errors are 6.0 % above those of whole
    # plans, with half of it 9.1 %, with twice of it 5.9 %.
    shortest, longest = round(0.75 * cycle), round(1.25 * cycle)
    ahead = max(min(ahead, shortest), 0)
    rows = np.full((joints, longest + preview), math.nan)
    expected = np.full((2, joints, preview + min(preview, ahead)), math.nan)
    counts, errors = np.zeros(expected.shape[2]), np.zeros(2)
    return Repeating(rows, expected, counts, errors, preview, cycle, shortest, ahead)


@compiled
def continue_path(path: Repeating, stretch: Array, bad: Mask, periods: int, weights: Array) -> None:
    """Add the present preview to the path, and continue the stretch (k, preview + ahead) [rad].

    The rows of joints without a valid preview, ``bad``, do not change; ``periods`` is the time
    since the last call. Filled are the weights of the continued rows, (k,), from 0, where nothing
    is known of them, to 1.
    """
    rows, errors, preview, ahead = path.rows, path.errors, path.preview, path.ahead
    count, longest = len(stretch), rows.shape[1] - preview
    # Let time pass, and compare the rows of the preview with those expected earlier
    # Over walks whose speed changes errors are 6.0 % above those of whole plans, with half of this
    # time constant, a cycle, 7.9 %, with twice of it 5.9 %; over random walks 2.7, 3.2 and 3.1 %
    # above those of streams without a cycle.
    kept = math.exp(-periods / path.cycle)
    errors[0], errors[1] = kept * errors[0], kept * errors[1]
    move_on(path.counts, periods)
    for j in range(count):
        move_on(rows[j], periods)
        for which in range(2):
            expected = path.expected[which, j]
            move_on(expected, periods)
            for i in range(preview):
                if not (bad[j] or np.isnan(expected[i])):
                    errors[which] += path.counts[i] * (stretch[j, i] - expected[i]) ** 2
                expected[i] = np.nan
    # The nearest stretch, which ended `longest - number` rows ago; of equals that of a cycle ago
    distances, spread = np.zeros(longest - path.shortest + 1), 0.0
    for j in range(count):
        mean, last, own = 0.0, stretch[j, preview - 1], rows[j]
        for i in range(preview):
            mean += stretch[j, i] / preview
        for i in range(preview):
            spread += (stretch[j, i] - mean) ** 2
            if not bad[j]:
                own[longest + i] = stretch[j, i]
        for i in range(0 if bad[j] else preview):
            away, before, ends = stretch[j, i] - last, own[i:], own[preview - 1 :]
            for number in range(len(distances)):
                distances[number] += (before[number] - ends[number] - away) ** 2
    nearest = usual = longest - path.cycle
    for number in range(len(distances)):
        if distances[number] < distances[nearest] or (
            distances[number] == distances[nearest] and abs(number - usual) < abs(nearest - usual)
        ):
            nearest = number
    unknown = np.isnan(distances[usual])
    explained = max(0.0, 1.0 - distances[nearest] / max(spread, 1e-12))
    reliable = max(0.0, 1.0 - errors[0] / max(errors[1], 1e-12))
    tested = path.expected.shape[2] - 1  # the row after the known ones that is tested
    for j in range(count):
        last, begin, own = stretch[j, preview - 1], nearest + preview, rows[j]
        follows = not (unknown or bad[j])
        for i in range(begin, begin + ahead):
            follows = follows and not np.isnan(own[i])
        for i in range(ahead):
            moved = own[begin + i] - own[begin - 1]
            stretch[j, preview + i] = last + moved if follows else last
        weights[j] = explained * reliable if follows else 0.0
        if follows:
            path.expected[0, j, tested], path.expected[1, j, tested] = stretch[j, tested], last
    if not unknown:
        path.counts[tested] = explained


@inner
def move_on(values: Array, periods: int) -> None:
    """Drop the first values; the new ones at the end are NaN, not yet known."""
    stop = max(len(values) - periods, 0)
    for i in range(len(values)):
        values[i] = values[i + periods] if i < stop else np.nan
