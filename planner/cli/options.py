"""Options of several commands: those that are settings, made from their declaration, and others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, Literal, get_args, get_origin

import click

from planner.cli import types
from planner.cli.console import warn
from planner.run.faults import BadSetting, FailedCheck, Key, Remark
from planner.run.schema import ANY, Unfit, settings_of, tables
from planner.run.settings import Replay, Run

Command = Callable[..., Any]

output = click.option(
    "-o",
    "--output",
    type=types.OUTPUT,
    default="-",
    help="Where to write the CSV; '-' is standard output.  [default: -]",
)
output_or_folder = click.option(
    "-o",
    "--output",
    type=types.OUTPUT_OR_FOLDER,
    default="-",
    metavar="OUT",
    help="The file, or folder, to write; '-' is standard output.  [default: -]",
)
PARALLEL = (
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        help="Processes on this machine.  [default: one for each usable processor]",
    ),
    click.option(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="A Dask scheduler, whose workers are used instead (extra 'cluster').",
    ),
    click.option(
        "--resume",
        is_flag=True,
        help="Go on with what a killed command has left, and compute only what is missing.",
    ),
)
"""Of commands that carry out many tasks."""


as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON for machines.")


@dataclass(frozen=True)
class Setting:
    """An option that is a setting.

    Attributes:
        key: The setting, as a run file has it; a table, where joints have values of their own.
        names: What the option is called; messages use the first name.
        attributes: What click takes beside help, default and choices, which the setting has.
    """

    key: str
    names: tuple[str, ...]
    attributes: Mapping[str, Any]

    @property
    def parameter(self) -> str:
        """Its name as an argument of a function."""
        return self.key.replace(".", "_")

    def option(self, of_command: str = "") -> Callable[[Command], Command]:
        """The option as click takes it, with the help that a command has in place of its own."""
        key = KEYS.get(self.key)
        if key is None:
            own = {"help": of_command} if of_command else {}
            return click.option(*self.names, self.parameter, **{**self.attributes, **own})
        default = None if key.required else key.default
        shown = key.about.otherwise.strip('"') or ("" if default in (None, ()) else str(default))
        if isinstance(default, bool):
            shown = (
                self.names[0].split("/")[0 if default else 1].strip("-")
                if "/" in self.names[0]
                else ""
            )
        default_of = f"  [default: {shown}]" if shown else ""
        given: dict[str, Any] = {
            "help": f"{of_command or key.about.help}{default_of}",
            "type": click.Choice(get_args(key.type))
            if get_origin(key.type) is Literal
            else key.type,
            "required": key.required,
            **self.attributes,
        }
        if of_command and "help" in self.attributes:
            given["help"] = of_command
        if key.type is bool:
            del given["type"]
            given |= {"is_flag": True, "default": None}
        return click.option(*self.names, self.parameter, **given)


def _setting(key: str, *names: str, **attributes: Any) -> Setting:
    return Setting(key, names, attributes)


KEYS = {
    ".".join(part for part in (*table.place, name) if part != ANY): key
    for table in tables(Run)
    for name, key in table.keys.items()
} | {f"replay.{name}": key for name, key in Replay.keys.items()}
"""What is declared of every key of a run file."""

TOLERANCE = (
    "Error of {} to accept, in the plan's norm; where the plan misses it, its requests are written "
    "all the same, and the exit status is 1."
)

SETTINGS = {
    each.key: each
    for each in (
        _setting(
            "leg.name",
            "--leg",
            type=types.LegName(),
            metavar="NAME|FILE.urdf",
            help="A leg of your own robot, with --base and --foot; or a shipped one: "
            f"{', '.join(types.SHIPPED)}. Positions are in the base's frame: the body's, and for "
            "'reference' the hip's.",
        ),
        _setting(
            "leg.urdf",
            "--urdf",
            type=types.INPUT,
            help="The same as --leg FILE.urdf.",
        ),
        _setting("leg.base", "--base", metavar="FRAME"),
        _setting("leg.foot", "--foot", metavar="FRAME"),
        _setting(
            "leg.lock",
            "--lock",
            type=types.POSITIONS,
            multiple=True,
            metavar="JOINT=DEG",
            help="With a URDF: hold a joint, so that three remain; JOINT=0.1m one that slides.",
        ),
        _setting(
            "leg.near",
            "--near",
            type=types.POSE,
            multiple=True,
            metavar="JOINT=DEG",
            help="With several poses that reach the first point: the one nearest to this; several "
            "times for several joints.",
        ),
        _setting("leg.unreachable", "--unreachable"),
        _setting(
            "model.file",
            "--model",
            type=types.INPUT,
            help="Joint models as TOML; 'ers210a', the paper's Table 1; or 'urdf', the same servos "
            "with the top speeds of the leg's URDF.  [default: ers210a]",
        ),
        _setting(
            "path.joints",
            "--joint",
            type=str,
            multiple=True,
            metavar="NAME",
            help="A joint to use, several times for several; by default every column of the file.",
        ),
        _setting("path.rate_hz", "--rate-hz", metavar="HZ"),
        _setting("path.speed", "--speed", metavar="FACTOR"),
        _setting("path.half_ellipse.samples", "--samples"),
        _setting("path.half_ellipse.length", "--length"),
        _setting("path.half_ellipse.height", "--height"),
        _setting("path.half_ellipse.forward", "--forward"),
        _setting("path.half_ellipse.sideways", "--sideways"),
        _setting("path.half_ellipse.hip_height", "--hip-height"),
        _setting("path.half_ellipse.ground_fraction", "--ground-fraction"),
        _setting("path.half_ellipse.heading_deg", "--heading-deg"),
        _setting("plan.method", "--method"),
        _setting("plan.cyclic", "--cyclic/--no-cyclic"),
        _setting("plan.load", "--load"),
        _setting("plan.norm", "--norm"),
        _setting("plan.solver", "--solver"),
        _setting("plan.max_step_deg", "--max-step-deg", metavar="DEG"),
        _setting("plan.max_request_speed_deg_s", "--max-request-speed-deg-s", metavar="DEG/S"),
        _setting("plan.smoothness", "--smoothness", metavar="SHARE"),
        _setting("plan.robust", "--robust"),
        _setting(
            "plan.weights",
            "--weights",
            type=float,
            nargs=3,
            metavar="X Y Z",
            help="Method foot-optimal: weight of each axis.  [default: 1 1 1]",
        ),
        _setting("plan.segments", "--segments", metavar="N"),
        _setting("plan.rule", "--rule"),
        _setting(
            "limits",
            "--limits-deg",
            "--limits",
            type=types.SPANS,
            multiple=True,
            metavar="[JOINT=]LOW:HIGH",
            help="Range of the requests [deg], of all joints or one; by default that of the leg.",
        ),
        _setting(
            "start",
            "--start-deg",
            "--start",
            type=types.ANGLES,
            multiple=True,
            metavar="[JOINT=]DEG",
            help="With --no-cyclic: the angle at which all joints, or one, rest before the path "
            "begins [degrees, or percent of the range, from the same zero as the path].  "
            "[default: where the path begins]",
        ),
        _setting("tolerance.cm", "--tolerance-cm", metavar="CM", help=TOLERANCE.format("the foot")),
        _setting(
            "tolerance.deg", "--tolerance-deg", metavar="DEG", help=TOLERANCE.format("any joint")
        ),
        _setting("output.level", "--level"),
        _setting("export.format", "--format"),
        _setting("export.cycles", "--cycles", metavar="N"),
        _setting("export.rate_hz", "--rate-hz", metavar="HZ"),
        _setting(
            "export.between",
            "--between",
            help="With --rate-hz: hold each request, or go to the next in a straight line.  "
            "[default: hold]",
        ),
        _setting("export.joint_names", "--joint-names", type=str, metavar="A,B,C"),
        _setting("export.unit", "--unit"),
        _setting("export.ticks_per_turn", "--ticks-per-turn", metavar="N"),
        _setting(
            "export.zero_tick", "--zero-tick", type=types.TICKS, multiple=True, metavar="[JOINT=]N"
        ),
        _setting("export.lead_s", "--lead-s", metavar="S"),
        _setting(
            "export.velocities",
            "--velocities",
            help="yaml, bag, mcap: points carry velocities, and become splines.",
        ),
        _setting("export.topic", "--topic"),
        _setting("export.task", "--task"),
        _setting("replay.track", "--track"),
        _setting("replay.speed", "--speed", metavar="F"),
        _setting(
            "replay.joints",
            "--joint",
            type=str,
            multiple=True,
            metavar="NAME",
            help="A joint to plan, several times for several; the others get their recorded "
            "requests.  [default: all that have a model, but no grippers]",
        ),
        _setting("replay.begin_s", "--start", metavar="S"),
        _setting("replay.end_s", "--end", metavar="S"),
        _setting("replay.rate_hz", "--rate-hz", metavar="HZ"),
        _setting(
            "replay.fastest",
            "--fastest",
            help="Find the largest speed at which the plan keeps --tolerance-deg or -cm, the "
            "largest error.",
        ),
        _setting("replay.retime", "--retime"),
        _setting(
            "replay.urdf_joints",
            "--urdf-joint",
            type=types.NAMES,
            multiple=True,
            metavar="JOINT=NAME",
            help="With --urdf: what a joint of the recording is called there; several times for "
            "several.",
        ),
        _setting("replay.write_as", "--as"),
    )
}
"""The options that are settings, by key."""

REPLAY = "replay."
"""Before the settings that only `replay` has."""

SMOOTHING = ("plan.max_step_deg", "plan.max_request_speed_deg_s", "plan.smoothness")
"""Settings of how smooth the requests are."""

LEG = tuple(f"leg.{key}" for key in ("name", "urdf", "base", "foot", "lock", "near"))
HALF_ELLIPSE = tuple(key for key in SETTINGS if key.startswith("path.half_ellipse."))
EXPORT = tuple(key for key in SETTINGS if key.startswith("export."))


def settings(*keys: str, **helps: str) -> Callable[[Command], Command]:
    """Give a command options that are settings, and hand them to it as ``run``, a typed Run.

    An argument ``path`` of the command is the file of the path. Settings of a replay are handed to
    it as ``replay``.

    Args:
        keys: The settings.
        helps: Help in place of a setting's own, by the last part of its key.
    """

    def decorate(command: Command) -> Command:
        @wraps(command)
        def with_settings(**given: Any) -> Any:
            values = {key: given.pop(SETTINGS[key].parameter) for key in keys}
            own = {key: values.pop(key) for key in keys if key.startswith(REPLAY)}
            if own:
                given["replay"] = _replay_of(own)
            return command(run=_run_of(values, given.get("path")), **given)

        decorated: Command = with_settings
        for key in reversed(keys):
            decorated = SETTINGS[key].option(helps.get(key.rpartition(".")[2], ""))(decorated)
        return decorated

    return decorate


def parallel(command: Command) -> Command:
    """Give a command the options that say where its tasks run: workers, scheduler and resume."""
    for option in reversed(PARALLEL):
        command = option(command)
    return command


def check_parallel(workers: int | None, scheduler: str | None) -> None:
    """Refuse two places for the tasks."""
    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers are of this machine: leave out --workers or --scheduler.")


def warn_of(remarks: Sequence[Remark | FailedCheck]) -> None:
    """Say what the user should know about a path or an answer, with settings as options."""
    for remark in remarks:
        warn(remark.spelt(as_option))


def as_option(key: Key) -> str:
    """A setting as an option of the command line: ``--no-cyclic``."""
    named = key.name
    while named and named not in SETTINGS:
        named = named.rpartition(".")[0]
    if not named:
        return {"path.file": "PATH", "export.zero_ticks": "--zero-tick"}.get(key.name, key.name)
    first, _, second = SETTINGS[named].names[0].partition("/")
    if isinstance(key.value, bool):
        return first if key.value else second
    return " ".join(str(part) for part in (first, key.value, key.joint) if part is not None)


def _run_of(values: Mapping[str, Any], path: str | None) -> Run:
    """The settings that the options of a command set.

    Raises:
        BadSetting: A value is not what it should be.
    """
    content: dict[str, Any] = {} if path is None else {"path": {"file": path}}
    for key, value in values.items():
        if value not in (None, ()):
            _put(content, key, value)
    export = content.get("export")
    if export is not None:
        content["export"] = [{"file": "rows", **export}]
    with _as_options():
        return settings_of(content, Run, standard_input=True)


def _replay_of(values: Mapping[str, Any]) -> Replay:
    """The settings of a replay that the options of a command set.

    Raises:
        BadSetting: A value is not what it should be.
    """
    content: dict[str, Any] = {}
    for key, value in values.items():
        if value in (None, ()):
            continue
        name = key.removeprefix(REPLAY)
        by_joint = name == "urdf_joints"
        content[name] = (
            dict(value) if by_joint else list(value) if isinstance(value, tuple) else value
        )
    with _as_options(REPLAY):
        return settings_of(content, Replay)


@contextmanager
def _as_options(table: str = "") -> Iterator[None]:
    """Say as options what is wrong with settings inside the block."""
    try:
        yield
    except Unfit as error:
        place = ".".join(part for part in error.place if isinstance(part, str))
        raise BadSetting(Key(table + place), f": {error.problem}") from error


def _put(content: dict[str, Any], key: str, value: Any) -> None:
    """Put the value of an option where a run file has it."""
    if key == "leg.name" and value not in types.SHIPPED:
        if "urdf" in content.get("leg", {}):
            raise click.UsageError("--leg and --urdf name a file each: leave one out.")
        key = "leg.urdf"
    if key == "leg.urdf" and "urdf" in content.get("leg", {}):
        raise click.UsageError("--leg and --urdf name a file each: leave one out.")
    *place, name = key.split(".")
    table = content
    for part in place:
        table = table.setdefault(part, {})
    if key in ("limits", "start"):
        _put_by_joint(table.setdefault(name, {}), "deg", "joints", value)
    elif key == "export.zero_tick":
        _put_by_joint(table, "zero_tick", "zero_ticks", value)
    elif key == "leg.near":
        table[name] = dict(value)
    elif key == "leg.lock":
        for joint, (unit, position) in value:
            table.setdefault(unit, {})[joint] = position
    elif key == "export.joint_names":
        table[name] = [each.strip() for each in value.split(",")]
    else:
        table[name] = list(value) if isinstance(value, tuple) else value


def _put_by_joint(table: dict[str, Any], common: str, by_joint: str, values: Any) -> None:
    for joint, value in values:
        if joint:
            table.setdefault(by_joint, {})[joint] = value
        else:
            table[common] = value
