"""An identification for a terminal: verdict, parameters, errors beside simpler models, warnings."""

from __future__ import annotations

from collections.abc import Mapping

from planner.identification.result import Identification
from planner.report.identification_parameters import Parameter, parameters, units_of
from planner.report.identification_words import errors, verdict
from planner.report.text_table import NOTHING, text_table

SYMBOLS = {
    "v_max": "top speed v_max",
    "theta_0": "threshold theta_0",
    "gain": "v_max / theta_0",
    "lag": "lag",
    "acceleration_time": "acceleration time",
    "offset": "static sag",
}


def identification_text(identifications: Mapping[str, Identification]) -> str:
    """What was found, the verdict first.

    Args:
        identifications: By joint; "" for one without a name. Several are told in one table.
    """
    if len(identifications) == 1:
        ((joint, identification),) = identifications.items()
        return _one(joint, identification)
    return _several(identifications)


def _one(joint: str, identification: Identification) -> str:
    head = f"{joint}: " if joint else ""
    rows = [
        [SYMBOLS[row.name], row.value, row.interval, row.si or NOTHING, row.judgement]
        for row in parameters(identification)
    ]
    header = ["parameter", "value", "95 % interval", "in SI", "known"]
    if not units_of(identification).si:
        rows, header = [[*row[:3], row[4]] for row in rows], [*header[:3], header[4]]
    lines = [
        head + verdict(identification),
        text_table(header, rows),
        "",
        _errors(identification),
        *(f"warning: {warning}" for warning in identification.warnings),
    ]
    return "\n".join(lines)


def _errors(identification: Identification) -> str:
    units = units_of(identification)
    rows = [
        [
            f"{error.words} ({error.detail})" if error.detail else error.words,
            f"{units.factor * error.rms:.3g}",
            NOTHING if error.held_out is None else f"{units.factor * error.held_out:.3g}",
        ]
        for error in errors(identification)
    ]
    return text_table([f"rms error [{units.angle}]", "all rows", "held out"], rows)


def _several(identifications: Mapping[str, Identification]) -> str:
    accepted = sum(each.accepted for each in identifications.values())
    shown = ("v_max", "theta_0", "gain", "lag", "acceleration_time", "offset")
    rows = []
    for joint, each in identifications.items():
        known = {row.name: row for row in parameters(each)}
        rows.append(
            [
                joint,
                "holds" if each.accepted else "DOES NOT FIT",
                *(_short(known[name]) for name in shown),
                *_told(each),
            ]
        )
    header = ["joint", "model", "v_max", "theta_0", "v_max/theta_0", "lag", "acc. time", "sag"]
    lines = [
        f"the model holds for {accepted} of {len(identifications)} joints",
        text_table([*header, "rms", "held out", "best delay"], rows),
    ]
    for joint, each in identifications.items():
        lines += [f"{joint}: warning: {warning}" for warning in each.warnings]
    return "\n".join(lines)


def _short(row: Parameter) -> str:
    """The value, or what is known of it."""
    unit = row.value.partition(" ")[2]
    return row.value if row.known else f"{row.interval} {unit}".replace("unknown " + unit, "?")


def _told(identification: Identification) -> list[str]:
    units = units_of(identification)
    delay = next((e for e in identification.alternatives if e.name == "delay"), None)
    of_delay = None if delay is None else (delay.held_out_rms or delay.rms)
    return [
        NOTHING if error is None else f"{units.factor * error:.3g} {units.angle}"
        for error in (identification.rms, identification.held_out_rms, of_delay)
    ]
