"""What an identification found out, in sentences: one for each code of a note.

Sentences are templates of ``str.format`` with further formats: ``angle``, ``angle/s`` and
``angle/s^2`` in the unit in which the user writes, to three digits, or to two with ``angle.2``;
``?text|other``, the first where the value is true; and those of ``_LISTS``.
"""

from __future__ import annotations

import math
import string
from collections.abc import Mapping, Sequence
from typing import Any

from planner.exceptions import ANGLE_UNIT
from planner.identification.result import Note

REASONS = (
    "is the joint overloaded, held up by friction or by a limit, or is this another joint's column?"
)

SHARE = (
    "{missed:.0%} of the motion's standard deviation{of_held_out:? in the part that was held out} "
    "(rms {error:angle})"
)

SENTENCES: Mapping[str, str] = {
    # Why a verdict is what it is.
    "misses": "it misses {missed:.0%} of the motion{of_held_out:? in the part that was held out}",
    "misses, as a delay does": "it misses {missed:.0%} of the motion"
    "{of_held_out:? in the part that was held out}, and a mere delay hardly more",
    "hardly better than a delay": "a pure delay predicts nearly as well",
    "simpler predicts better": "{simpler:simpler} predicts better",
    "friction open": "the log does not determine dry friction",
    "shaken": "the joint is shaken",
    "not tested": "it was not tested on rows held out",
    "nothing found": "the log shows neither dry friction nor gravity",
    "no friction": "the log shows no dry friction",
    "no gravity": "the log shows no gravity",
    "moves against": "the joint seems to move against its requests",
    "no motion": "the log holds no motion of the joint",
    "a delay wins": "the error of a pure delay is {ratio:.0%} of its own"
    "{tested:? on rows held out}",
    # How well the model fits.
    "random": "this log holds no motion of the joint: its angles change from row to row at random, "
    "by {signal:angle} (rms); is the torque on, and is this the right column?",
    "held out is faster": "the part that was held out calls for faster motion than the part that "
    "was fitted, which does not say how fast the joint can be: it is predicted with the top speed "
    "of the fit to all rows",
    "no better than a delay": f"the model does not fit: it misses {SHARE}, and a mere delay hardly "
    "more ({mere:angle} in place of {rms:angle})",
    "does not fit": f"the model does not fit: it misses {SHARE}; more than {{most:.0%}} is not "
    "accepted",
    "inexact": f"the model misses {SHARE}",
    "why": REASONS,
    "another scale": "the angles are like the requests but span {actual:angle} beside "
    "{requested:angle}: is the scale of a column wrong? expected actual angles times {up:.3g}, or "
    f"requested ones times {{down:.3g}}; if not, {REASONS}",
    "hardly moves": "the joint hardly moves in this log, by {span:angle} in all: record requests "
    "that span {enough:angle.1} or more, of which friction, play and the sensor's steps are a "
    "smaller part",
    "opposite sign": "the joint seems to move against its requests: its angles correlate by "
    "{likeness:.2f} with requests of the opposite sign {late:.0f} ms before, and by "
    "{same_likeness:.2f} with the requests themselves {same_late:.0f} ms before; invert the sign "
    "of one column{repeats:?, or record motion that does not repeat itself}",
    "exchanged": "the joint seems to move before it is requested to: its angles correlate by "
    "{future:.2f} with the requests {early:.0f} ms later, and by at most {past:.2f} with earlier "
    "ones; are the columns of requested and actual angles exchanged, or the times of one of them "
    "late?",
    "simpler": "{simpler:simpler} predicts better than the model (rms {theirs:angle} against "
    "{ours:angle}): the log is too short or too gentle for more",
    "dry friction": "the log does not determine dry friction: the dead band may be larger by "
    "{friction:angle}, and slow motion further off; record motion that is slow and reverses, such "
    "as excite --kind slow-triangle",
    # What the logs do not determine.
    "top speed": "the joint {reached:?hardly|never} saturates in this log: {known:?only "
    "v_max/theta_0 = {gain:.3g} per second is known|neither v_max nor theta_0 is known}; v_max is "
    "at least {least:angle/s}, and the model has {v_max:angle/s}, no more than this log shows or "
    "calls for; record steps larger than about {steps:angle.1}",
    "threshold": "theta_0 is only known to be less than {most:angle}: record small steps, or slow "
    "motion, in which the joint does not saturate",
    "edge": "{name} ended at the edge of the search, at {value:.3g}: the logs do not say how much "
    "further it would go, and the model probably does not fit this joint",
    "delays": "lag, between {lag:ends} ms, and acceleration_time, between {window:ends} ms, are "
    "not known{loose:?|, but lag + acceleration_time / 2 is, {middle:.3g} ± {half:.2g} ms}: record "
    "more rows a second to tell them apart",
    "delay unknown": "{name} is not known at all: record sudden steps",
    "delay loose": "{name} lies anywhere between {between:ends} ms: record sudden steps to tell it "
    "from other delays",
    # What is odd about the logs.
    "periods": "the logs have periods from {least:.3g} to {most:.3g} ms; the model's is "
    "{period:.3g} ms",
    "turns": "{log}: the actual angle jumps by a whole turn {once:?once|{often} times}, as "
    "encoders do that start again; it is taken to go on",
    "torque off": "{log}: torque is off in {off:.0%} of the rows, which are left out",
    "stop": "{log}: a mechanical stop: in {rows} rows between {first} and {last} the joint stays "
    "at its {largest:?largest|least} angle, {angle:.3g}, while it is requested to go on",
    "contact": "{log}: contact: in {places} {one:?place of rest|places of rest} the joint is up to "
    "{most:angle.2} beside where its servo would hold it, as where an arm stands on a table or on "
    "itself: {rows} rows between {first} and {last}",
    "left out": "these rows are left out",
    "not left out": "too many rows to leave out",
    "glitches": "{log}: left out are {count} measured angles that no joint takes: they jump away "
    "and back within two rows",
    "refuted": "{log}: the joint moves at up to {speed:angle/s} in rows that are not fitted, and "
    "those that are bound its top speed at {most:angle/s}: a limit in the servo was changed, or "
    "something pushed the joint; v_max is the measured speed; record anew with one limit, or leave "
    "out the rows in which it was pushed",
    "faster": "{log}: the joint moves at up to {speed:angle/s}, its least top speed, also in rows "
    "that are not fitted: {left_out:counts}",
    "jitter": "the times of the rows jitter: rows every {period:.3g} ms fit better, and are taken",
    "nothing held out": "nothing was held out: the first half of the log holds no motion to fit",
    # What the joint has and the model has not.
    "shaking": "{log}: the joint moves by {moved:angle} (rms) while its request does not change: "
    "shaking hides dry friction, and calm motion may be further off; record slow motion in which "
    "nothing shakes it, such as excite --kind slow-triangle",
    "backlash": "backlash: after a reversal the joint starts late, as with a play of about "
    "{size:angle.2} (the error is {rms:angle} with it and {without:angle} without, rms); it shows "
    "in {places} places, most in {clearest:places}; friction that gives way late looks alike: move "
    "the joint by hand while the motor holds, where play is free",
    "asymmetry": "asymmetry: the joint reaches {up:angle/s} upwards and {down:angle/s} downwards, "
    "as under a load",
    "contradiction": "the logs contradict each other: against one model the joint is {apart:angle} "
    "higher in {high} than in {low}; was the load, the zero or the pose another? Identify them "
    "apart",
    "ringing": "{log}: ringing: after {over} of {steps} steps the joint goes {share:.0%} too far "
    "before it rests, first after row {row}; the model goes {modelled:.0%} too far",
    "drift": "{log}: a slow drift: the angles leave the model by {change:angle} from row {first} "
    "to row {last}",
}

SIMPLER = {
    "raw": "the request itself",
    "delay": "a mere delay",
    "first_order": "a delay with a first-order lag",
}


def sentence(note: Note, unit: str) -> str:
    """The sentences of a note; angles are in ``unit``, as in a log."""
    kinds = _Kinds(unit)
    return "; ".join(kinds.vformat(SENTENCES[code], (), note.numbers) for code in note.codes)


class _Kinds(string.Formatter):
    """Formats the kinds of numbers that sentences have."""

    def __init__(self, unit: str) -> None:
        self._unit = unit

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.startswith("?"):
            text, _, other = format_spec[1:].partition("|")
            return text if value else other
        if format_spec.startswith("angle"):
            per, _, digits = format_spec.removeprefix("angle").partition(".")
            return _angle(value, self._unit, per, int(digits or 3))
        if format_spec in _LISTS:
            return _LISTS[format_spec](value)
        return str(super().format_field(value, format_spec))


def _angle(value: float, unit: str, per: str, digits: int) -> str:
    """A number with its unit, angles in the unit in which the user writes."""
    if math.isinf(value):
        return "any amount"
    if unit == "rad":
        unit = ANGLE_UNIT.get()
        value = math.degrees(value) if unit == "deg" else value
    unit = "" if unit == "1" else unit
    return f"{float(f'{value:.{digits - 1}e}'):.3g} {unit}{per}".rstrip()


def _places(places: Sequence[tuple[str, int, int, float, float]]) -> str:
    """Rows and times of places in logs, by name."""
    return " and ".join(
        f"{f'{log} ' if log else ''}rows {first} to {last} ({begin:.2f} to {end:.2f} s)"
        for log, first, last, begin, end in places
    )


_LISTS = {
    "simpler": lambda name: SIMPLER[name],
    "ends": lambda ends: f"{1e3 * ends[0]:.0f} and {1e3 * ends[1]:.0f}",
    "counts": lambda counts: ", ".join(f"{count} {what}" for what, count in counts.items()),
    "places": _places,
}
