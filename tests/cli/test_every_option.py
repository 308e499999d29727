"""No option is ignored: each changes what its command writes, or how the command ends."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import NamedTuple

import click
import numpy as np
import pytest
from click.testing import CliRunner

import planner
from kinematics import urdf_path
from planner.cli import cli
from planner.files.paths import write_foot_path, write_joint_path
from planner.model.evidence import Evidence

AIBO = planner.JointModel.ers210a()

SOFT = replace(AIBO, dead_band=0.02, compliance=0.1)

KNOWN = {"v_max": (0.9 * AIBO.v_max, 1.1 * AIBO.v_max), "lag": (0.02, 0.04)}

OWN = "--leg robot.urdf --base body --foot front_left_ball"


class Case(NamedTuple):
    """What an option changes.

    Attributes:
        common: The other arguments.
        one: The option with its value.
        other: What stands in its place for another answer; by default it is left out.
    """

    common: str
    one: str
    other: str = ""


JOINTS = "desired.csv"
FOOT = "foot.csv --leg front-left"
AT_ONCE = f"{FOOT} --method foot-optimal"

LEARN = "brief.csv measured.csv --no-reidentify"

NAMED, COLUMNS = "columns.csv --unit deg", "--time s:s --requested a --actual b"

TURNS = "--ticks-per-turn 4000", "--ticks-per-turn 5000"

PATH = {
    "--joint": Case(JOINTS, "--joint knee"),
    "--model": Case(JOINTS, "--model fast.toml"),
    "--rate-hz": Case(JOINTS, "--rate-hz 62.5"),
    "--cyclic": Case(JOINTS, "--no-cyclic"),
}

LEG = {
    "--leg": Case("foot.csv", "--leg front-left", "--leg front-right --unreachable nearest"),
    "--base": Case(
        "foot.csv --leg robot.urdf --foot front_left_ball --unreachable nearest",
        "--base body",
        "--base front_left_shoulder",
    ),
    "--foot": Case(
        "foot.csv --leg robot.urdf --base body --unreachable nearest",
        "--foot front_left_ball",
        "--foot hind_left_ball",
    ),
    "--lock": Case(f"foot.csv {OWN} --unreachable nearest", "--lock front_left_abductor=5"),
    "--unreachable": Case(
        "far.csv --leg front-left", "--unreachable nearest", "--unreachable clamp"
    ),
}

ASKED = {
    "--start-deg": Case(f"{JOINTS} --no-cyclic", "--start-deg 20"),
    "--method": Case(JOINTS, "--method closed-form"),
    "--norm": Case(JOINTS, "--norm max"),
    "--solver": Case(f"{JOINTS} --joint hip", "--solver ipopt"),
    "--weights": Case(AT_ONCE, "--weights 9 1 1"),
    "--load": Case("loaded.csv --model soft.toml", "--load column"),
    "--max-step-deg": Case(AT_ONCE, "--max-step-deg 4"),
    "--max-request-speed-deg-s": Case(AT_ONCE, "--max-request-speed-deg-s 500"),
    "--smoothness": Case(JOINTS, "--smoothness 0.1"),
    "--limits-deg": Case(JOINTS, "--limits-deg knee=-69:69"),
}

BESIDE = {
    "--norm max": "--end-s 0.3",
    "--solver ipopt": "--end-s 0.3",
    "--fastest": "--tolerance-deg 9",
    "--retime varying": "--fastest --tolerance-deg 9",
}
"""Options of a replay that need others."""

CASES = {
    "plan": {
        **PATH,
        **LEG,
        **ASKED,
        "--speed": Case(JOINTS, "--speed 0.5"),
        "--segments": Case(f"{JOINTS} --method closed-form", "--segments 4"),
        "--rule": Case(f"{JOINTS} --method closed-form", "--rule exact"),
        "--robust": Case(f"{JOINTS} --model known.toml --joint knee", "--robust worst"),
        "--tolerance-deg": Case(JOINTS, "--tolerance-deg 0.01"),
        "--tolerance-cm": Case(AT_ONCE, "--tolerance-cm 0.001"),
        "--report": Case(JOINTS, "--report plan.html"),
    },
    "simulate": {
        **PATH,
        "--rate-hz": Case("bare.csv", "--rate-hz 62.5"),
        "--start-deg": Case(f"{JOINTS} --no-cyclic", "--start-deg 20"),
        "--load": Case("loaded.csv --model soft.toml", "--load column"),
        "--desired": Case(f"{JOINTS} --json", "--desired desired.csv"),
    },
    "fit": {
        **{name: case for name, case in PATH.items() if name != "--rate-hz"},
        "--segments": Case(JOINTS, "--segments 4"),
        "--max-error": Case(f"{JOINTS} --joint hip", "--max-error 1"),
        "--max-rms": Case(f"{JOINTS} --joint hip", "--max-rms 1"),
        "--knot-s": Case(JOINTS, "--knot-s 0.1 --knot-s 0.3 --knot-s 0.5"),
        "--required-s": Case(f"{JOINTS} --segments 4", "--required-s 0.304"),
        "--exact": Case(f"{JOINTS} --joint hip --segments 3 --json", "--exact"),
        "--knots": Case(f"{JOINTS} --joint hip", "--knots knots.csv"),
        "--figure": Case(JOINTS, "--figure fit.svg"),
    },
    "gait": {
        **{
            f"--{name}": Case("", f"--{name} {value}")
            for name, value in (
                *(("samples", 40), ("half-stroke", 0.03), ("height", 0.02), ("forward", 0.04)),
                *(("sideways", 0.02), ("hip-height", 0.08), ("ground-fraction", 0.6)),
                *(("heading-deg", 20), ("period", 0.01)),
            )
        },
        "--leg": Case("", "--leg front-left"),
    },
    "excite": {
        name: Case(f"--limits-deg -40:40 --duration-s 12 {common}", one, other)
        for name, (common, one, other) in {
            "--kind": Case("", "--kind chirp"),
            "--limits-deg": Case("", "--limits-deg -30:30"),
            "--centre-deg": Case("", "--centre-deg 10"),
            "--rate-hz": Case("", "--rate-hz 50"),
            "--duration-s": Case("--kind multisine", "--duration-s 15"),
            "--amplitude-deg": Case("--kind steps", "--amplitude-deg 20"),
            "--cycles": Case("--kind steps", "--cycles 2"),
            "--highest-hz": Case("--kind chirp", "--highest-hz 2"),
            "--seed": Case("--kind random-steps", "--seed 5"),
            "--joint": Case("", "--joint wrist"),
            "--model": Case("--expected-log log.csv", "--model fast.toml"),
            "--noise-deg": Case("--expected-log log.csv", "--noise-deg 0.4"),
            "--resolution-deg": Case("--expected-log log.csv", "--resolution-deg 0.5"),
            "--expected-log": Case("", "--expected-log log.csv"),
        }.items()
    },
    "export": {
        name: Case(f"desired.csv {common}", one, other)
        for name, (common, one, other) in {
            "--format": Case("", "--format csv", "--format yaml"),
            "--cycles": Case("--format csv", "--cycles 2"),
            "--rate-hz": Case("--format csv", "--rate-hz 250"),
            "--between": Case("--format csv --rate-hz 250", "--between linear"),
            "--joint-names": Case("--format csv", "--joint-names a,b"),
            "--unit": Case("--format csv", "--unit deg"),
            "--ticks-per-turn": Case("--format csv --unit ticks", "--ticks-per-turn 8192"),
            "--zero-tick": Case("--format csv --unit ticks", "--zero-tick knee=2000"),
            "--reverse": Case("--format csv --unit ticks", "--reverse knee"),
            "--lead-s": Case("--format yaml", "--lead-s 2"),
            "--velocities": Case("--format yaml", "--velocities"),
            "--joint": Case("--format csv", "--joint knee"),
        }.items()
    },
    "replay": {
        "--model": Case("demo.csv", "--model fast.toml", "--model soft.toml"),
        **{
            each.split()[0]: Case(f"demo.csv --model fast.toml {BESIDE.get(each, '')}", each)
            for each in (
                *("--speed 0.8", "--track action", "--joint knee", "--begin-s 0.1", "--end-s 0.5"),
                *("--rate-hz 62.5", "--limits-deg -29:29", "--max-step-deg 1", "--smoothness 0.3"),
                *("--max-request-speed-deg-s 30", "--tolerance-deg 0.01", "--as yaml"),
                *("--report page.html", *BESIDE),
            )
        },
    },
    "refine": {
        "--desired": Case(LEARN, "--desired brief.csv", "--desired other.csv"),
        **{
            each.split()[0]: Case(f"{LEARN} --desired brief.csv", each)
            for each in (
                *("--model fast.toml", "--joint knee", "--norm max", "--max-step-deg 3"),
                *("--max-request-speed-deg-s 300", "--smoothness 0.3", "--limits-deg -30:30"),
                *("--history trials.json", "--cycles 1", "--sensor-delay-ms 4"),
                "--report page.html",
            )
        },
        "--start-deg": Case(f"{LEARN} --desired brief.csv --no-cyclic", "--start-deg 9"),
        "--solver": Case(f"{LEARN} --desired brief.csv --joint hip", "--solver ipopt"),
        "--cyclic": Case(f"{LEARN} --desired brief.csv", "--no-cyclic"),
        "--load": Case(f"{LEARN} --desired heavy.csv --model soft.toml", "--load column"),
    },
    "identify": {
        name: Case(f"{common} -o out.toml", one, other)
        for name, common, one, other in (
            ("--joint", "demo.csv", "--joint hip", "--joint knee"),
            ("--time", f"{NAMED} --requested a --actual b", "--time s:s", "--time t:s"),
            ("--requested", f"{NAMED} --time s:s --actual b", "--requested a", "--requested c"),
            ("--actual", f"{NAMED} --time s:s --requested a", "--actual b", "--actual d"),
            ("--torque", f"{NAMED} {COLUMNS}", "--torque on", ""),
            ("--unit", f"columns.csv {COLUMNS}", "--unit deg", "--unit percent"),
            ("--ticks-per-turn", f"columns.csv {COLUMNS} --unit ticks", *TURNS),
            ("--tick-ms", "demo.csv --joint hip", "--tick-ms 8", "--tick-ms 4"),
            ("--hold", "demo.csv --joint hip", "--hold 1", "--hold 2"),
            ("--hold-out", "demo.csv --joint hip", "--no-hold-out", ""),
            ("--report", "demo.csv --joint hip", "--report page.html", ""),
        )
    },
}
"""An entry for every option of these commands but those of :data:`ELSEWHERE`."""

CASES["export"]["--period-s"] = Case("bare.csv --format csv", "--period-s 0.01", "--period-s 0.02")

EVERYWHERE = {"--output", "--json", "--quiet", "--verbose"}
"""What ``test_habits`` and ``test_commands`` are about."""

SAME_AS_LEG = {"--urdf"}

OF_ANY_LEG = {"--base", "--foot", "--lock", "--near", "--model", "--fastest", "--tolerance-cm"}

OF_DATASETS = {"--topic", "--command-topic", "--episodes"}

ELSEWHERE = {
    "export": {"--topic", "--task", "--model"},
    "plan": SAME_AS_LEG | {"--near"},
    "gait": SAME_AS_LEG | OF_ANY_LEG | {"--pattern"},
    "identify": OF_DATASETS,
    "refine": SAME_AS_LEG
    | {"--leg", "--base", "--foot", "--lock", "--near", "--unreachable", "--method", "--weights"}
    | {"--rate-hz", "--reidentify"},
    "replay": SAME_AS_LEG
    | OF_DATASETS
    | {"--leg", "--base", "--foot", "--lock", "--near", "--urdf-joint", "--load", "--tolerance-cm"}
    | {"--time", "--requested", "--actual", "--torque", "--unit", "--ticks-per-turn"}
    | {"--workers", "--scheduler", "--resume"},
}
"""What ``test_export`` reads back from bags and datasets, and what ``test_any_leg``,
``test_shortest_cycle``, ``test_whole_robot``, ``test_load``, ``test_refine``, ``test_replay`` and
the tests of logs, which have columns in the same way, are about."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with paths, models and robots."""
    folder = tmp_path_factory.mktemp("options")
    phase = 2.0 * np.pi * np.arange(88) / 88
    angles = np.column_stack([0.4 * np.sin(phase), 1.2 * np.sin(phase) ** 3])
    write_joint_path(folder / "desired.csv", ["hip", "knee"], angles, period=AIBO.period)
    loads = np.column_stack([0.3 + 0.0 * phase, 0.2 * np.cos(phase)])
    write_joint_path(
        folder / "loaded.csv", ["hip", "knee"], angles, period=AIBO.period, loads=loads
    )
    bare = "hip_rad,knee_rad\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in angles)
    (folder / "bare.csv").write_text(bare)
    turned = 2.0 * phase[::2]
    circle = np.column_stack([np.cos(turned), np.zeros(44), np.sin(turned)])
    middle = np.array([0.09, 0.075, -0.09])
    write_foot_path(folder / "foot.csv", middle + 0.012 * circle, period=AIBO.period)
    far = middle + 0.06 * circle
    write_foot_path(folder / "far.csv", far, period=AIBO.period)
    shutil.copy(urdf_path("ers210a.urdf"), folder / "robot.urdf")
    replace(AIBO, v_max=1.5 * AIBO.v_max, lag=0.02).to_toml(folder / "fast.toml")
    SOFT.to_toml(folder / "soft.toml")
    AIBO.with_evidence(Evidence(intervals=KNOWN)).to_toml(folder / "known.toml")
    write_logs(folder)
    write_trial(folder, angles[::3])
    return folder


def write_trial(folder, angles):
    """A path, requests and three cycles that were measured under them, and two other paths."""
    names = ["hip", "knee"]
    loads = np.column_stack([np.linspace(0.1, 0.4, len(angles)), 0.2 + 0.0 * angles[:, 0]])
    write_joint_path(folder / "brief.csv", names, angles, period=AIBO.period)
    write_joint_path(folder / "heavy.csv", names, angles, period=AIBO.period, loads=loads)
    write_joint_path(folder / "other.csv", names, 0.9 * angles, period=AIBO.period)
    slower = replace(AIBO, v_max=0.9 * AIBO.v_max)
    played = np.column_stack([planner.simulate(slower, each) for each in angles.T])
    noise = np.random.default_rng(1).normal(0.0, 0.003, (3 * len(angles), 2))
    write_joint_path(
        folder / "measured.csv", names, np.tile(played, (3, 1)) + noise, period=AIBO.period
    )


def write_logs(folder):
    """A log of two joints in ``demo.csv``, and ``columns.csv``, whose columns say nothing."""
    rng = np.random.default_rng(3)
    times = AIBO.period * np.arange(250)
    requests = np.column_stack([np.repeat(rng.uniform(-0.5, 0.5, 25), 10) for _ in range(2)])
    models = AIBO, replace(AIBO, lag=0.016)
    angles = np.column_stack(
        [
            planner.simulate(model, each, cyclic=False) + rng.normal(0.0, 0.002, len(each))
            for model, each in zip(models, requests.T, strict=True)
        ]
    )
    columns = [times, *np.degrees(np.column_stack([requests, angles])).T]
    head = "t_s,goal_hip_deg,goal_knee_deg,present_hip_deg,present_knee_deg"
    save = {"fmt": "%.5g", "delimiter": ",", "comments": ""}
    np.savetxt(folder / "demo.csv", np.column_stack(columns), header=head, **save)
    columns += [2.0 * times, times < 1.5]
    order = np.column_stack([columns[k] for k in (0, 1, 3, 2, 4, 5, 6)])
    np.savetxt(folder / "columns.csv", order, header="s,a,b,c,d,t,on", **save)


@pytest.fixture(scope="module")
def answers():
    """Outcomes by their lines: most options leave the same one out."""
    return {}


@pytest.fixture
def outcome(files, answers, tmp_path, monkeypatch):
    """What a command writes, and its exit status; the foot's path is too long for its bound."""

    monkeypatch.setattr("planner.planning.bounds.foot_bound.MOST_SAMPLES_BOUNDED", 40)

    def outcome(line):
        line = " ".join(line.split())
        if line in answers:
            return answers[line]
        shutil.copytree(files, tmp_path, dirs_exist_ok=True)
        monkeypatch.chdir(tmp_path)
        before = {file.name for file in files.iterdir()}
        result = CliRunner().invoke(cli, line.split())
        assert result.exit_code in (0, 1), result.stderr
        written = {file for file in tmp_path.iterdir() if file.name not in before}
        contents = {file.name: file.read_bytes() for file in written}
        for file in written:
            file.unlink()
        answers[line] = result.exit_code, result.stdout, contents
        return answers[line]

    return outcome


OPTIONS = [(command, name) for command, cases in CASES.items() for name in cases]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("command", "name"), OPTIONS, ids=map(" ".join, OPTIONS))
def test_every_option_changes_what_is_written(outcome, command, name):
    case = CASES[command][name]
    one, other = (outcome(f"{command} {case.common} {each}") for each in (case.one, case.other))
    assert one != other


@pytest.mark.parametrize("command", CASES)
def test_no_option_of_these_commands_is_left_out(command):
    parameters = cli.get_command(click.Context(cli), command).params
    names = {max(each.opts, key=len) for each in parameters if isinstance(each, click.Option)}
    others = EVERYWHERE | ELSEWHERE.get(command, set())
    assert names - others == set(CASES[command])
