"""Shell commands of a page, in this process: the program, pipes and redirected output."""

import importlib.util
import itertools
import shlex
from pathlib import Path

from click.testing import CliRunner

from planner.cli import cli

NEEDED = {
    "bag": "rosbags",
    "lerobot": "pyarrow",
    "mcap": "rosbags",
    "my_bag": "rosbags",
    "my_dataset": "pyarrow",
    "my_dataset/data/chunk-000/file-000.parquet": "pyarrow",
    "run.bag": "rosbags",
    "run.mcap": "rosbags",
    "view": "meshcat",
    "virtual": "mujoco",
    "yaml": "yaml",
}
"""What a command with this word in it cannot do without."""


def missing(command):
    """Packages of extras that a command needs and that are not installed."""
    packages = {NEEDED[word] for word in shlex.split(command) if word in NEEDED}
    return [package for package in packages if importlib.util.find_spec(package) is None]


def commands(code):
    """The commands of a block, one a line unless a backslash goes on."""
    return [line.strip() for line in code.replace("\\\n", " ").splitlines() if line.strip()]


def run(command, defaults=None):
    """Everything that a command prints, its pipes and redirections followed.

    Options that it leaves out may have other defaults, by command and name.
    """
    lexer = shlex.shlex(command, posix=True, punctuation_chars="|>")
    lexer.whitespace_split = True
    words = list(lexer)
    target = None
    if len(words) > 2 and words[-2] == ">":
        target, words = Path(words[-1]), words[:-2]
    given, printed = None, ""
    for piped, part in itertools.groupby(words, lambda word: word == "|"):
        if piped:
            continue
        program, *arguments = part
        assert program == "request-planner", f"{command}: mark what is no request-planner console"
        result = CliRunner().invoke(cli, arguments, input=given, default_map=defaults)
        assert result.exit_code == 0, f"{command}: {result.stderr}"
        given = result.stdout
        printed += result.stderr
    if target:
        target.write_text(given, encoding="utf-8")
    return printed + given
