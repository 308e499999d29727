"""Every command as users see it: what it prints, writes, shows and answers, held by snapshots.

Each case is a line or more at the command line, run in this process in a folder with the files of
``inputs``. Its snapshot holds these lines, and after each the exit status where it is not 0,
standard output, standard error, the names of what was written, the content of text files and the
text of pages. Tables stand column by column, arrays and small objects of JSON in one line, and
blank lines are left out. A file with the lines alone is a new case, into which what they do is
written.

    pytest tests/corpus                        compare
    pytest tests/corpus --rewrite-snapshots    rewrite, then review the diff
    pytest tests/corpus --keep-outputs FOLDER  keep what was written, to compare by diff -r

Numbers are compared to 1e-6, because processors differ in the last bits of a sum; on one machine
two folders of outputs agree to the byte.
"""

import csv
import itertools
import json
import re
import shlex
import shutil
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from planner._version import __version__
from planner.cli import cli
from planner.cli.program import COMMANDS
from tests.corpus.page_text import check_needs_nothing_else, figures_of, text_of
from tests.snapshots import NUMBER

INPUTS = Path(__file__).parent / "inputs"
SNAPSHOTS = Path(__file__).parent / "snapshots"
RUN = re.compile(r"(?m)^\$ request-planner(?: (.*))?$")

CASES = {
    file.stem: lines
    for file in sorted(SNAPSHOTS.iterdir())
    if (lines := RUN.findall(file.read_text("utf-8")))
}
"""Command lines by the names of their snapshots, in which they stand."""

MASKS = (
    (r"in \d+(\.\d+)? m?s\b", "in … s"),
    (r"\b\d+(\.\d+)?(e-\d+)? s in all", "… s in all"),
    (r"(?m)(?<=: )\d+(\.\d+)?(e-\d+)? s$", "… s"),
    (r'(?<="versions": \{)[^}]*', "…"),
    (r'(?<="made_from": ")[^"]*', "…"),
    (r'(?<="seconds": \{)[^}]*', "…"),
    (r"(?m)^(Versions|Seconds)\n(?:[\w -]+: [\d.]+\w*\n)+", r"\1 …\n"),
    (re.escape(f"request-planner {__version__}"), "request-planner VERSION"),
)
"""What differs from run to run or from version to version."""

ROUGH = ("calibrate-run", "identify-rough")
"""Cases that identify joints of simulated motors: processors differ there in more than rounding."""

SKIPPED = {"calibrate-run": (".csv",), "compare-page": (".json",), "reproduced": (".csv",)}
SKIPPED["run"] = ("comparison.json",)
SKIPPED["virtually_reproduced"] = (".csv", ".json", ".toml")
"""Endings of the files of a case whose content other files of it hold, or other tests."""

WIDTH = 400  # longest line of JSON [characters], but for arrays of numbers

TEXTS = (".csv", ".json", ".toml", ".txt", ".yaml", ".jsonl")
"""Endings of files whose content stands in a snapshot."""

WHOLE = ("plan-page", "refine-page", "compare-page")  # cases whose pages stand with these lines
OF_LEGS = {"--base", "--foot", "--lock", "--lock-m", "--near"}
OF_LOGS = {"--time", "--requested", "--actual", "--torque", "--ticks-per-turn"}
OF_DATASETS = {"--topic", "--command-topic", "--episodes"}


def columns(table: str) -> str:
    """A table of comma-separated values column by column, a line each."""
    return "\n".join(" ".join(each) for each in zip(*csv.reader(table.splitlines()), strict=True))


def compact(text: str) -> str:
    """The same in fewer lines: one for each array or column of numbers, or point of a path."""
    text = re.sub(r"\n{2,}", "\n", text)
    text = re.sub(r"(?m)(?:^[\d.,e+-]+\n){20,}", lambda rows: columns(rows[0]) + "\n", text)
    text = re.sub(r"\n  (?=time_from_start)", " ", text)
    return re.sub(r"\[[\s\d.,e+-]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)


def json_lines(value: object, indent: str = "") -> str:
    """JSON with small objects and arrays of numbers in a line, and short entries side by side."""
    line = json.dumps(value, ensure_ascii=False)
    if len(line) <= WIDTH or not re.search(r'[{"]', line):
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        parts = [f'"{name}": {json_lines(each, inner)}' for name, each in value.items()]
    else:
        assert isinstance(value, list)
        parts = [json_lines(each, inner) for each in value]
    lines = [parts[0]]
    for part in parts[1:]:
        joined = f"{lines[-1]}, {part}"
        if len(joined) <= WIDTH and "\n" not in joined:
            lines[-1] = joined
        else:
            lines.append(part)
    start, end = "{}" if isinstance(value, dict) else "[]"
    return start + ",".join(f"\n{inner}{each}" for each in lines) + f"\n{indent}{end}"


def in_few_lines(text: str, *, ending: str = "") -> str:
    """What was printed or written: JSON and tables in fewer lines, without what differs."""
    if ending in ("", ".json") and text.startswith("{"):
        text = json_lines(json.loads(text))
    text = masked(text).rstrip("\n")
    return columns(text) if ending == ".csv" and text[0] != "#" else text


COMMON = (
    *("The figures of this page need", "Drag in a plot (on a touch", "Where it comes from"),
    *("Above: the joint's angle as desired,", "Distance of the foot from its", "Files of this run"),
    *("Errors are predicted minus desired", "The length is the sum of all", "Versions …"),
    *("Move the slider and the leg follows", "No requests have less error than the"),
)
"""How lines of many pages begin, which the pages of ``WHOLE`` hold."""


def brief(page: str, printed: str) -> str:
    """The text of a page without the rows that were printed and the paragraphs that return.

    A caption may begin its figure's description, and stands once. Of rows of numbers alone, which
    files hold, the first and the last stand here.
    """
    known = "\n".join(_cells(line) for line in printed.splitlines()) + "\n"
    kept: dict[str, None] = {}
    for kind, lines in itertools.groupby(page.splitlines(), lambda line: _kind(line, known)):
        rows = list(lines)
        if kind == "printed":
            rows = [f"| ({len(rows)} rows as printed)"]
        elif kind == "numbers" and len(rows) > 3:
            rows[1:-1] = [f"| ({len(rows) - 2} rows)"]
        kept |= dict.fromkeys(rows)
    described = "\n".join(line for line in kept if line[0] == "(")
    return "\n".join(line for line in kept if f"({line}. axes" not in described)


def _cells(line: str) -> str:
    """A row without what is between its cells, its minus signs as a terminal has them."""
    return re.sub(r"\{[\w ]*\}|[\s|,–]", "", line).replace("−", "-")


def _kind(line: str, known: str) -> str:
    """Whether a line of a page is a row that was printed, or one of numbers."""
    if not line.startswith(("|", "{")) or "|" not in line:
        return "text"
    if len(_cells(line)) > 8 and f"{_cells(line)}\n" in known:
        return "printed"
    return "numbers" if re.fullmatch(r"[\d.-]+", _cells(line)) else "text"


def masked(text: str) -> str:
    """The text without what differs from run to run."""
    for pattern, replacement in MASKS:
        text = re.sub(pattern, replacement, text)
    return text


def without_numbers(text: str) -> str:
    """The words of a text, one space apart, as columns are as wide as their numbers.

    Without warnings about what a log determines, which begin at a threshold.
    """
    text = re.sub(r"(?m)^.* lies anywhere between .*\n", "", text)
    text = re.sub(rf"(?:(?:−?{NUMBER.pattern}|null)[ ,]*\s*)+", "# ", text)
    return re.sub(r" {2,}", " ", text)


def without_options_before(text: str) -> str:
    """Help with a line for each paragraph and option, without the text of options before."""
    paragraph = r"(?m)^  [^\s-].*(?:\n  [^\s-].*)+"
    text = re.sub(paragraph, lambda lines: f"  {' '.join(lines[0].split())}", text)
    seen = set()

    def option(found: re.Match[str]) -> str:
        words = found[0].split()
        if (said := " ".join(words)) in seen:
            return f"  {' '.join(each for each in words[:2] if each[0] == '-')} …\n"
        seen.add(said)
        return f"  {said}\n"

    text = re.sub(r"(?m)^  -.*\n(?: {4,}.*\n)*", option, text)
    return re.sub(r" …\n  (?=-[^\n]* …\n)", "  ", text)


def written(folder: Path, *, printed: str, skipped: tuple[str, ...] = ()) -> list[str]:
    """What was written into a folder besides the inputs, without the content of some endings."""
    parts = []
    for file in sorted(folder.rglob("*")):
        name = str(file.relative_to(folder))
        given = INPUTS / name
        if file.is_dir() or (given.exists() and given.read_bytes() == file.read_bytes()):
            continue
        parts.append(f"==== {name}")
        if file.suffix == ".html":
            page = file.read_text("utf-8")
            parts.append(masked(brief(text_of(page), printed)))
            if drawn := figures_of(page):
                check_needs_nothing_else(page, file.parent)
                parts.append(drawn)
        elif file.suffix == ".svg":
            picture = file.read_text("utf-8")
            texts = re.findall(r"<text[^>]*>([^<]*)</text>", picture)
            box = re.findall(r'viewBox="[^"]*"', picture)[:1]
            texts = [text for text in texts if not re.fullmatch(r"[−\d.]*", text)]  # no ticks
            parts.append("; ".join(dict.fromkeys(box + texts)))
        elif file.suffix in TEXTS and not name.endswith(skipped):
            parts.append(in_few_lines(file.read_text("utf-8"), ending=file.suffix))
    return parts


@pytest.fixture
def keep(request):
    """Keep a folder of outputs, if asked to."""
    into = request.config.getoption("keep_outputs")

    def keep(name, folder):
        if into is not None:
            shutil.copytree(folder, into / name, dirs_exist_ok=True)

    return keep


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("name", CASES)
def test_a_command_prints_writes_and_answers_what_it_did(
    name, tmp_path, monkeypatch, snapshot, keep
):
    shutil.copytree(INPUTS, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    parts = []
    for line in CASES[name]:
        result = CliRunner().invoke(cli, shlex.split(line))
        if not isinstance(result.exception, SystemExit | None):
            raise result.exception
        parts.append(f"$ request-planner {line}".rstrip())
        parts += [f"status {result.exit_code}"] * (result.exit_code != 0)
        parts += [in_few_lines(result.stdout)] if result.stdout else []
        parts += ["---- stderr", in_few_lines(result.stderr)] if result.stderr else []
    keep(name, tmp_path)
    printed = "\n".join(parts)
    if name == "help":
        printed = without_options_before(printed)
    elif name == "completion":  # scripts of click, whose indented lines are its own
        printed = re.sub(r"(?m)^ .*\n", "", printed)
    skipped = SKIPPED.get(name, ())
    text = "\n".join([printed, *written(tmp_path, printed=printed, skipped=skipped)])
    if name not in WHOLE:
        text = "\n".join(line for line in text.split("\n") if not line.startswith(COMMON))
    text = text.replace(str(tmp_path), "…")
    if name in ROUGH:
        text = re.sub(r"(?:(?m:^)(?!\$ ).*\n?)+", lambda part: without_numbers(part[0]), text)
    snapshot.check(name, compact(text) + "\n")


@pytest.mark.parametrize("name", ["reproduced", "virtually_reproduced"])
def test_a_reproduction_prints_and_writes_what_it_did(name, request, snapshot, keep):
    """The slowest commands, which other tests share.

    The virtual robot magnifies the last bits of its first steps, so that only words are compared;
    held are the lines that the other reproduction does not have.
    """
    text = reproduction(request, "reproduced", keep)
    if name == "virtually_reproduced":
        known = set(without_numbers(text).splitlines())
        lines = without_numbers(reproduction(request, name, keep)).splitlines()
        text = "\n".join(line for line in dict.fromkeys(lines) if line not in known)
    snapshot.check(name, compact(text) + "\n")


def reproduction(request, name, keep):
    """What a reproduction prints and writes."""
    made = request.getfixturevalue(name)
    keep(name, made.folder)
    parts = written(made.folder, printed=made.printed, skipped=SKIPPED[name])
    text = "\n".join([masked(made.printed), *parts])
    return re.sub(r"(?<=CSV files: ).*", "out", text)


ELSEWHERE = {
    "excite": set(),
    "export": set(),
    "fit": set(),
    "gait": OF_LEGS | {"--model", "--fastest", "--tolerance-cm"},
    "identify": OF_LOGS | OF_DATASETS,
    "plan": OF_LEGS,
    "refine": OF_LEGS | {"--rate-hz"},
    "replay": OF_LEGS | OF_LOGS | OF_DATASETS | {"--scheduler"},
    "simulate": set(),
}
"""Options that are tested with legs of one's own, logs, whole robots and clusters."""


def test_the_help_of_every_command_is_in_a_case():
    assert CASES["help"] == [f"{command} --help" for command in COMMANDS]


@pytest.mark.parametrize("name", ELSEWHERE)
def test_every_option_of_a_command_is_in_a_case(name):
    given = set()
    for line in itertools.chain.from_iterable(CASES.values()):
        words = shlex.split(line)
        given |= set(words) if words[:1] == [name] else set()
    parameters = cli.get_command(click.Context(cli), name).params
    options = [
        {*each.opts, *each.secondary_opts}
        for each in parameters
        if each.param_type_name == "option"
    ]
    left = {max(each, key=len) for each in options if not each & given}
    assert left <= ELSEWHERE[name] | {"--quiet", "--verbose"}
