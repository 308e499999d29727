"""A run file: read with all that it names, checked before anything is computed, and carried out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from kinematics.exceptions import KinematicsError
from planner.cli import settings
from planner.cli.declared import understand
from planner.cli.faults import BadSetting, FailedCheck, Key, as_key
from planner.exceptions import InvalidFile, InvalidInput, PlannerError
from planner.files.staging import MANIFEST
from planner.files.toml import Toml, read_toml
from planner.planning.plan import Plan
from planner.robot.schedule import Schedule
from planner.run.desired import (
    Desired,
    LegPlace,
    Limits,
    check_angles,
    desired_of,
    find_leg,
    limits_of,
    load_leg,
    starts_of,
)
from planner.run.export import check_export, check_rows, rows_of
from planner.run.load import Load, load_of, unused
from planner.run.plan import check_settings, plan_of

COMPARISON = ("comparison.json", "comparison.png", "comparison.svg")
"""Files of a comparison."""

WRITTEN = ("requests", "angles", "desired", "foot", "report", "scene")
"""Keys of [output] that name a file."""

ARGUMENTS = {
    "unreachable='nearest'": as_key(Key("leg.unreachable", "nearest")),
    "cyclic=False": as_key(Key("plan.cyclic", False)),
}
"""Arguments that messages of the library advise, as they are called in a run file."""


@dataclass(frozen=True)
class Prepared:
    """A plan, ready to be computed.

    Attributes:
        settings: What the user has set, and defaults.
        place: Where the leg is described; None where there is none.
        desired: What every joint should do.
        limits: Limits of the requests [rad].
        starts: Where joints rest before [rad].
        load: What the joints carry, where that is asked for.
        folder: The folder from which files are named; "" is the working directory.
    """

    settings: settings.Run
    place: LegPlace | None
    desired: Desired
    limits: Limits
    starts: Mapping[str, float]
    folder: str = ""
    load: Load | None = None

    def plan(
        self, progress: Callable[[str], None] = lambda _: None, *, bounded: bool = True
    ) -> Plan:
        """The plan; see :func:`planner.run.plan.plan_of`."""
        return plan_of(
            self.settings,
            self.desired,
            self.limits,
            self.starts,
            load=self.load,
            progress=progress,
            bounded=bounded,
        )


@dataclass(frozen=True)
class RunFile:
    """A run file, understood and with all that it names.

    Attributes:
        file: The file.
        prepared: The plan that it asks for.
    """

    file: Toml
    prepared: Prepared

    @property
    def settings(self) -> settings.Run:
        """What the file sets, and defaults."""
        return self.prepared.settings


def read_run(path: str) -> RunFile:
    """Read a run file, or standard input for ``-``, and whatever it names.

    Raises:
        InvalidFile: Something is wrong with it; the message says where.
        KinematicsError: The leg cannot be made, or cannot reach the path.
    """
    file = read_toml(path, example='method = "optimal"')
    run = understand(file, settings.Run)
    with speaking_of(file):
        for number, export in enumerate(run.export):
            with _in_export(number):
                check_export(export)
        _check_names(run)
        prepared = prepare(run, str(Path(path).parent))
        _check_outputs(prepared)
    return RunFile(file, prepared)


def prepare(run: settings.Run, folder: str = "") -> Prepared:
    """Load what the settings name, and check that the method can plan for it.

    Args:
        run: The settings.
        folder: The folder from which files are named.

    Raises:
        BadSetting: Settings contradict each other or do not suffice.
        InvalidFile: A file is not what it should be.
        KinematicsError: The leg cannot be made, or cannot reach the path.
    """
    prepared = load(run, folder)
    check_settings(run, prepared.desired)
    return prepared


def load(run: settings.Run, folder: str = "") -> Prepared:
    """Load what the settings name, whatever the method; see :func:`prepare`."""
    place = find_leg(run.leg, folder)
    desired = desired_of(run, load_leg(place), folder)
    desired = replace(desired, remarks=(*desired.remarks, *unused(run.plan, desired)))
    starts = starts_of(run.start, desired.names, cyclic=desired.cyclic)
    limits, carried = limits_of(run.limits, desired), load_of(run.plan, desired)
    return Prepared(run, place, desired, limits, starts, folder, carried)


@contextmanager
def speaking_of(file: Toml) -> Iterator[None]:
    """Say of keys of a file, with their line, what is wrong with settings inside the block.

    Raises:
        InvalidFile: Settings do not go together.
    """
    try:
        yield
    except BadSetting as error:
        lines = (file.line_of(key.place) for key in error.keys)
        line = next((line for line in lines if line is not None), None)
        raise InvalidFile(file.path, str(error), line=line) from error
    except FailedCheck as error:
        raise PlannerError(str(error)) from error
    except (PlannerError, KinematicsError) as error:
        message = str(error)
        for argument, key in ARGUMENTS.items():
            message = message.replace(argument, key)
        error.args = (message,)
        raise


@contextmanager
def _in_export(number: int) -> Iterator[None]:
    """Say of which export it is what is wrong with one inside the block."""
    place = f"export[{number}]"
    try:
        yield
    except BadSetting as error:
        parts = (
            replace(part, name=part.name.replace("export", place, 1))
            if isinstance(part, Key)
            else part
            for part in error.parts
        )
        raise BadSetting(*parts) from error
    except InvalidInput as error:
        raise BadSetting(Key(place), f": {error}") from error


def _check_names(run: settings.Run) -> None:
    """Make sure that no two files of the folder have one name, or one inside the other."""
    taken = {PurePosixPath(MANIFEST): MANIFEST}
    if run.output.comparison:
        taken |= {PurePosixPath(name): "output.comparison" for name in COMPARISON}
    named = {f"output.{key}": getattr(run.output, key) for key in WRITTEN}
    named |= {f"export[{number}].file": each.file for number, each in enumerate(run.export)}
    for key, name in named.items():
        if not name:
            continue
        path = PurePosixPath(name.casefold())
        for other, owner in taken.items():
            if path == other or path in other.parents or other in path.parents:
                raise BadSetting(
                    Key(key), f": got '{name}', which {owner} takes; choose another name"
                )
        taken[path] = key


def _check_outputs(prepared: Prepared) -> None:
    """Refuse outputs that this path has not, and miss packages before anything is computed."""
    run, desired = prepared.settings, prepared.desired
    if run.output.level is not None and not run.output.comparison:
        raise BadSetting(
            Key("output.level"), ": has no effect without ", Key("output.comparison", True)
        )
    if run.output.scene:
        if desired.leg is None or set(desired.leg.joint_names) != set(desired.names):
            raise BadSetting(Key("output.scene"), ": needs a leg, and a path of all its joints")
        from planner.report.scene import import_meshcat

        import_meshcat()
    if run.export or run.output.comparison:
        check_angles(desired.names, desired.units)
    like_them = Schedule(desired.names, desired.angles, desired.period)
    for number, export in enumerate(run.export):
        with _in_export(number):
            rows, _ = rows_of(export, like_them)
            check_rows(export, rows)
