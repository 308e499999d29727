"""Every command as users see it: what it prints, writes, shows and answers, held by snapshots.

Each case is a line or more at the command line, run in this process in a folder with the files of
``inputs``. Its snapshot holds standard output, standard error, exit status, the names of what was
written, the content of text files and the text of pages. Tables stand column by column, and arrays
and small objects of JSON in one line.

    pytest tests/corpus                        compare
    pytest tests/corpus --rewrite-snapshots    rewrite, then review the diff
    pytest tests/corpus --keep-outputs FOLDER  keep what was written, to compare by diff -r

Numbers are compared to 1e-6, because processors differ in the last bits of a sum; on one machine
two folders of outputs agree to the byte.
"""

from __future__ import annotations

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

CLAMPED = "--leg reference --unreachable clamp"

NEAREST = "--leg reference --unreachable nearest"

PERMUTED = "--leg reference --joint knee --joint rotator --joint abductor"

FRONT_LEFT = " ".join(f"--joint front_left_{each}" for each in ("knee", "rotator", "abductor"))

ARM = "--bus virtual --model arm.toml"

CASES = {
    "calibrate-dry": "calibrate --bus virtual --ids 1-3 --dry-run --reach-deg 30",
    "calibrate-named": "calibrate --bus virtual --ids pan=2,lift=1 --joint lift --reverse lift "
    "--zero-tick lift=2000 --rate-hz 50 --dry-run",
    "calibrate-slow": "calibrate --bus virtual --ids 1-8 --rate-hz 500 --dry-run",
    "calibrate-run": "calibrate --bus virtual --ids 1 --yes --duration-s 20 -o new.toml "
    "--report page.html",
    "check": f"check {ARM} --duration-s 4",
    "check-wrong": [
        f"check {ARM} --joint elbow",
        f"play path.csv {ARM}",
        f"play shares.csv {ARM}",
        f"play played.csv {ARM} --cycles 0",
        "record --model joint.toml --duration-s 1",
        "export played.csv --model arm.toml --format csv",
        "export played.csv --model arm.toml --format csv --unit ticks --joint-names a,b",
        "export played.csv --model arm.toml --format csv --unit ticks --zero-tick 5",
        "sweep speeds.toml --at speed=0.7",
        "plan stride.csv --leg front-left",
        "plan loaded.csv --load column",
        "plan requests.csv --leg reference --tolerance-cm 1",
        "plan requests.csv --leg reference --joint knee --model soft.toml --load urdf",
        "refine measured.csv measured.csv --desired path.csv",
        "refine played.csv played.csv --desired path.csv --joint hip",
        "refine path.csv stride.csv --desired path.csv",
        "refine path.csv bare.csv --desired path.csv",
        "plan loaded.csv --joint hip --model motor.toml --load urdf",
        "gait --pattern trot --model arm.toml",
    ],
    "check-json": f"check {ARM} --duration-s 4 --rate-hz 50 --json",
    "check-named": f"check {ARM} --duration-s 4 --joint hip",
    "compare-json": "compare path.csv --limits-deg -30:40 --json",
    "compare-norm": "compare path.csv --joint hip --norm max --level slope --no-cyclic",
    "compare-page": f"compare short_stride.csv {CLAMPED} --segments 5 --report page.html",
    "completion-bash": "completion bash",
    "completion-fish": "completion fish",
    "completion-zsh": "completion zsh",
    "excite-log": "excite --limits-deg -20:20 --duration-s 4 -o out.csv --expected-log out_log.csv",
    "excite-random": "excite --limits-deg -20:30 --kind random-steps --duration-s 3 --joint knee "
    "--model joint.toml --rate-hz 125 --seed 3 --json",
    "excite-triangle": "excite --limits-deg -20:20 --kind triangle --duration-s 4",
    "excite-wrong": [
        *(
            f"excite --limits-deg -20:20 {each}"
            for each in (
                "--kind triangle --cycles 2",
                "--kind steps --highest-hz 2",
                "--kind chirp --amplitude-deg 3",
                "--resolution-deg 1e-12",
            )
        ),
        "excite --limits-deg -20:10 --kind random-steps --resolution-deg 0 --rate-hz 10 --seed 2",
    ],
    "excite-options": "excite --limits-deg -20:20 --kind steps --duration-s 4 --centre-deg 5 "
    "--amplitude-deg 8 --cycles 2 --noise-deg 0.4 --resolution-deg 0.5 "
    "--expected-log out_log.csv -o out.csv -q",
    "export-options": [
        "export path.csv --format csv --unit ticks --ticks-per-turn 8192 --reverse knee "
        "--zero-tick knee=2000 -q",
        "export bare.csv --format csv --period-s 0.02 --rate-hz 100 --between linear --joint knee "
        "-q",
    ],
    "export-csv": "export requests.csv --format csv --unit ticks --zero-tick knee=100 --cycles 2",
    "export-folders": [
        "export requests.csv --format mcap -o bag.mcap",
        "export requests.csv --format bag --topic /arm/go -o bag",
        "export requests.csv --format lerobot --task walk -o episode --json",
    ],
    "export-model": "export played.csv --model arm.toml --format csv --unit ticks --cycles 2",
    "export-yaml": "export requests.csv --format yaml --rate-hz 250 --lead-s 2 "
    "--joint-names 'a, b ,c' --velocities",
    "fit-options": "fit path.csv --knot-s 0.04 --knot-s 0.1 --knot-s 0.16 -q",
    "fit-exact": [
        "fit path.csv --segments 4 --exact --joint hip --knots knots.csv",
        "fit path.csv --segments 4 --joint hip --knots /dev/null -o /dev/null",
    ],
    "fit-page": "fit path.csv --max-error 2 --report page.html --json",
    "fit-path": "fit path.csv --no-cyclic --max-rms 9 --required-s 0=0 --required-s 0.08 --model "
    "joint.toml",
    "gait": "gait --samples 8",
    "gait-options": "gait --samples 24 --half-stroke 0.03 --height 0.02 --forward 0.04 "
    "--sideways 0.02 --hip-height 0.08 --ground-fraction 0.6 --heading-deg 20 --period 0.01 -q",
    "gait-json": "gait --samples 6 --heading-deg 90 --half-stroke 0.03 --json",
    "gait-leg": "gait --samples 8 --leg front-left -o out.csv",
    "gait-trot": [
        "gait --pattern trot --samples 12 -o trot.csv",
        "plan trot.csv --report page.html -o requests.csv",
    ],
    "identify-all": "identify two_joints.csv --joint all --report page.html -o out.toml",
    "identify-json": "identify log.csv --no-hold-out --hold 1 --tick-ms 8 --json",
    "identify-page": "identify log.csv --report page.html -o out.toml",
    "identify-rough": "identify rough.csv two_joints.csv log.csv --joint all --no-hold-out "
    "-o /dev/null",
    "identify-two": "identify log.csv log.csv --requested requested_deg --unit deg -q",
    "plan-beyond": f"plan stride.csv {CLAMPED} --method closed-form --model soft.toml "
    "--tolerance-cm 0.1 --report page.html -o out.csv",
    "plan-closed-form": "plan path.csv --method closed-form --segments 4 --rule exact --model "
    "joint.toml --tolerance-deg 0.1 --report page.html",
    "plan-feet": [
        "gait --pattern trot --samples 24 -o trot.csv",
        f"plan trot.csv {FRONT_LEFT} --method foot-optimal --limits-deg front_left_knee=10:112 "
        "--max-step-deg 30 --tolerance-deg 9 -o out.csv",
        f"plan trot.csv {FRONT_LEFT} --joint front_right_knee --no-cyclic --start-deg 20 "
        "--start-deg front_left_knee=60 --json",
    ],
    "plan-foot": f"plan stride.csv {CLAMPED} --method foot-optimal --norm rms --json",
    "plan-foot-load": f"plan short_stride.csv {NEAREST} --method foot-optimal --model soft.toml "
    "--load urdf --max-request-speed-deg-s 4000 --weights 9 1 1 -o out.csv",
    "plan-load": "plan loaded.csv --model motor.toml --load column --report page.html -o out.csv",
    "plan-motor": "plan path.csv --model motor.toml --speed 0.5 --limits-deg -40:60 --report "
    "page.html -o out.csv",
    "plan-motor-json": "plan path.csv --model motor.toml --speed 0.5 --robust worst "
    "--max-step-deg 8 --json",
    "plan-page": f"plan stride.csv {CLAMPED} --report page.html -o out.csv",
    "plan-options": [
        "plan path.csv --joint hip --solver ipopt -q",
        "plan rest.csv --method shift -o out.csv",
    ],
    "plan-pose": f"plan requests.csv {PERMUTED} --model soft.toml --load urdf-dynamics "
    "--method closed-form --segments 4 --no-cyclic --tolerance-deg 6 -o out.csv",
    "plan-rest": "plan path.csv --no-cyclic --start-deg 2 --limits-deg knee=0:40 --norm max -v",
    "plan-foot-robust": f"plan stride.csv {CLAMPED} --model uncertain.toml --method foot-optimal "
    "--robust mean --report page.html",
    "plan-shift": "plan path.csv --method shift --report page.html -o out.csv",
    "plan-shares": [
        "plan shares.csv --model shares.toml --report page.html -o r.csv",
        "plan shares.csv --model shares.toml --tolerance-deg 1 -o r.csv -q",
        "simulate r.csv --model shares.toml --desired shares.csv -o a.csv",
        "refine r.csv a.csv --desired shares.csv --model shares.toml --no-reidentify -o n.csv",
        "plan shares.csv --model shares.toml --load column --rate-hz 40 --method shift",
        "plan path.csv --speed 2.5 -o out.csv -q",
        "plan path.csv --rate-hz 62.5 -o out.csv -q",
        f"plan short_stride.csv {CLAMPED} --speed 6 --method shift --no-cyclic -o out.csv -q",
        "compare shares.csv --model shares.toml",
        "export r.csv --format csv",
    ],
    "plan-robust": "plan path.csv --speed 0.5 --model uncertain.toml --robust mean --smoothness 0 "
    "--cyclic --report page.html",
    "refine": "refine path.csv measured.csv --desired path.csv --model joint.toml --method shift "
    "--no-reidentify --sensor-delay-ms 0 -o out.csv",
    "refine-json": "refine path.csv measured.csv --desired path.csv --model joint.toml "
    "--no-reidentify --joint knee --sensor-delay-ms 4 --cycles 1 --history learning.json "
    "-o out.csv --json",
    "refine-foot": [
        f"plan short_stride.csv {CLAMPED} --method foot-optimal -o r.csv -q",
        "simulate r.csv --model joint.toml -o m.csv -q",
        f"refine r.csv m.csv --desired short_stride.csv {CLAMPED} --method foot-optimal "
        "--weights 1 2 1 --no-reidentify --report page.html -o n.csv",
    ],
    "refine-options": [
        "refine path.csv measured.csv --desired path.csv --no-reidentify --no-cyclic "
        "--start-deg 0.2 --norm max --max-step-deg 3 -q",
        "refine path.csv measured.csv --desired path.csv --no-reidentify --joint hip "
        "--solver ipopt --max-request-speed-deg-s 300 -q",
    ],
    "refine-pose": [
        "simulate requests.csv --model joint.toml -o m.csv -q",
        "refine requests.csv m.csv --desired requests.csv --leg reference --model soft.toml --load "
        "urdf --limits-deg knee=70:115 --no-reidentify -o n.csv",
    ],
    "refine-trials": [
        "plan path.csv --model joint.toml --smoothness 0 -o r0.csv -q",
        *(
            line
            for k, joints in enumerate(("--joint hip --joint knee",) * 2 + ("--joint knee",))
            for line in (
                f"simulate r{k}.csv --model motor.toml {joints} -o m{k}.csv -q",
                f"refine r{k}.csv m{k}.csv --desired path.csv --model joint.toml --smoothness 0 "
                f"--no-reidentify --history trials -o r{k + 1}.csv --report page.html",
            )
        ),
    ],
    "refine-page": "refine path.csv measured_from_rest.csv --desired path.csv --no-cyclic "
    "--model joint.toml --cycles 2 --no-reidentify --report page.html -o out.csv",
    "replay": "replay demo.csv --model joint.toml --speed 1.5 --begin-s 0.1 --end-s 0.8",
    "replay-joints": "replay demo.csv --model joint.toml --track action --end-s 0.5 --as joints "
    "--joint knee --joint gripper --limits-deg -30:90 --norm max -o out.csv --json",
    "replay-foot": [
        f"replay leg_log.csv --model {each} --leg reference --urdf-joint Turn=rotator -o out.csv"
        for each in (
            "tested.toml --fastest --tolerance-cm 0.6 --report page.html",
            "tested.toml --fastest --tolerance-cm 0.6 --end-s 0.3 --json",
            "motor.toml --load urdf --tolerance-cm 0.001",
        )
    ],
    "replay-lerobot": "replay demo.csv --model joint.toml --speed 3 --rate-hz 49.85 --as lerobot "
    "-o planned",
    "replay-several": [
        "replay demo.csv demo_2.csv --model tested.toml --speed 1.2 --as lerobot -o planned "
        "--report page.html",
        "replay planned --model joint.toml --unit deg --fastest --tolerance-deg 2 --as lerobot "
        "--rate-hz 62.5 -o again --report again.html",
    ],
    "replay-again": "replay demo.csv --model tested.toml -o out.csv --report page.html",
    "replay-mixed": [
        f"replay --model ers210a --as lerobot -o planned --end-s 0.1 {each}"
        for each in (
            "path.csv demo_2.csv foot.csv requests.csv measured.csv measured_from_rest.csv "
            "loaded.csv stride.csv short_stride.csv played.csv rough.csv --workers 1",
            "demo_2.csv demo.csv rough.csv --json --report page.html",
            "demo_2.csv demo.csv rough.csv --resume --workers 1 -q",
            "demo.csv demo_2.csv --model tested.toml --max-step-deg 1 --end-s 0.5",
        )
    ],
    "replay-fastest": [
        f"replay {each} --model tested.toml --fastest -o /dev/null"
        for each in (
            "rough.csv --tolerance-deg 2",
            "rough.csv --retime varying --tolerance-deg 3",
            "demo.csv --norm max --joint knee --json --tolerance-deg 2",
        )
    ],
    "replay-page": "replay demo.csv --model ers210a --speed 0.5 --report page.html -o out.csv "
    "--leg reference",
    "replay-options": [
        "replay demo.csv --model joint.toml --end-s 0.3 --joint hip --solver ipopt -q",
        "replay demo.csv --model joint.toml --max-request-speed-deg-s 30 --smoothness 0.3 -q",
    ],
    "replay-rough": [
        "replay rough.csv --model ers210a -o /dev/null",
        "replay rough.csv --model motor.toml --begin-s 0.9 --joint tail --limits-deg 160:250 "
        "--limits-deg tail=150:225 --tolerance-deg 0.1 --report page.html -o short.csv",
        "replay rough.csv --model ers210a --joint left_hand --joint tail --end-s 0.4 "
        "--tolerance-deg 0.001 -o /dev/null",
    ],
    "replay-wrong": [
        f"replay demo.csv {each}"
        for each in (
            "",
            "--model urdf",
            "--model from-log --speed 1e-9",
            "--model from-log --speed 1e9",
            "--model from-log --rate-hz 1e-9",
            "--model from-log --joint knea",
            "rough.csv demo_2.csv --model joint.toml --limits-deg -1:1 --as lerobot -o planned",
            *(
                f"--model joint.toml {more}"
                for more in (
                    "--as lerobot",
                    "--as mcap",
                    "--speed 0",
                    "--joint knea",
                    "--begin-s 9",
                    "--limits-deg knea=0:1",
                    "--limits-deg -1:1 -o nowhere/out.csv",
                    "demo_2.csv",
                    "--tolerance-deg 1 --tolerance-cm 1",
                    "--tolerance-cm 1",
                    "--fastest",
                    "--fastest --tolerance-cm 1",
                    "--fastest --tolerance-deg 1 --speed 0.5",
                    "--retime varying",
                )
            ),
        )
    ],
    "reproduce-file": "reproduce --out path.csv",
    "run": "run run.toml",
    "run-check": [
        f"run {each} --check" for each in ("walk.toml", "walk.toml --json", "soft_run.toml")
    ],
    "run-leg": "run leg_walk.toml --out out",
    "run-walk": "run walk.toml --out out --json",
    "simulate": "simulate requests.csv --model joint.toml",
    "simulate-motor": "simulate requests.csv --model motor.toml --json",
    "simulate-desired": "simulate path.csv --desired path.csv --json",
    "simulate-options": [
        "simulate bare.csv --rate-hz 62.5 -q",
        "simulate loaded.csv --model motor.toml --load column -q",
    ],
    "simulate-rest": "simulate path.csv --no-cyclic --start-deg knee=3 --joint knee -o out.csv",
    "sweep-best": "sweep best.toml --workers 1",
    "sweep-gaits": "sweep gaits.toml --workers 1",
    "sweep-point": "sweep gaits.toml --at period_s=0.24 --at length=0.02 --out point --json",
    "sweep-speeds": "sweep speeds.toml --workers 1 --json --out made",
    "view-joints": "view path.csv --leg reference --html page.html",
    "view-page": f"view stride.csv {CLAMPED} --method optimal --html page.html",
    "view-requests": f"view foot.csv {CLAMPED} --requests requests.csv --html page.html",
    "play": f"play played.csv {ARM} -o out.csv",
    "play-json": f"play played.csv {ARM} --measured m.csv --json",
    "play-cycles": f"play played.csv {ARM} --cycles 2 --measured m.csv -o out.csv",
    "record": f"record {ARM} --duration-s 0.2 --rate-hz 25 -o out.csv",
    "record-hand": f"record {ARM} --duration-s 0.2 --rate-hz 25 --by-hand -o out.csv",
    "program": ["", "--version", "plan --hepl", "plna"],
    "help": [f"{command} --help" for command in COMMANDS],
}
"""Command lines by the names of their snapshots."""

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

WIDTH = 400
"""Longest line of JSON [characters], but for arrays of numbers."""

TEXTS = (".csv", ".json", ".toml", ".txt", ".yaml", ".jsonl")
"""Endings of files whose content stands in a snapshot."""


def columns(table: str) -> str:
    """A table of comma-separated values column by column, a line each."""
    return "\n".join(" ".join(each) for each in zip(*csv.reader(table.splitlines()), strict=True))


def compact(text: str) -> str:
    """The same in fewer lines: one for each array or column of numbers, or point of a path."""
    text = re.sub(r"(?m)(?:^[\d.,e+-]+\n){20,}", lambda rows: columns(rows[0]) + "\n", text)
    text = re.sub(r"\n  (?=time_from_start|velocities)", " ", text)
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

WHOLE = ("plan-page", "refine-page", "compare-page")
"""Cases whose pages stand with these lines."""


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
    """Help with a line for each option, without the text of those of a command before."""
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
    lines = [CASES[name]] if isinstance(CASES[name], str) else CASES[name]
    parts = []
    for line in lines:
        result = CliRunner().invoke(cli, shlex.split(line))
        if not isinstance(result.exception, SystemExit | None):
            raise result.exception
        parts += [f"$ request-planner {line}", f"status {result.exit_code}"]
        for kind, text in (("stdout", result.stdout), ("stderr", result.stderr)):
            parts += [f"---- {kind}", in_few_lines(text)] if text else []
    keep(name, tmp_path)
    printed = "\n".join(parts)
    if name == "help":
        printed = without_options_before(printed)
    skipped = SKIPPED.get(name, ())
    text = "\n".join([printed, *written(tmp_path, printed=printed, skipped=skipped)])
    if name not in WHOLE:
        text = "\n".join(line for line in text.split("\n") if not line.startswith(COMMON))
    text = text.replace(str(tmp_path), "…")
    snapshot.check(name, compact(without_numbers(text) if name in ROUGH else text) + "\n")


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


OF_LEGS = {"--urdf", "--base", "--foot", "--lock", "--near"}
OF_LOGS = {"--time", "--requested", "--actual", "--torque", "--ticks-per-turn"}
OF_DATASETS = {"--topic", "--command-topic", "--episodes"}

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


@pytest.mark.parametrize("name", ELSEWHERE)
def test_every_option_of_a_command_is_in_a_case(name):
    given = set()
    for line in itertools.chain.from_iterable(
        [x] if isinstance(x, str) else x for x in CASES.values()
    ):
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
