"""The installed command as a process: examples, closed pipes, Ctrl-C."""

import io
import os
import re
import shlex
import signal
import subprocess
import sys
import time

import pytest

from planner.cli import cli, main
from planner.cli.program import COMMANDS
from tests.docs import shell
from tests.docs.blocks import PAGES, blocks
from tests.docs.logs import write_logs

RUN = [sys.executable, "-P", "-c", "from planner.cli import main; main()"]

ON_AN_ARM = {"calibrate", "check", "play", "record", "virtual-bus"}
"""Their examples need servos, or serve some until Ctrl-C: ``test_servos`` is about them."""


def _example(command):
    """The lines of the worked example in a command's help."""
    context = cli.make_context("request-planner", [command] if command else [])
    told = (cli.get_command(context, command) if command else cli).get_help(context)
    lines = re.search(r"Example.*:\n((?:\s{6}request-planner (?:.*\\\n)*.*\n)+)", told)
    assert lines is not None, f"the help of {command or 'request-planner'} has no worked example"
    return "\n".join(line.strip() for line in lines[1].splitlines())


def _on_pages():
    """The commands that tests/docs runs."""
    ran = [block.code for page in PAGES for block in blocks(page) if block.language == "sh"]
    return {line for code in ran for line in shell.commands(code)}


@pytest.mark.usefixtures("foot", "ready_experiments", "brief_search", "undrawn", "in_this_process")
@pytest.mark.parametrize("command", ["", *(each for each in COMMANDS if each not in ON_AN_ARM)])
def test_every_command_has_a_worked_example_that_works(command, tmp_path, desired, monkeypatch):
    """Examples that stand on a page run there."""
    monkeypatch.chdir(tmp_path)
    if command in ("refine", "replay"):
        write_logs(tmp_path)
    for name in ("requests.csv", "path.csv"):
        (tmp_path / name).write_bytes(desired.read_bytes())
    if command == "refine":
        shell.run("request-planner simulate requests.csv -o measured.csv")
    lines = shell.commands(_example(command))
    for line in lines if {*lines} - _on_pages() else []:
        shell.run(line)


@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["buffered", "unbuffered"])
@pytest.mark.parametrize("form", [[], ["--json"]], ids=["CSV", "JSON"])
def test_a_reader_that_leaves_early_gets_no_complaint(unbuffered, form):
    with subprocess.Popen(
        [*RUN, "gait", "--samples", "20000", *form],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        complaint = process.stderr.read()
        assert process.wait() == 141
    assert complaint == b""


@pytest.mark.parametrize("form", [["gait"], ["gait", "--json"], ["--help"]])
def test_a_full_disk_behind_standard_output_is_one_line_and_status_2(form):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        command, pipe = [*RUN, *form], subprocess.PIPE
        done = subprocess.run(command, stdout=full, stderr=pipe, text=True, check=False)
    assert done.returncode == 2
    assert "no space left on device" in done.stderr
    assert done.stderr.count("\n") == 1


class _Terminal(io.TextIOWrapper):
    """What a stream is that people read."""

    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("kind", "name"),
    [(io.TextIOWrapper, "关节"), (_Terminal, r"\u5173\u8282")],
    ids=["pipe", "screen"],
)
@pytest.mark.parametrize("form", [[], ["--json"]], ids=["CSV", "JSON"])
def test_a_pipe_is_utf_8_and_a_terminal_gets_what_it_has_no_characters_for_as_escapes(
    kind, name, form, tmp_path, monkeypatch
):
    path = tmp_path / "关节.csv"
    path.write_text("t_s,关节_deg\n0,1\n0.008,2\n0.016,1\n", "utf-8")
    said = {each: io.BytesIO() for each in ("stdout", "stderr")}
    for each, stream in said.items():
        monkeypatch.setattr(sys, each, kind(stream, encoding="ascii", errors="strict"))
    monkeypatch.setattr(sys, "argv", ["request-planner", "fit", str(path), "--segments=2", *form])
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setenv("MPLBACKEND", "agg")
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    for each in ("stdout",) if form else said:  # with JSON there is no table
        assert name in said[each].getvalue().decode("utf-8")


def test_the_linear_algebra_has_one_thread_unless_the_user_gives_it_more():
    """The threads of a busy machine wait for one another at every product of long vectors."""
    waiting = "import os; from planner.cli import program; program.cli.main = lambda: print("
    shown = "os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS']); program.main()"
    users = {name: text for name, text in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", waiting + shown],
        env=users | {"OMP_NUM_THREADS": "3"},
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.stdout == "1 3\n"


@pytest.mark.parametrize(
    ("redirection", "message"),
    [
        ("gait >&-", "standard output is closed; name a file for the output"),
        ("simulate - <&-", "standard input is closed; give it a file or a pipe"),
    ],
)
def test_a_closed_stream_is_one_line_and_status_2(redirection, message):
    command = f"{shlex.join(RUN)} {redirection}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"request-planner: -: {message}\n"


def test_a_terminated_run_clears_its_half_made_folder_away(tmp_path):
    out = tmp_path / "out"
    with subprocess.Popen([*RUN, "reproduce", "--out", out], stderr=subprocess.PIPE) as process:
        while process.poll() is None and not list(tmp_path.glob(".out.new-*")):
            time.sleep(0.01)
        process.terminate()
        complaint = process.stderr.read()
    assert process.returncode == 143
    assert complaint == b""
    assert list(tmp_path.iterdir()) == []
