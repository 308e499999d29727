"""From a run file to all that its run needs, checked before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from planner.cli import planning, starts, tolerance
from planner.cli.legs import Place, find_leg, load_leg
from planner.cli.limits import Limits, parse_limits
from planner.cli.run_exports import check_exports, exports_of_run
from planner.cli.run_models import models_of_run
from planner.cli.run_words import speaking_of_keys
from planner.cli.wanted import Wanted, from_foot, load_wanted

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.files.schema import Settings

COMPARISON = ("comparison.json", "comparison.png", "comparison.svg")
"""Files of a comparison."""


@dataclass(frozen=True)
class Run:
    """A run, ready to be made.

    Attributes:
        settings: What the file says.
        choices: The same as the options of `plan`.
        place: Where the leg is described; None where there is none.
        wanted: What every joint should do.
        limits: Limits of the requests [rad].
        starts: Where joints rest before [rad].
        exports: The files for robots, as the options of `export`.
    """

    settings: Settings
    choices: Mapping[str, Any]
    place: Place | None
    wanted: Wanted
    limits: Limits
    starts: Mapping[str, float]
    exports: tuple[Mapping[str, Any], ...]


def read_run(path: str) -> Run:
    """Read a run file, or standard input for ``-``, and whatever it names.

    Raises:
        InvalidFile: Something is wrong with it; the message says where.
        KinematicsError: The leg cannot be made, or cannot reach the path.
    """
    from planner.cli.run_keys import RUN
    from planner.files.schema import understand
    from planner.files.toml import read_toml

    settings = understand(read_toml(path, example='method = "optimal"'), RUN)
    exports = exports_of_run(settings)
    _check_names(settings)
    choices = _choices(settings)
    with speaking_of_keys(settings):
        place = find_leg(choices)
        wanted = _wanted(settings, load_leg(choices))
        planning.check_choices(choices, wanted)
        tolerance.check_choices(choices, foot=wanted.foot is not None)
        limits = parse_limits(choices["limits"], wanted.names, wanted.limits)
        rest = starts.parse_starts(choices["start_deg"], wanted.names, cyclic=choices["cyclic"])
    _check_outputs(settings, wanted)
    check_exports(settings, exports, wanted)
    return Run(settings, choices, place, wanted, limits, rest, exports)


def _beside(settings: Settings, name: str) -> str:
    """Where a file is that the run file names: as it says, from its own folder."""
    return str(Path(settings.file.path).parent / name)


def _choices(settings: Settings) -> dict[str, Any]:
    """The settings as the options of `plan`."""
    limits = _entries(settings, "limits", lambda span: f"{span[0]!r}:{span[1]!r}")
    urdf = settings["leg.urdf"]
    return {
        "leg": settings["leg.name"],
        "urdf": None if urdf is None else _beside(settings, urdf),
        "base": settings["leg.base"],
        "foot": settings["leg.foot"],
        "lock": (*_positions(settings["leg.lock"]), *_positions(settings["leg.lock_m"], "m")),
        "near": _positions(settings["leg.near"]),
        **{key: settings[f"plan.{key}"] for key in ("method", "cyclic", "norm", "weights")},
        **{key: settings[f"plan.{key}"] for key in ("solver", "segments", "rule")},
        **{f"tolerance_{unit}": settings[f"tolerance.{unit}"] for unit in ("deg", "cm")},
        "limits": limits,
        "start_deg": _entries(settings, "start", repr),
        "level": settings["output.level"] or "envelope",
    }


def _entries(settings: Settings, table: str, spelt: Any) -> tuple[str, ...]:
    """A table of all joints and of single ones, as an option that is given several times."""
    common = settings[f"{table}.deg"]
    entries = [] if common is None else [spelt(common)]
    entries += [f"{joint}={spelt(value)}" for joint, value in settings[f"{table}.joints"].items()]
    return tuple(entries)


def _positions(by_joint: Mapping[str, float] | None, unit: str = "") -> tuple[str, ...]:
    return tuple(f"{joint}={position!r}{unit}" for joint, position in (by_joint or {}).items())


def _wanted(settings: Settings, leg: Leg | None) -> Wanted:
    models = models_of_run(settings, lambda name: _beside(settings, name), leg)
    file, joints = settings["path.file"], tuple(settings["path.joints"])
    unreachable = settings["leg.unreachable"]
    if "path.half_ellipse" in settings.given:
        if file is not None or joints:
            raise settings.fault(
                "path.half_ellipse",
                f"stands beside path.{'file' if file else 'joints'}, expected one of them; remove "
                "the other",
            )
        return _half_ellipse(settings, leg, models, unreachable)
    if file is None:
        raise settings.fault("path", "nothing to follow, expected file or [path.half_ellipse]")
    return load_wanted(
        _beside(settings, file), model=models, joints=joints, leg=leg, unreachable=unreachable
    )


def _half_ellipse(settings: Settings, leg: Leg | None, models: Any, unreachable: Any) -> Wanted:
    from planner.files.foot_path import FootPath
    from planner.gait import half_ellipse
    from planner.stride import stride

    if leg is None:
        raise settings.fault(
            "path.half_ellipse",
            "is a foot path: name the leg with leg.name, or with leg.urdf, leg.base and leg.foot",
        )
    prefix = "path.half_ellipse."
    parameters: dict[str, Any] = {
        name.removeprefix(prefix): value
        for name, value in settings.values.items()
        if name.startswith(prefix)
    }
    heading = math.radians(parameters.pop("heading_deg"))
    if parameters.pop("for_leg"):
        given = {key: value for key, value in parameters.items() if prefix + key in settings.given}
        made = stride(leg, **given, heading=heading)
        positions = made.foot
        leg = leg if settings["leg.near"] else replace(leg, near=made.pose)
    else:
        positions = half_ellipse(**parameters, heading=heading)
    return from_foot(FootPath(settings.file.path, positions, None), models, leg, unreachable)


def _check_names(settings: Settings) -> None:
    """Make sure that no two files of the folder have one name, or one inside the other."""
    from planner.files.output_folder import MANIFEST

    taken = {PurePosixPath(MANIFEST): "the results"}
    if settings["output.comparison"]:
        taken |= {PurePosixPath(name): "output.comparison" for name in COMPARISON}
    for key, name in _names(settings):
        path = PurePosixPath(name.casefold())
        for other, owner in taken.items():
            if path == other or path in other.parents or other in path.parents:
                raise settings.fault(key, f"got '{name}', which {owner} takes; choose another name")
        taken[path] = key


def _names(settings: Settings) -> Iterator[tuple[str, str]]:
    for key in ("requests", "angles", "desired", "foot", "report", "scene"):
        if settings[f"output.{key}"]:
            yield f"output.{key}", settings[f"output.{key}"]
    for number, each in enumerate(settings["export"]):
        yield f"export[{number}].file", each["file"]


def _check_outputs(settings: Settings, wanted: Wanted) -> None:
    """Refuse outputs that this path has not, and miss packages before anything is computed."""
    if settings["output.level"] is not None and not settings["output.comparison"]:
        raise settings.fault("output.level", "has no effect without output.comparison = true")
    if settings["output.scene"]:
        from planner.report.draw_scene import import_meshcat

        if wanted.leg is None or set(wanted.leg.joint_names) != set(wanted.names):
            raise settings.fault("output.scene", "needs a leg, and a path of all its joints")
        import_meshcat()
