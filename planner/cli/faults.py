"""Errors in settings, with keys of a run file or options as the user wrote them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from planner.exceptions import InvalidInput, PlannerError


@dataclass(frozen=True)
class Key:
    """A setting in a message.

    Attributes:
        name: The key, such as ``plan.method`` or ``export[0].file``.
        value: The value in the message; None for any value.
        joint: The joint, for a setting by joint.
    """

    name: str
    value: str | bool | None = None
    joint: str | None = None

    @property
    def place(self) -> tuple[str | int, ...]:
        """The keys and numbers that lead to it."""
        parts = re.findall(r"([^.\[]+)|\[(\d+)\]", self.name)
        names = tuple(part or int(number) for part, number in parts)
        return names if self.joint is None else (*names, self.joint)


Spelling = Callable[[Key], str]
"""How a user writes a setting: a key in a file, an option on the command line."""


def as_key(key: Key) -> str:
    """A setting as a run file has it: ``plan.cyclic = false``."""
    from planner.cli.declared import key_name, toml_value  # too slow for --help

    name = key_name(key.place)
    return name if key.value is None else f"{name} = {toml_value(key.value)}"


class _Fault(PlannerError):
    """A message with settings as objects, so that they can be spelt as keys or as options.

    Attributes:
        parts: Words and settings, in their order.
    """

    def __init__(self, *parts: str | Key) -> None:
        """Spell the settings as keys by default."""
        self.parts = parts
        super().__init__(self.spelt(as_key))

    def spelt(self, spelling: Spelling) -> str:
        """The message, with the settings as the user writes them."""
        return "".join(part if isinstance(part, str) else spelling(part) for part in self.parts)


class BadSetting(_Fault, InvalidInput):
    """Settings that contradict each other, or the files that they name."""


class Remark(_Fault):
    """A remark on a valid answer; it is not raised."""


class FailedCheck(_Fault):
    """A plan that fails a check."""
