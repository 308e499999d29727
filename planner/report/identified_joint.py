"""An identification in numbers and words: parameters, errors, verdict; for terminal and page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from planner.files.joint_model import PARAMETER_UNITS
from planner.identification.judgement import is_loose
from planner.identification.parameters import TERMS
from planner.identification.result import Alternative, Identification, Interval
from planner.model.joint import JointModel
from planner.report.page import PARAMETERS
from planner.report.table import NOTHING, Column, Row, Table, raised

ALTERNATIVES = {
    "raw": "the request itself",
    "delay": "best pure delay",
    "first_order": "delay and first-order lag",
}
"""Names of the simpler descriptions."""

COMPARED = {"delay": "the best pure delay", "first_order": "a delay with a first-order lag"}
"""Descriptions that the verdict compares with."""


NOT_KNOWN = "not known"
"""In place of an uninformative interval: without ends, or from zero to infinity."""

ROUGH = 0.2
"""Beyond this part of the estimate the half width of an interval is called rough; the lag is
compared with itself and the acceleration time, and is rough too where a warning says that the log
does not determine it; the static sag is compared with theta_0."""

HARDLY = "hardly at all"
"""How well a parameter is known whose interval is wider to either side than the estimate."""


class Units(NamedTuple):
    """The units of a report; inside, angles are in radians, ``factor`` of which are one.

    Values of joints that are no shares of a range are also given in SI.
    """

    factor: float
    angle: str
    speed: str
    si: bool


@dataclass(frozen=True)
class Parameter:
    """A parameter of an identified joint, with its interval, and how both are shown."""

    name: str  # as in the model's file; `gain` for v_max / theta_0
    estimate: float  # in SI, as the interval
    ends: Interval  # its 95 % interval
    factor: float  # from SI to the unit in which it is shown
    unit: str
    si_unit: str  # "" where the values in SI are not shown
    model: JointModel

    @property
    def words(self) -> str:
        """Its description."""
        return PARAMETERS[self.name][0]

    @property
    def brief(self) -> str:
        """A shorter description."""
        return PARAMETERS[self.name][1]

    @property
    def scaled(self) -> Interval:
        """The interval in the unit in which it is shown."""
        return Interval(*(self.factor * end for end in self.ends))

    @property
    def value(self) -> str:
        """The estimate, with its unit."""
        return f"{figure(self.factor * self.estimate, self.scaled)} {self.unit}"

    @property
    def interval(self) -> str:
        """The interval in the same unit."""
        return between(self.scaled)

    @property
    def si(self) -> str:
        """Both in SI, or nothing."""
        own = f"{figure(self.estimate, self.ends)} {self.si_unit}, {between(self.ends)}"
        return own if self.si_unit else ""

    @property
    def bounded(self) -> bool:
        """Whether it is bounded on both sides."""
        return self.ends.bounded

    @property
    def rough(self) -> bool:
        """Whether its interval is wide, beside the parameter or what it adds to."""
        model, width = self.model, self.ends.upper - self.ends.lower
        if self.name == "lag" and is_loose(model.tick, width, self.estimate):
            return True
        beside = {
            "lag": model.lag + model.acceleration_time,
            "offset": model.theta_0,
            "v_offset": model.v_max,
            "sag_sin": model.most_pose_sag,
            "sag_cos": model.most_pose_sag,
        }
        return not 0.5 * width <= ROUGH * abs(beside.get(self.name, self.estimate))

    @property
    def judgement(self) -> str:
        """How well it is known, in words."""
        lower, upper = (math.isfinite(end) for end in self.ends)
        if between(self.ends) == NOT_KNOWN:
            return "not determined"
        if not lower or not upper:
            return f"only bounded from {'below' if lower else 'above'}"
        half = 0.5 * (self.ends.upper - self.ends.lower)
        only = "only " if self.rough else ""
        if self.name in ("lag", "offset", "v_offset", "sag_sin", "sag_cos"):
            return f"{only}± {two_figures(self.factor * half)} {self.unit}"
        if half > abs(self.estimate):
            return HARDLY
        return f"{only}± {percent_of(half, self.estimate)}"

    @property
    def determined(self) -> bool:
        """Whether the logs determine its approximate value."""
        return self.bounded and self.judgement != HARDLY

    @property
    def short(self) -> str:
        """The value, or its bounds."""
        return self.value if self.bounded else self.bounds

    @property
    def bounds(self) -> str:
        """The interval with its unit, or the end that it has."""
        if self.interval == NOT_KNOWN:
            return NOT_KNOWN
        return f"{self.interval} {self.unit}".replace("at least", "≥").replace("at most", "≤")


def units_of(identification: Identification) -> Units:
    """Degrees for angles; percent for shares of a range."""
    if identification.unit == "rad":
        return Units(math.degrees(1.0), "deg", "deg/s", True)
    return Units(100.0, "% of range", "%/s", False)


def parameters(identification: Identification) -> list[Parameter]:
    """Every parameter with its interval, in the order of :data:`PARAMETERS`."""
    model, units, rows = identification.model, units_of(identification), []
    known = {"gain": (identification.gain, identification.gain_interval)}
    known |= {name: (getattr(model, name), i) for name, i in identification.intervals.items()}
    for name in PARAMETERS:
        estimate, interval = known.get(name, (math.inf, None))
        if interval is None or math.isinf(estimate):  # no limit of the acceleration
            continue
        si_unit = raised(PARAMETER_UNITS.get(name, "1/s"))
        factor, unit = 1.0, si_unit
        if unit == "s":
            factor, unit = 1e3, "ms"
        elif unit == "rad":
            factor, unit = units.factor, units.angle
        elif "rad" in unit:
            factor, unit = units.factor, unit.replace("rad", units.speed.removesuffix("/s"))
        shown = si_unit if units.si and "rad" in si_unit else ""
        rows.append(Parameter(name, estimate, interval, factor, unit, shown, model))
    return rows


def parameters_table(identification: Identification, *, page: bool = False) -> Table:
    """The parameters; SI as notes on a page, in a column on a terminal, where names are short."""
    column = units_of(identification).si and not page
    titles = ("value", "95 % interval", *(("in SI",) if column else ()))
    rows = []
    for row in parameters(identification):
        cells = [row.value, row.interval, *((row.si or NOTHING,) if column else ())]
        if page and row.si:
            cells = [f"{cell}\n{si}" for cell, si in zip(cells, row.si.split(", ", 1), strict=True)]
        kind = "" if row.bounded else "unknown"
        about = row.brief
        if page and not about.startswith(row.words):
            about = row.words if about in row.words else f"{row.words}\n{about}"
        rows.append(Row(about, (*cells, row.judgement), kind=kind))
    columns = (*map(Column, titles), Column("known", words=True))
    return Table("parameter", columns, tuple(rows), label="Parameters")


def telling(of: Identification | Alternative) -> float:
    """The error on rows held out, where there are any [rad]."""
    return of.rms if of.held_out_rms is None else of.held_out_rms


def errors_table(identification: Identification) -> Table:
    """The errors of the simpler descriptions, and of the joint model at the end."""
    factor, rows = units_of(identification).factor, []
    every: tuple[Alternative | Identification, ...]
    every = *identification.alternatives, identification
    for each in every:
        about = "the joint model"
        if isinstance(each, Alternative):
            times = (each.parameters.get(name) for name in ("delay", "time_constant"))
            detail = " + ".join(f"{1e3 * time:.0f} ms" for time in times if time is not None)
            about = ALTERNATIVES.get(each.name, each.name) + (f"\n{detail}" if detail else "")
        sizes = (None if e is None else factor * e for e in (each.rms, each.held_out_rms))
        cells = tuple(NOTHING if size is None else f"{size:.3g}" for size in sizes)
        rows.append(Row(about, cells, kind="model" if each is identification else ""))
    columns = (Column("all rows"), Column("held out"))
    unit = units_of(identification).angle
    return Table(f"rms error [{unit}]", columns, tuple(rows), label="Errors")


def verdict(identification: Identification) -> str:
    """Whether the model holds, and what it adds, in one sentence."""
    units, (error, where) = units_of(identification), telling_error(identification)
    by_name = {each.name: telling(each) for each in identification.alternatives}
    words = {
        "holds": "the model holds",
        "usable": "the model is usable, but not exact",
        "worse than a delay": "a pure delay serves better, plan with --method shift",
        "refused": "THE MODEL DOES NOT FIT",
    }
    phrases = [
        f"{words[identification.verdict]}: {units.factor * error:.3g} {units.angle} rms {where}",
        f"{percent_of(error, identification.signal)} of the motion",
        *(
            f"{compared_with(error, by_name[name])} {other}"
            for name, other in COMPARED.items()
            if name in by_name
        ),
    ]
    return ", ".join(phrases)


def of_several(identifications: Sequence[Identification]) -> str:
    """For how many joints the model holds, and for how many it is usable, in a sentence."""
    verdicts = [each.verdict for each in identifications]
    usable = verdicts.count("usable")
    more = f", and is usable, but not exact, for {usable} more" if usable else ""
    return f"the model holds for {verdicts.count('holds')} of {len(verdicts)} joints{more}"


def joints_table(identifications: Mapping[str, Identification]) -> Table:
    """Every joint in a row: its verdict, the parameters that some joint has, and its errors."""
    names, rows = shown_parameters(identifications), list[Row]()
    for joint, each in identifications.items():
        units, values = units_of(each), {row.name: row.short for row in parameters(each)}
        delays = [telling(other) for other in each.alternatives if other.name == "delay"]
        of_rows = (each.rms, each.held_out_rms, delays[0] if delays else None)
        cells = (
            "DOES NOT FIT" if each.verdict == "refused" else each.verdict,
            *(values.get(name, NOTHING) for name in names),
            *(NOTHING if e is None else f"{units.factor * e:.3g} {units.angle}" for e in of_rows),
        )
        rows.append(Row(joint or "unnamed", cells, kind="" if each.accepted else "broken"))
    titles = ("model", *(PARAMETERS[name][1] for name in names), "rms", "held out", "best delay")
    return Table("joint", tuple(map(Column, titles)), tuple(rows), label="Joints")


def shown_parameters(identifications: Mapping[str, Identification]) -> list[str]:
    """The parameters that some joint has."""
    rows = (row for each in identifications.values() for row in parameters(each))
    return list(dict.fromkeys(row.name for row in rows))


def explained(identifications: Mapping[str, Identification]) -> str:
    """Explanations of parameters that not every joint has, in a sentence; empty for none."""
    rare = [name for name in shown_parameters(identifications) if name in TERMS.values()]
    return "; ".join(": ".join(reversed(PARAMETERS[name])) for name in rare)


def profile(identification: Identification) -> str:
    """Where a limit of the acceleration may come from, in a sentence; empty where none is known."""
    for row in parameters(identification) if identification.verdict != "refused" else ():
        if row.name == "max_acceleration" and row.determined:
            return (
                f"The joint accelerates by at most {row.short}: a weak motor, or a profile of the "
                "servo's own, of acceleration or of speed, which is better switched off (Dynamixel "
                "X: Profile Acceleration, address 108, and Profile Velocity, 112, at 0; Feetech "
                "STS: acceleration, 41, and goal speed, 46, at 0)."
            )
    return ""


def telling_error(identification: Identification) -> tuple[float, str]:
    """The error on rows held out, where there are any [rad], and on which rows it was measured."""
    held_out = identification.held_out_rms is not None
    where = "on rows held out" if held_out else "on the rows it was fitted to"
    return telling(identification), where


def compared_with(error: float, other: float) -> str:
    """How an error compares with another one, as in "2.5 times closer than"."""
    ratio = other / error if error > 0.0 else math.inf
    if ratio >= 1.05:
        times = "infinitely" if math.isinf(ratio) else f"{ratio:.{1 if ratio < 10 else 0}f} times"
        return f"{times} closer than"
    if ratio > 0.95:
        return "no closer than"
    return f"{f'{1.0 / ratio:.1f} times' if ratio > 0.0 else 'infinitely'} farther off than"


def figure(value: float, interval: Interval) -> str:
    """A number with as many decimals as its interval deserves."""
    text = f"{value:.{_decimals(value, interval)}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def between(interval: Interval) -> str:
    """An interval in words."""
    lower, upper = (math.isfinite(end) for end in interval)
    if lower and upper:
        return f"{figure(interval.lower, interval)} to {figure(interval.upper, interval)}"
    if lower and interval.lower != 0.0:
        return f"at least {figure(interval.lower, interval)}"
    return f"at most {figure(interval.upper, interval)}" if upper else NOT_KNOWN


def _decimals(value: float, interval: Interval) -> int:
    """Two figures of the interval's half width, or more where else nothing of the number is left.

    Where the interval is infinite, three figures of the number.
    """
    own = 2 - math.floor(math.log10(abs(value))) if value else 1
    half = 0.5 * (interval.upper - interval.lower)
    if math.isfinite(half) and half > 0.0:
        of_half = 1 - math.floor(math.log10(half))
        own = max(of_half, min(own - 1, of_half + 2))
    return min(6, max(0, own))


def percent_of(part: float, whole: float) -> str:
    """A part of a whole in percent."""
    return f"{two_figures(100.0 * part / abs(whole))} %" if whole else "∞ %"


def two_figures(number: float) -> str:
    """A positive number with two figures, or all that stand before the point."""
    return f"{number:.2g}" if number < 99.5 else f"{number:.0f}"
