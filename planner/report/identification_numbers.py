"""Numbers with the figures that their intervals deserve."""

from __future__ import annotations

import math

from planner.identification.result import Interval


def figure(value: float, interval: Interval) -> str:
    """A number with as many decimals as its interval deserves."""
    text = f"{value:.{_decimals(value, interval)}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def between(interval: Interval) -> str:
    """An interval in words."""
    lower, upper = (math.isfinite(end) for end in interval)
    if lower and upper:
        return f"{figure(interval.lower, interval)} to {figure(interval.upper, interval)}"
    if lower:
        return f"at least {figure(interval.lower, interval)}"
    return f"at most {figure(interval.upper, interval)}" if upper else "unknown"


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
