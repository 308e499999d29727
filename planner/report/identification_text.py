"""An identification, or a test signal, in numbers and words: text, page and model file."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np

from planner._version import __version__
from planner.files.joint_model import PARAMETER_UNITS
from planner.identification.excitation import Excitation
from planner.identification.judgement import is_loose
from planner.identification.parameters import TERMS
from planner.identification.result import Identification, Interval, Topic, telling_error
from planner.report.page import PARAMETERS, shown_in
from planner.report.wording import (
    UNITS,
    Row,
    Table,
    phrase,
    rendered_text,
    signed,
    table,
    table_with_units,
    two_digits,
)

ALTERNATIVES = {
    "raw": ("the request itself", ""),
    "delay": ("best pure delay", "the best pure delay"),
    "first_order": ("delay and first-order lag", "a delay with a first-order lag"),
}
"""Names of the simpler descriptions in a table, and where the verdict compares with them."""

NOT_KNOWN = "not known"
"""In place of an uninformative interval: without ends, or from zero to infinity."""

HARDLY = "hardly at all"
"""How well a parameter is known whose interval is wider to either side than the estimate."""

REMARKS = (f"Identified by request-planner {__version__}; the intervals hold with 95 %.",)
"""The top of a model file; no date, so that the same logs give the same file."""

RECORD: dict[str, dict[Topic, str]] = {
    "steps": {
        "motion": "larger motion",
        "simpler": "more motion",
        "top speed": "top speed",
        "delays": "delays",
    },
    "slow-triangle": {"friction": "dry friction", "shaken": "calm motion", "threshold": "theta_0"},
}
"""Signals of `excite` that settle a topic, and what each shows; for several, the combined one."""


class Parameter(NamedTuple):
    """A parameter of an identified joint, with its 95 % interval, and how both are shown."""

    name: str  # as in the model's file; `gain` for v_max / theta_0
    brief: str  # its description
    estimate: float  # in SI, as the interval
    ends: Interval
    factor: float  # from SI to the unit in which it is shown
    unit: str
    value: str  # in this unit, as the interval
    interval: str
    si: tuple[str, str] | None  # both in SI, where that is another unit
    rough: bool  # whether its interval is wide, beside the parameter or what it adds to
    judgement: str  # how well it is known, in words

    @property
    def determined(self) -> bool:
        """Whether the logs determine its approximate value."""
        return self.ends.bounded and self.judgement != HARDLY

    @property
    def known(self) -> str:
        """Whether it is determined, in a word."""
        return "no" if not self.determined else "roughly" if self.rough else "yes"

    @property
    def bounds(self) -> tuple[str, str]:
        """The interval, or the end that it has, and the unit."""
        if self.interval == NOT_KNOWN:
            return NOT_KNOWN, ""
        return self.interval.replace("at least", "≥").replace("at most", "≤"), self.unit

    @property
    def short(self) -> tuple[str, str]:
        """The value, or its bounds, and the unit."""
        return (self.value, self.unit) if self.ends.bounded else self.bounds


def parameters(identification: Identification) -> list[Parameter]:
    """Every parameter with its interval, in the order of :data:`PARAMETERS`."""
    model, units, rows = identification.model, UNITS[identification.unit], list[Parameter]()
    intervals = {**identification.intervals, "gain": identification.gain_interval}
    beside = {
        "lag": model.lag + model.acceleration_time,
        "offset": model.theta_0,
        "v_offset": model.v_max,
        "sag_sin": model.most_pose_sag,
        "sag_cos": model.most_pose_sag,
    }
    for name in filter(intervals.__contains__, PARAMETERS):
        estimate = getattr(model, name)
        if math.isinf(estimate):  # no limit of the acceleration
            continue
        (factor, unit), ends, si = shown_in(name, units), intervals[name], None
        if "deg" in unit:
            words = unit.replace("deg", "rad")
            si = (f"{rounded_by(estimate, ends)} {words}", between(ends))
        shown, half = Interval(*(factor * end for end in ends)), 0.5 * (ends.upper - ends.lower)
        rough = not half <= 0.2 * abs(beside.get(name, estimate))
        # beside itself, too, where a warning says that the log does not determine it
        rough |= name == "lag" and is_loose(model.tick, 2.0 * half, estimate)
        interval, known = between(shown), "only " if rough else ""
        if interval == NOT_KNOWN:
            known = "not determined"
        elif not ends.bounded:
            known = f"only bounded from {'below' if math.isfinite(ends.lower) else 'above'}"
        elif name in beside:
            known += f"± {two_digits(factor * half)} {unit}"
        else:
            known = HARDLY if half > abs(estimate) else f"{known}± {percent_of(half, estimate)}"
        brief, value = PARAMETERS[name][1], rounded_by(factor * estimate, shown)
        rows.append(
            Parameter(name, brief, estimate, ends, factor, unit, value, interval, si, rough, known)
        )
    return rows


def numbers_of(identification: Identification) -> dict[str, Any]:
    """What the tables of an identification show."""
    return {
        "of": identification,
        "units": UNITS[identification.unit],
        "estimates": parameters(identification),
        "descriptions": PARAMETERS,
        "alternatives": ALTERNATIVES,
    }


def verdict(identification: Identification) -> str:
    """Whether the model holds, and what it adds, in one sentence."""
    units, (error, where) = UNITS[identification.unit], telling_error(identification)
    others = {each.name: telling_error(each)[0] for each in identification.alternatives}
    return phrase(
        "identification.txt",
        "verdict",
        of=identification,
        size=" ".join(units.sized(error)),
        where=where,
        share=percent_of(error, identification.signal),
        ratios={
            words: others[name] / error if error > 0.0 else math.inf
            for name, (_, words) in ALTERNATIVES.items()
            if words and name in others
        },
        infinite=math.inf,
    )


def of_several(identifications: Mapping[str, Identification]) -> str:
    """For how many joints the model holds, and for how many it is usable, in a sentence."""
    verdicts = [each.verdict for each in identifications.values()]
    return phrase("identification.txt", "several", verdicts=verdicts)


def profile(identification: Identification) -> str:
    """Where a limit of the acceleration may come from, in a sentence; empty where none is known."""
    estimates = parameters(identification)
    return phrase("identification.txt", "profile", of=identification, estimates=estimates)


def joints_table(identifications: Mapping[str, Identification], *, page: bool = False) -> Table:
    """Every joint in a row; on a page a unit that a whole column has stands in its title."""
    every, briefs = list[tuple[Row, dict[str, tuple[str, str]]]](), []
    for joint, each in identifications.items():
        sized, estimates = UNITS[each.unit].sized, parameters(each)
        word = "DOES NOT FIT" if each.verdict == "refused" else each.verdict
        delays = (telling_error(other)[0] for other in each.alternatives if other.name == "delay")
        cells = {"model": (word, ""), **{row.brief: row.short for row in estimates}}
        cells |= {"rms": sized(each.rms), "held out": sized(each.held_out_rms)}
        cells["best delay"] = sized(next(delays, None))
        briefs += [row.brief for row in estimates]
        kind = "" if each.accepted else "broken"
        every.append((Row(joint or "unnamed", kind=kind), cells))
    titles = [brief for _, brief in PARAMETERS.values() if brief in briefs]
    titles = ["model", *titles, "rms", "held out", "best delay"]
    return table_with_units("joint", titles, every, "Joints", page=page)


def explained(identifications: Mapping[str, Identification]) -> str:
    """Explanations of parameters that not every joint has, in a sentence; empty for none."""
    shown = {row.name for each in identifications.values() for row in parameters(each)}
    rare = [name for name in PARAMETERS if name in shown.intersection(TERMS.values())]
    return "; ".join(": ".join(reversed(PARAMETERS[name])) for name in rare)


def rounded_by(value: float, interval: Interval) -> str:
    """A number with two figures of its interval's half width; or three, if that is infinite."""
    decimals = 2 - math.floor(math.log10(abs(value))) if value else 1
    half = 0.5 * (interval.upper - interval.lower)
    if math.isfinite(half) and half > 0.0:
        of_half = 1 - math.floor(math.log10(half))
        decimals = max(of_half, min(decimals - 1, of_half + 2))
    text = f"{value:.{min(6, max(0, decimals))}f}"
    return signed(text) if float(text) else text.lstrip("-")


def between(interval: Interval) -> str:
    """An interval in words."""
    lower, upper = (math.isfinite(end) for end in interval)
    if lower and upper:
        return f"{rounded_by(interval.lower, interval)} to {rounded_by(interval.upper, interval)}"
    if lower and interval.lower != 0.0:
        return f"at least {rounded_by(interval.lower, interval)}"
    return f"at most {rounded_by(interval.upper, interval)}" if upper else NOT_KNOWN


def percent_of(part: float, whole: float) -> str:
    """A part of a whole in percent."""
    return f"{two_digits(100.0 * part / abs(whole))} %" if whole else "∞ %"


def identification_text(
    identifications: Mapping[str, Identification], model: str = "joint.toml"
) -> str:
    """The results, the verdict first and the next step last; "" is a joint without a name."""
    if len(identifications) > 1:
        joints, more = joints_table(identifications).text(), explained(identifications)
        lines = [of_several(identifications), joints, more, *_shared_warnings(identifications)]
    else:
        ((joint, found),) = identifications.items()
        tables = [table(name, **numbers_of(found)).text() for name in ("parameters", "errors")]
        warnings = (f"warning: {warning}" for warning in found.warnings)
        whose = f"{joint}: " if joint else ""
        lines = [whose + verdict(found), "\n\n".join(tables), profile(found), *warnings]
    return "\n".join([*filter(None, lines), next_step(identifications, model)])


def next_step(identifications: Mapping[str, Identification], model: str) -> str:
    """The next step, in a line: check the columns, record another signal, or plan."""
    topics = {
        joint or "the joint": {each.topic for each in identification.findings}
        for joint, identification in identifications.items()
    }
    wrong = [joint for joint, open_ in topics.items() if open_ & {"sign", "columns"}]
    if wrong:
        return f"next: check the columns of {_names(wrong)}, as the first warning says"
    needed, subjects = dict[str, set[str]](), list[str]()
    for kind, shows in RECORD.items():
        for topic, what in shows.items():
            if which := {joint for joint, open_ in topics.items() if topic in open_}:
                needed[kind] = needed.get(kind, set()) | which
                subjects.append(what)
    if needed:
        joints = [joint for joint in topics if joint in set().union(*needed.values())]
        kind = next(iter(needed)) if len(needed) == 1 else "combined"
        first = joints[0] if joints[0] in identifications else ""
        likewise = f" (likewise {_names(joints[1:])})" if joints[1:] else ""
        return (
            f"next: record {_names(joints[:1])}{likewise}, which shows {', '.join(subjects)}: "
            f"{_excite(kind, first, identifications[first], model)}; then identify from all logs"
        )
    refused = [joint or "the joint" for joint, each in identifications.items() if not each.accepted]
    if refused:
        return f"next: find out what holds or loads {_names(refused)}, and record again"
    return f"next: request-planner plan PATH --model {model} -o requests.csv"


def _excite(kind: str, joint: str, identification: Identification, model: str) -> str:
    """The command that makes a signal within the requests of the logs, at their rate.

    Where a finding asks for larger motion it is that, about the same middle. Shares of a range are
    written in percent, which `excite` takes with a model in shares.
    """
    share, command = identification.unit != "rad", f"request-planner excite --kind {kind}"
    scale, most = UNITS[identification.unit].factor, 100.0 if share else 720.0  # as `excite` takes
    requests = scale * np.concatenate([fit.log.requests for fit in identification.fits])
    low, high = float(np.min(requests)), float(np.max(requests))
    needed = min(scale * max(each.record for each in identification.findings), most)
    larger = needed > high - low
    if larger:
        low, high = 0.5 * (low + high - needed), 0.5 * (low + high + needed)
        low, high = float(math.floor(low)), float(math.ceil(high))
        low, high = (max(low, 0.0), min(high, 100.0)) if share else (low, high)
    if high - low < 0.1:
        return command
    limits = f"{math.ceil(low)}:{math.floor(high)}" if high - low > 4.0 else f"{low:.2f}:{high:.2f}"
    rate = f" --rate-hz {1.0 / identification.fits[0].log.period:.4g}"
    name = f" --joint {shlex.quote(joint)}" if joint else ""
    name = f" --model {shlex.quote(model)}{name}" if share else name
    note = ", or as far as the joint can move" if larger else ""
    return f"{command} --limits-deg {limits}{rate}{name} -o more.csv{note}"


def _names(joints: Sequence[str]) -> str:
    """The first three of the joints, and how many more there are, if that is more than one."""
    if len(joints) > 4:
        return f"{', '.join(joints[:3])} and {len(joints) - 3} more"
    return " and ".join(filter(None, [", ".join(joints[:-1]), joints[-1]]))


def _shared_warnings(identifications: Mapping[str, Identification]) -> list[str]:
    """A line for each warning, once for all its joints, with the joint whose numbers it has."""
    shared: dict[tuple[Topic, str], dict[str, str]] = {}
    for joint, each in identifications.items():
        for finding in each.findings:
            own = finding.topic in ("log", "pattern")  # of which there are many kinds
            key = finding.topic, re.sub(r"[\d.]+", "", finding.words) if own else ""
            shared.setdefault(key, {}).setdefault(joint, finding.words)
    lines, topics = list[str](), get_args(Topic)
    for key in sorted(shared, key=lambda key: topics.index(key[0])):
        first, text = next(iter(shared[key].items()))
        several = len(set(shared[key].values())) > 1
        whose = f" (the numbers are those of {first})" if several else ""
        lines.append(f"{_names(list(shared[key]))}: warning: {text}{whose}")
    return lines


def excitation_results(excitation: Excitation, expected: Identification) -> dict[str, Any]:
    """A test signal, and what it is expected to show, for machines."""
    answer, unit = expected.to_dict(), UNITS[expected.unit]
    return {
        "kind": excitation.kind,
        "period_s": excitation.period,
        f"centre_{unit.name}": unit.factor * excitation.centre,
        f"amplitudes_{unit.name}": [unit.factor * height for height in excitation.amplitudes],
        "identifiable": shown_by(excitation),
        "parts": [
            {"name": name, "begin_s": begin, "end_s": end, "determines": determines}
            for name, begin, end, determines in excitation.parts
        ],
        "expected": {key: answer[key] for key in ("model", "intervals", "gain_interval")},
        "warnings": list(expected.warnings),
        f"requests_{unit.name}": (unit.factor * excitation.requests).tolist(),
    }


def shown_by(excitation: Excitation) -> str:
    """What a signal makes identifiable."""
    return " ".join(phrase("signals.txt", excitation.kind).split())


def excitation_text(excitation: Excitation, expected: Identification, *, model: str) -> str:
    """Text on a test signal: what it would determine, its parts, and the expected intervals."""
    units, each = UNITS[expected.unit], dict[str, list[str]]()
    for part in excitation.parts:
        each.setdefault(part.name, [part.determines]).append(f"{part.begin:.0f} to {part.end:.0f}")
    dead_band = next((term for term in expected.terms if term.name == "dead_band"), None)
    estimates = parameters(expected)
    return rendered_text(
        "excitation.txt",
        of=excitation,
        meaning=shown_by(excitation),
        estimates=estimates,
        parts=Table(
            "part",
            ("time [s]", "determines"),
            (Row(name, (", ".join(times), what)) for name, (what, *times) in each.items()),
        ),
        model=model,
        dead_band=dead_band
        and units.factor * (dead_band.interval.upper - expected.model.dead_band),
        inf=math.inf,
        unit=units,
        warnings=expected.warnings,
    )


def model_comments(identifications: Mapping[str, Identification]) -> dict[str, dict[str, str]]:
    """The comments on every joint's model: on its keys, and under "" above them."""
    comments = {}
    for joint, each in identifications.items():
        lines = [verdict(each)]
        if each.unit != "rad":
            lines.append("Angles are shares of the joint's range, not radians:")
            lines.append("plan with columns <joint>_range (0 to 1) or <joint>_percent.")
        lines += [f"Warning: {warning}" for warning in each.warnings]
        for fit in each.fits:
            lines.append(f"From {fit.log.name}: {np.sum(fit.used)} of {len(fit.used)} rows.")
        comments[joint] = {"": "\n".join(lines)}
        for key, unit in PARAMETER_UNITS.items():
            interval = each.intervals.get(key)
            known = f", {between(interval).replace('−', '-')}" if interval else ""
            comments[joint][key] = f"[{unit}]{known}"
    return comments
