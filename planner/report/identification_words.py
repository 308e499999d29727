"""An identification in words, for the terminal and for the page alike."""

from __future__ import annotations

from typing import NamedTuple

from planner.identification.result import Alternative, Identification
from planner.report.identification_numbers import percent_of
from planner.report.identification_parameters import parameters, units_of

ALTERNATIVES = {
    "raw": "the request itself",
    "delay": "best pure delay",
    "first_order": "delay and first-order lag",
}
"""What the simpler descriptions are called in words."""

RIVALS = {"delay": "the best pure delay", "first_order": "a delay with a first-order lag"}
"""Those that the verdict compares with."""

MODEL = "the joint model"


class Error(NamedTuple):
    """How far off one description of the joint is.

    Attributes:
        words: The description.
        detail: Its parameters, as far as it has any worth telling.
        rms: Error over all rows [rad].
        held_out: Error on the rows held out [rad]; None where there are none.
        ours: Whether it is the joint model.
    """

    words: str
    detail: str
    rms: float
    held_out: float | None
    ours: bool


def errors(identification: Identification) -> list[Error]:
    """The errors of the simpler descriptions, and of the joint model at the end."""
    made = []
    for other in identification.alternatives:
        times = [
            f"{1e3 * other.parameters[name]:.0f} ms"
            for name in ("delay", "time_constant")
            if name in other.parameters
        ]
        words = ALTERNATIVES.get(other.name, other.name)
        made.append(Error(words, " + ".join(times), other.rms, other.held_out_rms, False))
    made.append(Error(MODEL, "", identification.rms, identification.held_out_rms, True))
    return made


def verdict(identification: Identification) -> str:
    """Whether the model holds, and what it adds, in one sentence."""
    units = units_of(identification)
    error, where = telling_error(identification)
    told = f"{units.factor * error:.3g} {units.angle} rms {where}"
    others = {other.name: held_out_or_all(other) for other in identification.alternatives}
    compared = []
    if others.get("raw", 0.0) > 0.0:
        compared.append(f"{percent_of(error, others['raw'])} of the raw error")
    compared += [
        f"{compared_with(error, others[name])} {words}"
        for name, words in RIVALS.items()
        if name in others
    ]
    tail = f": {', '.join([told, *compared])}"
    return ("the model holds" if identification.accepted else "THE MODEL DOES NOT FIT") + tail


def known(identification: Identification) -> str:
    """Which parameters the logs determine, in a sentence; nothing of a model that does not fit."""
    if not identification.accepted:
        return "Its parameters say little about the joint."
    rows = parameters(identification)
    missing = {row.name: row.words for row in rows if not row.known}
    rough = ", ".join(row.words for row in rows if row.known and row.rough)
    if set(missing) == {"v_max", "theta_0"}:
        told = "The logs do not reach the top speed: they determine v_max / theta_0, but neither "
        told += "of the two alone"
    elif missing:
        told = f"The logs do not determine: {', '.join(missing.values())}"
    elif not rough:
        return "The logs determine every parameter."
    else:
        return f"The logs determine every parameter, but some only roughly: {rough}."
    return f"{told}; only roughly known: {rough}." if rough else f"{told}."


def telling_error(identification: Identification) -> tuple[float, str]:
    """The error that tells most [rad], and on which rows it was measured."""
    if identification.held_out_rms is not None:
        return identification.held_out_rms, "on rows held out"
    return identification.rms, "on the rows it was fitted to"


def held_out_or_all(other: Alternative) -> float:
    """Its error on the rows held out where there are any, on all otherwise [rad]."""
    return other.rms if other.held_out_rms is None else other.held_out_rms


def compared_with(error: float, other: float) -> str:
    """How an error compares with another one, as in "2.5 times closer than"."""
    if error <= 0.0:
        return "infinitely closer than"
    ratio = other / error
    if ratio >= 1.05:
        return f"{ratio:.{1 if ratio < 10 else 0}f} times closer than"
    return "no closer than" if ratio > 0.95 else f"{1.0 / ratio:.1f} times farther off than"
