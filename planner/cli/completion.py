"""``request-planner completion``: shell completion of commands, options and files."""

from __future__ import annotations

import click

from planner.files.text import STANDARD_STREAM, write_text

VARIABLE = "_REQUEST_PLANNER_COMPLETE"
"""Through this variable of the environment a shell asks the command for completions."""


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(context: click.Context, *, shell: str) -> None:
    """Print a script with which SHELL completes commands, options, their values and files.

    \b
    Example, for bash from version 4.4, this shell and from now on every new one:
        request-planner completion bash > request-planner.bash
        source request-planner.bash
    For every new one, a line in ~/.bashrc or ~/.zshrc:
        eval "$(request-planner completion bash)"
        eval "$(request-planner completion zsh)"
    and for fish a file in ~/.config/fish/completions:
        request-planner completion fish > ~/.config/fish/completions/request-planner.fish
    """  # noqa: D301
    from click.shell_completion import get_completion_class

    completion_class = get_completion_class(shell)
    assert completion_class is not None, "click knows these shells"
    program = context.find_root().command
    script = completion_class(program, {}, "request-planner", VARIABLE).source()
    write_text(STANDARD_STREAM, f"{script.strip()}\n")
