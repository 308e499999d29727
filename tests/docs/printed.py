"""Whether a program prints what a page says: the same words, and nearly the same numbers."""

from __future__ import annotations

import re

NUMBER = re.compile(r"[-−]?\d+(?:\.(\d+))?(?:e[-+]\d+)?")

NEAR = 0.002
"""Relative difference that solvers on another machine may make."""

LAST_DIGITS = 1.0
"""Units of the last decimal that they may make where little is left of a number."""


def _words(line):
    return " ".join(NUMBER.sub("#", line).split())


def _alike(told, shown):
    """Whether two lines are the same but for numbers that nearly are."""
    if _words(told) != _words(shown):
        return False
    for of_page, of_run in zip(NUMBER.finditer(told), NUMBER.finditer(shown), strict=True):
        value, other = (float(each[0].replace("−", "-")) for each in (of_page, of_run))
        room = NEAR * abs(value)
        if of_page[1]:
            room += LAST_DIGITS * 10.0 ** -len(of_page[1])
        if abs(value - other) > room:
            return False
    return True


def missing(told, shown):
    """The first line that a page tells and that is not among those shown, in order; or None."""
    lines = iter(shown.splitlines())
    for line in told.splitlines():
        if not any(_alike(line, other) for other in lines):
            return line
    return None


def rewritten(told, shown):
    """What a page tells, with the numbers that are shown; other lines stay as they are."""
    lines, left = [], shown.splitlines()
    for line in told.splitlines():
        same = [other for other in left if _words(other) == _words(line)]
        now = next((other for other in same if _alike(line, other)), same[0] if same else None)
        if now is not None:
            left = left[left.index(now) + 1 :]
        lines.append(line if now is None or _alike(line, now) else now.rstrip())
    return "".join(f"{line}\n" for line in lines)
