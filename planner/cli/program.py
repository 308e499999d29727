"""``request-planner``: the commands, and the handling of their exceptions."""

from __future__ import annotations

import gc
import os
import re
import signal
import sys
import time
import warnings
from functools import cache
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NoReturn, TextIO

import click

from planner._version import __version__
from planner.cli import console
from planner.exceptions import InvalidFile, InvalidInput, OutsideEquation13, PlannerError
from planner.files.text import STANDARD_STREAM, write_text
from planner.report.wording import fitted_to

COMMANDS = {
    "calibrate": ("calibrate", "Move servos, identify their joints, recommend how to plan."),
    "check": ("calibrate", "Say whether the models of calibrated servos still hold."),
    "compare": ("plan", "Compare closed-form and optimised requests."),
    "completion": ("program", "Print the completion script of a shell."),
    "excite": ("identify", "Write test requests that determine a joint's parameters."),
    "export": ("export", "Write requests for robots: ROS, LeRobot, CSV."),
    "fit": ("plan", "Approximate joint angles by lines that a joint can follow."),
    "gait": ("gait", "Make the foot path of a walk."),
    "identify": ("identify", "Find the model of a joint from logs of it."),
    "plan": ("plan", "Plan requests for joint angles or a foot path."),
    "play": ("servos", "Play planned requests on servos, and log what they do."),
    "record": ("servos", "Log servos that something else moves, or a hand."),
    "refine": ("refine", "Learn from executed cycles: the next requests."),
    "replay": ("replay", "Plan requests that repeat a recording, at any speed."),
    "reproduce": ("reproduce", "Run the paper's experiment again, with a report."),
    "run": ("run", "Carry out what one TOML file describes."),
    "simulate": ("plan", "Simulate joints under requests."),
    "sweep": ("run", "Plan for ranges of gaits or speeds: fast at a small error."),
    "view": ("plan", "Write a page that shows the robot moving."),
    "virtual-bus": ("servos", "Put virtual servos behind a pseudo-terminal."),
}
"""The commands, their modules and their help: each is the function of this name, with _ for -."""

FAILED, BAD_INPUT = 1, 2
"""Exit statuses: of an answer that failed its own check, or missed a tolerance; and of input that
cannot be used, of which one line on standard error tells the remedy."""


class Commands(click.Group):
    """The commands, each imported on demand, and one exit for all their exceptions."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the list of commands, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in COMMANDS.items()])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of this name."""
        if cmd_name not in COMMANDS:
            return None
        module, about = COMMANDS[cmd_name]
        function = cmd_name.replace("-", "_")
        command: click.Command = getattr(import_module(f"planner.cli.{module}"), function)
        command.short_help = about
        console.add_verbosity(command)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a closed pipe ends it without an error message."""
        began = time.monotonic()
        try:
            answer = super().invoke(ctx)
            console.detail(f"{time.monotonic() - began:.3g} s in all")
            return answer
        except BrokenPipeError as error:
            _discard(sys.stdout)
            raise click.exceptions.Exit(141) from error  # 128 + SIGPIPE, as shells have it
        except PlannerError as error:
            name = ctx.invoked_subcommand or ""
            message = _in_options(error, self.get_command(ctx, name) or self)
            if isinstance(error, console.BadSetting):
                message += f". See '{ctx.command_path} {name} --help'."
            words = [*getattr(error, "__notes__", ()), message]
            failure: Any = click.ClickException(": ".join(words))
            failure.exit_code = BAD_INPUT if isinstance(error, InvalidInput) else FAILED
            raise failure from error

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run a command; standalone, end the process with its exit status."""
        run: Any = super().main
        if not standalone_mode:
            return run(*args, standalone_mode=False, **extra)
        name = extra.pop("prog_name", None) or "request-planner"
        with warnings.catch_warnings(), fitted_to(console.terminal_width(sys.stderr)):
            warn_once = cache(console.warn)  # for the same warning from several places
            warnings.showwarning = lambda message, *_where: warn_once(str(message))
            warnings.simplefilter("default", OutsideEquation13)
            status = self._status(*args, prog_name=name, **extra)
            try:
                if sys.stdout is not None:
                    sys.stdout.flush()
            except OSError:  # which is already reported
                _discard(sys.stdout)
        sys.exit(status)

    def _status(self, *args: Any, **extra: Any) -> int:
        try:
            run: Any = super().main
            status = run(*args, standalone_mode=False, **extra)
            return status if isinstance(status, int) else 0
        except click.UsageError as error:
            where = error.ctx.command_path if error.ctx else "request-planner"
            words, status = error.format_message(), BAD_INPUT
            if words.startswith("Got unexpected extra"):
                words += "; put a name with spaces in quotes."
            message = f"{words} See '{where} --help'."
        except click.ClickException as error:
            message, status = error.format_message(), error.exit_code
        except (click.Abort, KeyboardInterrupt):
            return 130  # 128 + SIGINT, as shells have it
        except SystemError as error:  # Numba's, around the exception of a signal
            cause: BaseException = error
            while cause.__cause__ is not None:
                cause = cause.__cause__
            if isinstance(cause, KeyboardInterrupt):
                return 130
            raise cause from None
        except MemoryError:
            status = BAD_INPUT
            message = (
                "not enough memory for so many samples; shorten the path, or plan fewer requests "
                "per second"
            )
        except OSError as error:
            reason, status = (error.strerror or str(error)).lower(), BAD_INPUT
            message = f"{error.filename or 'standard output'}: {reason}; choose another place"
        console.complain(message)
        return status


@click.group(
    name="request-planner",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, message="%(prog)s %(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Plan the requests (goal positions) with which servo joints follow a desired path.

    \b
    Example, the path of a foot, the requests for it, and the angles that they cause:
        request-planner gait -o foot.csv
        request-planner plan foot.csv --leg reference --unreachable clamp -o requests.csv
        request-planner simulate requests.csv -o angles.csv
    """  # noqa: D301
    context.color = console.coloured()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


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
    script = completion_class(program, {}, "request-planner", "_REQUEST_PLANNER_COMPLETE").source()
    write_text(STANDARD_STREAM, f"{script.strip()}\n")


def main() -> NoReturn:
    """Run the command line on the process's own arguments."""
    # By default a tenth of a short command's time is spent on the definitions of packages.
    gc.set_threshold(200_000, 10, 10)
    # An exit by an exception, so that incomplete files are removed.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # 128 + SIGTERM, as shells have it
    os.environ["MPLBACKEND"] = "agg"  # no window is opened; a backend that is set may be missing
    for library in ("OMP", "OPENBLAS", "MKL"):  # products of vectors are too short for threads
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal keeps its encoding
            encoding = stream.encoding if stream.isatty() else "utf-8"
            stream.reconfigure(encoding=encoding, errors="backslashreplace")
    try:
        cli.main()
    finally:  # the end of the process would search all definitions of packages for garbage
        gc.freeze()
    raise AssertionError("the command line returned")


cli.commands = dict.fromkeys(COMMANDS, cli)  # names alone: each is imported where it is called
console.add_verbosity(cli)


def _in_options(error: PlannerError, command: click.Command) -> str:
    """The message of an error, with the command's options in place of the library's arguments."""
    from planner.cli.options import in_options

    if isinstance(error, console.SettingsError):
        return in_options(error.args[0])
    message = console.advised(error, in_options)
    head, colon, rest = message.partition(": ")
    if colon and not isinstance(error, InvalidFile):
        options = {"locked": "--lock"}
        for option in (max(each.opts, key=len) for each in command.params):
            argument = re.sub("-(deg|hz|m?s)$", "", option.removeprefix("--")).replace("-", " ")
            options = {argument: option, f"{argument}s": option, **options}
        parts = re.split(r"(, | and )", head)
        message = "".join(options.get(part, part) for part in parts) + colon + rest
    return re.sub(r"(?<![-\w])max_(error|rms)(?!\w)", r"--max-\1", message)


def _discard(stream: TextIO) -> None:
    """Redirect a stream to the null device, so that flushing it at exit raises no error."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):
        return
