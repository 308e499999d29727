"""Comments for the model file of an identification: where it comes from, how sure it is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from planner._version import __version__
from planner.identification.result import Identification, Interval
from planner.report.identification_words import verdict

SI = {
    "v_max": "rad/s",
    "theta_0": "rad",
    "lag": "s",
    "acceleration_time": "s",
    "offset": "rad",
    "tick": "s",
    "hold": "ticks",
}


def remarks() -> tuple[str, ...]:
    """What stands at the top of the file; no date, so that the same logs give the same file."""
    return (f"Identified by request-planner {__version__}; the intervals hold with 95 %.",)


def comments(identification: Identification) -> dict[str, str]:
    """Comments on the keys of one model, and under "" those above them."""
    share = identification.unit != "rad"
    above = [verdict(identification)]
    if share:
        above.append("Angles are shares of the joint's range, not radians.")
    above += [f"Warning: {warning}" for warning in identification.warnings]
    for fit in identification.fits:
        used = int(np.sum(fit.used))
        above.append(f"From {fit.log.name}: {used} of {len(fit.used)} rows.")
    units = {key: unit.replace("rad", "1") if share else unit for key, unit in SI.items()}
    return {
        "": "\n".join(above),
        **{
            key: f"[{unit}]" + _interval(identification.intervals.get(key))
            for key, unit in units.items()
        },
    }


def model_comments(identifications: Mapping[str, Identification]) -> dict[str, dict[str, str]]:
    """The comments on every joint's model."""
    return {joint: comments(each) for joint, each in identifications.items()}


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return ""
    if interval.bounded:
        return f", {interval.lower:.5g} to {interval.upper:.5g}"
    ends = [
        f"at {word} {end:.5g}"
        for word, end in (("least", interval.lower), ("most", interval.upper))
        if np.isfinite(end)
    ]
    return f", {ends[0]}" if ends else ", not determined"
