"""The README's way from a log to a plan runs, and says what the README says."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
SECTION = README[README.index("## From a log to a model") : README.index("## Files")]


def words(text):
    """The text without the figures, whose last digits differ between machines, and its blanks."""
    return " ".join(re.sub(r"−?\d[\d.]*", "#", text).split())


def test_the_commands_from_a_log_to_a_plan_run_and_the_second_says_what_is_printed(run, tmp_path):
    commands = re.findall(r"^    request-planner (.+)$", SECTION, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["excite", "identify", "gait", "plan"]
    done = [run(*shlex.split(command)) for command in commands]
    assert [result.exit_code for result in done] == [0] * 4, [result.stderr for result in done]
    printed = re.search(r"```console\n(.*?)```", SECTION, re.DOTALL)[1]
    assert words(printed) in words(done[1].stderr)
    assert (tmp_path / "requests.csv").is_file()
    assert (tmp_path / "report.html").is_file()
