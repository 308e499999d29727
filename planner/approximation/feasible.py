"""Whether requirements can be met at all; if not, which two of them contradict each other."""

from __future__ import annotations

import math

import numpy as np

from planner.approximation.question import Question
from planner.approximation.requirements import BARELY_SHORT
from planner.exceptions import Infeasible, InvalidInput
from planner.trajectory import Array

ROUNDING = 1e-13
"""Relative excess of a slope between two pins over v_max that is left to rounding."""


def check_feasible(question: Question) -> None:
    """Raise Infeasible, with the pair that is to blame, if no curve can be as required.

    Raises:
        Infeasible: Two required angles are too far apart, two required knots too close, or there is
            no room for so many or so few segments.
        InvalidInput: A required knot lies between samples where knots must lie on them.
    """
    if question.on_samples:
        between = question.required[question.required != np.floor(question.required)]
        if between.size:
            raise InvalidInput(
                f"required: got a knot at {between[0]:g} with on_samples, expected whole numbers"
            )
    _check_slopes(question)
    _check_lengths(question)
    if question.max_error is not None:
        _check_errors(question, question.max_error)


def _around(question: Question, places: Array) -> Array:
    """Places with the first one again at the end, a cycle later."""
    return np.append(places, places[0] + question.desired.size)


def _check_slopes(question: Question) -> None:
    pinned = np.isfinite(question.pins)
    places, angles = question.required[pinned], question.pins[pinned]
    if places.size < 2:
        return
    if question.cyclic:
        places, angles = _around(question, places), np.append(angles, angles[0])
    slopes = np.diff(angles) / (np.diff(places) * question.tick)
    k = int(np.argmax(np.abs(slopes)))
    if abs(slopes[k]) > question.v_max * (1.0 + ROUNDING):
        n = question.desired.size
        raise Infeasible(
            f"required angles {angles[k]:.6g} rad at sample {places[k]:g} and {angles[k + 1]:.6g} "
            f"rad at sample {places[k + 1] % n:g}: got a slope of {slopes[k]:.6g} rad/s between "
            f"them, expected at most v_max = {question.v_max:.6g} rad/s; move one of them or allow "
            "a larger v_max"
        )


def _check_lengths(question: Question) -> None:
    n, shortest = question.desired.size, question.shortest
    length = float(n if question.cyclic else n - 1)
    places = question.required
    if not question.cyclic:
        places = np.unique(np.concatenate([[0.0], places, [n - 1.0]]))
    elif places.size:
        places = _around(question, places)
    else:
        places = np.array([0.0, n])
    apart = np.diff(places)
    k = int(np.argmin(apart))
    if apart[k] < shortest - BARELY_SHORT:
        raise Infeasible(
            f"required knots at samples {places[k]:g} and {places[k + 1] % n:g}: {apart[k]:g} "
            f"samples apart, expected at least shortest = {shortest:g}; leave one away or allow "
            "shorter segments"
        )
    unit = math.ceil(shortest - BARELY_SHORT) if question.on_samples else shortest
    most = int(np.sum(np.floor(apart / unit + BARELY_SHORT)))
    fewest = apart.size
    segments = question.segments
    ceiling = question.max_error is not None or question.max_rms is not None
    if segments is not None and segments > most and not ceiling:
        raise Infeasible(
            f"segments = {segments} and shortest = {shortest:g} samples: there is room for {most} "
            f"in {length:g} samples{' between the required knots' if fewest > 1 else ''}; ask for "
            "fewer or allow shorter ones"
        )
    if segments is not None and segments < fewest:
        raise Infeasible(
            f"segments = {segments} and {question.required.size} required knots: they make at "
            f"least {fewest} segments; ask for more or leave some away"
        )
    if question.cyclic and most < 2 and bool(np.ptp(question.desired)):
        raise Infeasible(
            f"shortest = {shortest:g} and a cycle of {n} samples: there is room for one segment, "
            "and a closed curve that moves needs two; allow shorter ones"
        )


def _check_errors(question: Question, bound: float) -> None:
    """Whether a required angle is further than the bound from a sample, wherever the curve goes."""
    n, step = question.desired.size, question.v_max * question.tick
    samples = np.arange(n, dtype=np.float64)
    for place, angle in zip(question.required, question.pins, strict=True):
        if not math.isfinite(angle):
            continue
        away = np.abs(samples - place)
        if question.cyclic:
            away = np.minimum(away, n - away)
        least = np.abs(question.desired - angle) - step * away
        k = int(np.argmax(least))
        if least[k] > bound * (1.0 + 1e-9):
            raise Infeasible(
                f"required angle {angle:.6g} rad at sample {place:g} and max_error: with slopes "
                f"within ±v_max the error at sample {k} is at least {least[k]:.6g} rad, expected "
                f"at most {bound:.6g} rad; move the angle or allow more error"
            )
