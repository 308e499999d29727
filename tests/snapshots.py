"""Texts kept in files: what a test compares an answer with, and what rewrites them.

Wording must agree to the letter. Integers must agree exactly; other numbers to 1e-6 and one unit of
the last printed digit, as another processor rounds differently in the last bits. Where the numbers
agree, the file keeps its own when it is rewritten, so that a diff shows what changed and no more.
"""

import difflib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from planner.exceptions import InvalidInput

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TOLERANCE = 1e-6  # numbers may differ by this, absolute below 1 and relative above


class Snapshot:
    """Snapshots in the folder ``snapshots`` beside a test.

    Args:
        folder: That folder.
        rewrite: Whether to write what was got instead of comparing with it.
    """

    def __init__(self, folder: Path, *, rewrite: bool) -> None:
        self._folder = folder
        self._rewrite = rewrite

    def check(self, name: str, got: str) -> None:
        """Compare a text with the file of this name, or rewrite the file."""
        file = self._folder / f"{name}.txt"
        kept = file.read_text("utf-8") if file.exists() else ""
        got = _with_close_lines_of(kept, got)
        if got == kept:
            return
        if self._rewrite:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(got, "utf-8")
            return
        lines = difflib.unified_diff(
            kept.splitlines(), got.splitlines(), str(file), "got", lineterm="", n=1
        )
        shown = "\n".join(line if len(line) < 1000 else f"{line[:1000]} …" for line in lines)
        raise AssertionError(
            f"{shown}\nwhere this is meant: pytest --rewrite-snapshots, and review the diff"
        )

    def refusals(
        self, name: str, call: Callable[[Any], object], cases: Mapping[str, Any], **paths: Path
    ) -> None:
        """Compare the messages with which a call refuses cases; paths are shown by their keys."""
        told = []
        for case, argument in cases.items():
            with pytest.raises(InvalidInput) as caught:
                call(argument)
            message = str(caught.value)
            assert message.isprintable()
            for label, path in paths.items():
                message = message.replace(str(path), label)
            told.append(f"{case}: {message}\n")
        self.check(name, "".join(told))


def held(folder: Path) -> dict[str, bytes | None]:
    """Every file of a folder with its content, and every folder in it."""
    return {
        str(each.relative_to(folder)): each.read_bytes() if each.is_file() else None
        for each in folder.rglob("*")
    }


def close(first: str, second: str) -> bool:
    """Whether two texts agree in their words, and in their numbers up to rounding."""
    if first == second:
        return True
    if NUMBER.sub("#", first) != NUMBER.sub("#", second):
        return False
    pairs = zip(NUMBER.findall(first), NUMBER.findall(second), strict=True)
    return all(one == other or _near(one, other) for one, other in pairs)


def _near(one: str, other: str) -> bool:
    steps = [_last_digit(text) for text in (one, other)]
    if steps == [None, None]:
        return int(one) == int(other)
    a, b = float(one), float(other)
    room = TOLERANCE * max(1.0, abs(a)) + 1.01 * max(step or 0.0 for step in steps)
    return abs(a - b) <= room


def _last_digit(text: str) -> float | None:
    """What one unit of the last printed digit is worth; None for an integer."""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else None


def _with_close_lines_of(kept: str, got: str) -> str:
    """The text, with those lines of the kept one that are close to it."""
    if kept == got:
        return got
    old, new = kept.split("\n"), got.split("\n")
    masked = [[NUMBER.sub("#", line) for line in lines] for lines in (old, new)]
    matcher = difflib.SequenceMatcher(None, *masked, autojunk=False)
    for i, j, length in matcher.get_matching_blocks():
        for k in range(length):
            if close(old[i + k], new[j + k]):
                new[j + k] = old[i + k]
    return "\n".join(new)
