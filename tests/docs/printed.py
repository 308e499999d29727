"""Whether a program prints what a page says: the same words, and nearly the same numbers."""

import re

NUMBER = re.compile(r"[-−]?\d+(?:\.(\d+))?(?:e[-+]\d+)?")
NEAR = 0.002  # relative difference that solvers on another machine may make
OMITTED = "..."  # a line of a page that stands for any number of lines
LAST_DIGITS = 1.0  # units of the last decimal that they may make where little is left of a number


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


def difference(told, shown):
    """How what a page tells differs from what is shown, in words; None where it does not.

    All that is shown must be told, line by line, but for what a line ``...`` stands for.
    """
    left, omitted = shown.strip("\n").splitlines(), False
    for line in told.strip("\n").splitlines():
        if line == OMITTED:
            omitted = True
            continue
        same = [k for k, other in enumerate(left) if _alike(line, other)]
        if not same:
            return f"not printed: {line}"
        if same[0] and not omitted:
            break
        left, omitted = left[same[0] + 1 :], False
    if left and not omitted:
        return f"printed, and neither told nor omitted by a line {OMITTED!r}: {left[0]}"
    return None


def rewritten(told, shown):
    """What the blocks of a page tell, with the lines and numbers that are shown.

    Lines that are not shown stay as they are.

    Args:
        told: The blocks, which tell of what is shown in order.
        shown: What is shown.
    """
    left, omitted, made = shown.strip("\n").splitlines(), False, []
    for block in told:
        lines = []
        for line in block.splitlines():
            same = [k for k, other in enumerate(left) if _words(other) == _words(line)]
            k = next((k for k in same if _alike(line, left[k])), same[0] if same else None)
            if line == OMITTED or k is None:
                omitted = omitted or line == OMITTED
                lines.append(line)
                continue
            lines += [] if omitted else left[:k]
            lines.append(line if NUMBER.search(line) and _alike(line, left[k]) else left[k])
            left, omitted = left[k + 1 :], False
        made.append(lines)
    if told and not omitted:
        made[-1] += left
    return ["".join(f"{line.rstrip()}\n" for line in lines) for lines in made]
