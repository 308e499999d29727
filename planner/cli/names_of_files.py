"""Shell completion of the names of files and folders."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem
from click.types import StringParamType

KINDS = {"FILE": "file", "OUT": "file", "DIR": "dir"}
"""What a shell is to complete, by the metavar of an option."""


class NameOfFile(StringParamType):
    """Text that a shell completes to the names of what is there."""

    def __init__(self, kind: str) -> None:
        """Complete to a kind of name: ``file``, which has folders on the way, or ``dir``."""
        self.kind = kind

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002
        param: click.Parameter,  # noqa: ARG002
        incomplete: str,
    ) -> list[CompletionItem]:
        """Leave it to the shell, which knows what is there."""
        return [CompletionItem(incomplete, type=self.kind)]


def complete_names_of_files(command: click.Command) -> None:
    """Let shells complete what a command takes as the name of a file."""
    for parameter in command.params:
        if parameter.type is not click.STRING:
            continue
        if isinstance(parameter, click.Argument):
            parameter.type = NameOfFile("file")
        elif parameter.metavar in KINDS:
            parameter.type = NameOfFile(KINDS[parameter.metavar])
