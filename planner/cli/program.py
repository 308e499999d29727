"""``request-planner``: the commands, and what becomes of what they raise."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NoReturn, TextIO

import click

from kinematics.exceptions import KinematicsError
from planner._version import __version__
from planner.cli.names_of_files import complete_names_of_files
from planner.cli.say import complain, detail, warn
from planner.cli.verbosity import coloured
from planner.cli.verbosity_options import add_verbosity
from planner.exceptions import InvalidInput, OutsideEquation13, PlannerError

COMMANDS = (
    "compare",
    "completion",
    "excite",
    "export",
    "fit",
    "gait",
    "identify",
    "plan",
    "reproduce",
    "run",
    "simulate",
    "view",
)
"""Each is the function of this name in the module of this name."""

FAILED = 1
"""Exit status of an answer that failed its own check."""

BAD_INPUT = 2
"""Exit status of input that cannot be used; one line on standard error says what to do."""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it: 128 + SIGINT."""

TERMINATED = 143
"""Exit status after SIGTERM, as shells have it: 128 + SIGTERM."""

PIPE_CLOSED = 141
"""Exit status when the reader of a pipe went away, as shells have it: 128 + SIGPIPE."""


OPTIONS = {
    "unreachable='nearest'": "--unreachable nearest",
    "cyclic=False": "--no-cyclic",
}
"""Arguments that messages of the library advise, as they are called here."""


class Commands(click.Group):
    """The commands, each imported when it is called for, and one exit for all that they raise."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names of the commands, sorted."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of this name."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"planner.cli.{cmd_name}"), cmd_name)
        add_verbosity(command)
        complete_names_of_files(command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments begin with, or an error that names the nearest."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            close = get_close_matches(name, COMMANDS, n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            ctx.fail(f"No such command '{name}'.{hint}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a reader that has gone away is no error, only the end."""
        began = time.monotonic()
        try:
            answer = super().invoke(ctx)
            detail(f"{time.monotonic() - began:.3g} s in all")
            return answer
        except BrokenPipeError as error:
            _discard(sys.stdout)
            raise click.exceptions.Exit(PIPE_CLOSED) from error

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run a command; standalone, end the process with the status that DESIGN settles."""
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode, **extra)
        with warnings.catch_warnings():
            show: Any = _Warnings().show
            warnings.showwarning = show
            warnings.simplefilter("default", OutsideEquation13)
            status = self._status(args, prog_name or "request-planner", complete_var, **extra)
            _flush(sys.stdout)
            sys.exit(status)

    def _status(
        self,
        args: Sequence[str] | None,
        prog_name: str,
        complete_var: str | None,
        **extra: Any,
    ) -> int:
        try:
            status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        except click.UsageError as error:
            where = error.ctx.command_path if error.ctx else prog_name
            return _complain(f"{error.format_message()} See '{where} --help'.", BAD_INPUT)
        except click.ClickException as error:
            return _complain(error.format_message(), error.exit_code)
        except (click.Abort, KeyboardInterrupt):
            return INTERRUPTED
        except (PlannerError, KinematicsError) as error:
            theirs = isinstance(error, InvalidInput | ValueError)
            message = ": ".join([*getattr(error, "__notes__", ()), str(error)])
            for name, option in OPTIONS.items():
                message = message.replace(name, option)
            return _complain(message, BAD_INPUT if theirs else FAILED)
        except OSError as error:
            place = error.filename or "standard output"
            reason = (error.strerror or str(error)).lower()
            return _complain(f"{place}: {reason}; choose another place", BAD_INPUT)
        return status if isinstance(status, int) else 0


@click.group(
    name="request-planner",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Requests that make a lagging, saturating joint follow the path you want.

    \b
    Example, a walking foot to requests to what the joints then do:
        request-planner gait -o foot.csv
        request-planner plan foot.csv --leg reference --unreachable clamp -o requests.csv
        request-planner simulate requests.csv -o angles.csv
    """  # noqa: D301
    context.color = coloured()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main() -> NoReturn:
    """Run the command line on the process's own arguments."""
    signal.signal(signal.SIGTERM, _terminate)
    cli.main()
    raise AssertionError("the command line returned")


def _terminate(*_: object) -> NoReturn:
    """End as an exception does, so that what is half made is cleared away."""
    sys.exit(TERMINATED)


add_verbosity(cli)


def _complain(message: str, status: int) -> int:
    complain(message)
    return status


class _Warnings:
    """Says every warning once, in a line of its own, wherever and however often it is given."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def show(self, message: Warning | str, *_where: object) -> None:
        if str(message) not in self._said:
            self._said.add(str(message))
            warn(str(message))


def _flush(stream: TextIO | None) -> None:
    """Write what is left, or give it up, as the failure to write it has been told before."""
    try:
        if stream is not None:
            stream.flush()
    except OSError:
        _discard(sys.stdout)


def _discard(stream: TextIO) -> None:
    """Let the interpreter flush what is left into nothing, so that it does not complain at exit."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):
        return
