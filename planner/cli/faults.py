"""What is wrong with settings, said of keys of a run file or of options, as the user wrote them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from planner.exceptions import InvalidInput, PlannerError


@dataclass(frozen=True)
class Key:
    """A setting that a message speaks of.

    Attributes:
        name: The key, such as ``plan.method`` or ``export[0].file``.
        value: The value that the message means; None where it means any.
        joint: The joint, of a setting by joint.
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
    """A message in which settings stand as such, so that they can be spelt for the user.

    Attributes:
        parts: Words and settings, in their order.
    """

    def __init__(self, *parts: str | Key) -> None:
        """Spell the settings as keys, until somebody knows better."""
        self.parts = parts
        super().__init__(self.spelt(as_key))

    def spelt(self, spelling: Spelling) -> str:
        """The message, with the settings as the user writes them."""
        return "".join(part if isinstance(part, str) else spelling(part) for part in self.parts)


class BadSetting(_Fault, InvalidInput):
    """Settings that do not go together, or not with the files that they name."""


class Remark(_Fault):
    """What the user should know about an answer that is handed over; it is not raised."""


class FailedCheck(_Fault):
    """A plan that does not keep to what it should."""
