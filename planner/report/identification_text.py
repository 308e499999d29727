"""An identification for the terminal and for the comments of its model file; a test signal too."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, get_args

import numpy as np

from planner._version import __version__
from planner.files.joint_model import PARAMETER_UNITS
from planner.identification.excitation import Excitation
from planner.identification.result import Identification, Topic
from planner.report.identified_joint import (
    between,
    errors_table,
    explained,
    joints_table,
    of_several,
    parameters,
    parameters_table,
    profile,
    units_of,
    verdict,
)
from planner.report.table import by_columns
from planner.report.wording import rendered_text

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


def identification_text(
    identifications: Mapping[str, Identification], model: str = "joint.toml"
) -> str:
    """The results, the verdict first and the next step last.

    Several joints share a table, and warnings; "" is one without a name.
    """
    if len(identifications) > 1:
        lines = [
            of_several(identifications),
            joints_table(identifications).text(),
            *filter(None, [explained(identifications)]),
            *_shared_warnings(identifications),
        ]
    else:
        ((joint, identification),) = identifications.items()
        lines = [
            (f"{joint}: " if joint else "") + verdict(identification),
            parameters_table(identification).text(),
            "",
            errors_table(identification).text(),
            *filter(None, [profile(identification)]),
            *(f"warning: {warning}" for warning in identification.warnings),
        ]
    return "\n".join([*lines, next_step(identifications, model)])


def next_step(identifications: Mapping[str, Identification], model: str) -> str:
    """The next step, in a line: check the columns, record another signal, or plan."""
    topics = {
        joint or "the joint": {each.topic for each in identification.findings}
        for joint, identification in identifications.items()
    }
    wrong = [joint for joint, open_ in topics.items() if open_ & {"sign", "columns"}]
    if wrong:
        return f"next: check the columns of {_names(wrong)}, as the first warning says"
    needed = {
        kind: which
        for kind, shows in RECORD.items()
        if (which := [joint for joint, open_ in topics.items() if open_ & shows.keys()])
    }
    if needed:
        joints = list(dict.fromkeys(joint for which in needed.values() for joint in which))
        subjects = [
            what
            for kind, which in needed.items()
            for topic, what in RECORD[kind].items()
            if any(topic in topics[joint] for joint in which)
        ]
        kind = next(iter(needed)) if len(needed) == 1 else "combined"
        first = joints[0] if joints[0] in identifications else ""
        likewise = f" (likewise {_names(joints[1:])})" if joints[1:] else ""
        return (
            f"next: record {_names(joints[:1])}{likewise}, which shows {', '.join(subjects)}: "
            f"{_excite(kind, first, identifications[first])}; then identify from all logs"
        )
    refused = [joint or "the joint" for joint, each in identifications.items() if not each.accepted]
    if refused:
        return f"next: find out what holds or loads {_names(refused)}, and record again"
    return f"next: request-planner plan PATH --model {model} -o requests.csv"


def _excite(kind: str, joint: str, identification: Identification) -> str:
    """The command that makes a signal within the requests of the logs, at their rate."""
    requests = np.degrees(np.concatenate([fit.log.requests for fit in identification.fits]))
    low, high = float(np.min(requests)), float(np.max(requests))
    if identification.unit != "rad" or high - low < 0.1:
        return f"request-planner excite --kind {kind}"
    limits = f"{math.ceil(low)}:{math.floor(high)}" if high - low > 4.0 else f"{low:.2f}:{high:.2f}"
    rate = f" --rate-hz {1.0 / identification.fits[0].log.period:.4g}"
    name = f" --joint {shlex.quote(joint)}" if joint else ""
    return f"request-planner excite --kind {kind} --limits-deg {limits}{rate}{name} -o more.csv"


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
    answer = expected.to_dict()
    return {
        "kind": excitation.kind,
        "period_s": excitation.period,
        "centre_deg": math.degrees(excitation.centre),
        "amplitudes_deg": [math.degrees(height) for height in excitation.amplitudes],
        "identifiable": excitation.meaning,
        "parts": [
            {"name": name, "begin_s": begin, "end_s": end, "determines": determines}
            for name, begin, end, determines in excitation.parts
        ],
        "expected": {key: answer[key] for key in ("model", "intervals", "gain_interval")},
        "warnings": list(expected.warnings),
        "requests_deg": np.degrees(excitation.requests).tolist(),
    }


def excitation_text(excitation: Excitation, expected: Identification, *, model: str) -> str:
    """Text on a test signal: what it would determine, its parts, and the expected intervals."""
    estimates, units = parameters(expected), units_of(expected)
    missing = [row.brief for row in estimates if not row.determined]
    rough = [row.brief for row in estimates if row.determined and row.rough]
    each: dict[str, list[str]] = {}
    for part in excitation.parts:
        each.setdefault(part.name, [part.determines]).append(f"{part.begin:.0f} to {part.end:.0f}")
    dead_band = next((term for term in expected.terms if term.name == "dead_band"), None)
    known = ["no" if not row.determined else "roughly" if row.rough else "yes" for row in estimates]
    return rendered_text(
        "excitation.txt",
        of=excitation,
        missing=missing,
        rough=rough,
        parts=by_columns(
            "part",
            each,
            [
                ("time [s]", [", ".join(times) for _, *times in each.values()]),
                ("determines", [what for what, *_ in each.values()]),
            ],
        ),
        model=model,
        expected=by_columns(
            "parameter",
            [row.brief for row in estimates],
            [
                ("identified", [f"{row.value} {row.unit}" for row in estimates]),
                ("95 % interval", [row.interval for row in estimates]),
                ("determined", known),
                ("known", [row.judgement for row in estimates]),
            ],
        ),
        dead_band=dead_band
        and units.factor * (dead_band.interval.upper - expected.model.dead_band),
        inf=math.inf,
        unit=units.angle,
        warnings=expected.warnings,
    )


def remarks() -> tuple[str, ...]:
    """The top of a model file; no date, so that the same logs give the same file."""
    return (f"Identified by request-planner {__version__}; the intervals hold with 95 %.",)


def model_comments(identifications: Mapping[str, Identification]) -> dict[str, dict[str, str]]:
    """The comments on every joint's model: on its keys, and under "" above them."""
    comments = {}
    for joint, each in identifications.items():
        share = each.unit != "rad"
        lines = [verdict(each)]
        if share:
            lines.append("Angles are shares of the joint's range, not radians:")
            lines.append("plan with columns <joint>_range (0 to 1) or <joint>_percent.")
        lines += [f"Warning: {warning}" for warning in each.warnings]
        for fit in each.fits:
            lines.append(f"From {fit.log.name}: {np.sum(fit.used)} of {len(fit.used)} rows.")
        comments[joint] = {"": "\n".join(lines)}
        for key, unit in PARAMETER_UNITS.items():
            interval = each.intervals.get(key)
            known = f", {between(interval).replace('−', '-')}" if interval else ""
            comments[joint][key] = f"[{unit.replace('rad', '1') if share else unit}]{known}"
    return comments
