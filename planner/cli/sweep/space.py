"""Sweep files: run files with a table of parameters, understood, and the run file of a point."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from kinematics.exceptions import KinematicsError
from planner.cli.declared import (
    Count,
    Positive,
    Range,
    Settings,
    Unfit,
    Values,
    setting,
    understand,
)
from planner.cli.desired import find_leg, load_leg, refused_models
from planner.cli.faults import BadSetting, Key, Remark
from planner.cli.models import beside, models_of
from planner.cli.planning import prepare
from planner.cli.run_file import RunFile, speaking_of
from planner.cli.settings import Run
from planner.exceptions import MissingExtra, PlannerError
from planner.files.paths import is_foot_path, path_table
from planner.files.toml import Toml, read_toml
from planner.report.sweep import Point, Requirement


def _grid(about: str, *values: float, active: bool = False) -> Any:
    """A parameter, with example values, which a template sets if ``active``."""
    return setting(about, default=None, example=list(values), set_to=values if active else None)


class Parameters(Settings):
    """Values of the parameters to try, rising; cma tries any from the first to the last."""

    length: Values | None = _grid("Gait: half of the stroke [m].", 0.03, 0.04, 0.05, active=True)
    height: Values | None = _grid("Gait: how high the foot swings [m].", 0.02, 0.04)
    forward: Values | None = _grid("Gait: middle before the hip [m].", 0.03, 0.05)
    sideways: Values | None = _grid("Gait: outward of the hip [m].", 0.02, 0.03)
    hip_height: Values | None = _grid("Gait: hip above ground [m].", 0.07, 0.09)
    ground_fraction: Values | None = _grid("Gait: part of the cycle on the ground.", 0.5, 0.6, 0.75)
    heading_deg: Values | None = _grid("Gait: direction, from x towards y [deg].", 0.0, 90.0)
    period_s: Values | None = _grid(
        "Gait: duration of a cycle [s], rounded to whole requests.", 0.5, 0.6, 0.7, 0.8, active=True
    )
    speed: Values | None = _grid(
        "A path of a file: how many times as fast to follow it.", 1.0, 1.5, 2.0
    )
    smoothness: Values | None = _grid("Any path: `smoothness` of [plan].", 0.0, 0.01, 0.1)


class Search(Settings):
    """What is sought, and how: without a required error or speed, all of the Pareto front."""

    method: Literal["grid", "cma"] = setting(
        "All combinations of the values, or a search by CMA-ES (extra 'sweep') for two parameters "
        "or more.",
        default="grid",
    )
    steps: Count | None = setting(
        "Method grid: so many values of each parameter, evenly from its first to its last.",
        default=None,
        only=("grid",),
        otherwise="the values as they are",
        example=5,
    )
    evaluations: Annotated[int, Range(ge=20, le=10**6)] | None = setting(
        "Method cma: how many plans.", default=None, only=("cma",), otherwise="200", example=200
    )
    seed: Annotated[int, Range(ge=0, le=10**9)] | None = setting(
        "Method cma: of its random numbers.", default=None, only=("cma",), otherwise="0", example=0
    )
    at_error_cm: Positive | None = setting(
        "Seek the fastest with at most this error of the foot [cm].", default=None, example=1.0
    )
    at_error_deg: Positive | None = setting(
        "The same for a path of joints: error of the worst joint [deg].", default=None, example=2.0
    )
    at_speed_cm_s: Positive | None = setting(
        "Seek the least error of a gait of at least this speed [cm/s].", default=None, example=20.0
    )
    at_speed: Positive | None = setting(
        "The same for the path of a file: times its own speed.", default=None, example=1.5
    )
    parameters: Parameters = Parameters()


class Sweep(Run):
    """Where the results go. All tables but [sweep] are those of a run file."""

    sweep: Search = Search()


@dataclass(frozen=True)
class Space:
    """A checked sweep file with its inputs.

    Attributes:
        file: The file.
        settings: The settings in the file, and defaults.
        folder: The folder from which files are named.
        values: The values of each parameter by name, at least one for each.
        period: Time between requests [s], where a parameter is the period of a gait.
        error_unit: Of errors: "cm" of a foot, "deg" of joints.
    """

    file: Toml
    settings: Sweep
    folder: str
    values: Mapping[str, tuple[float, ...]]
    period: float = math.nan
    error_unit: str = "cm"

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters."""
        return tuple(self.values)

    @property
    def gait(self) -> bool:
        """Whether the path is a half ellipse, not that of a file."""
        return self.settings.path.file is None

    @property
    def requirement(self) -> Requirement | None:
        """The requirement on a point, if there is one."""
        search = self.settings.sweep
        error, speed = search.at_error_cm or search.at_error_deg, search.at_speed_cm_s
        speed = speed or search.at_speed
        if error is not None:
            return Requirement("error", error)
        return None if speed is None else Requirement("speed", speed)

    def canonical(self, values: Iterable[float]) -> Point:
        """A point with a cycle of whole requests."""
        return tuple(
            round(round(value / self.period) * self.period, 12)
            if name == "period_s"
            else float(value)
            for name, value in zip(self.names, values, strict=True)
        )

    def content(self, point: Point) -> dict[str, Any]:
        """The run file of a point."""
        content = deepcopy(self.file.content)
        content.pop("sweep", None)
        plan, path = content.setdefault("plan", {}), content.setdefault("path", {})
        walk = path.setdefault("half_ellipse", {}) if self.gait else {}
        for name, value in zip(self.names, point, strict=True):
            if name == "period_s":
                walk["samples"] = round(value / self.period)
            else:
                {"speed": path, "smoothness": plan}.get(name, walk)[name] = value
        return content

    def run_file(self, point: Point) -> RunFile:
        """A point as a run file, ready to be planned.

        Raises:
            PlannerError: It has no plan.
            KinematicsError: The leg cannot follow it.
        """
        with speaking_of(self.file):
            run = Run.of(self.content(point))
            return RunFile(self.file, prepare(run, self.folder))

    def refused_models(self) -> tuple[Remark, ...]:
        """A remark on joints with rejected models; the models are the same for all points."""
        for values in product(*self.values.values()):
            with suppress(PlannerError, KinematicsError):  # such as a point out of reach
                desired = self.run_file(self.canonical(values)).prepared.desired
                return refused_models(desired.names, desired.models)
        return ()


def read_sweep(path: str) -> Space:
    """Read a sweep file and its inputs, as far as they are the same for all points.

    Raises:
        InvalidFile: It is invalid; the message names the place.
        KinematicsError: The URDF has no such leg.
    """
    file = read_toml(path, example="length = [0.03, 0.04]")
    settings = understand(file, Sweep)
    with speaking_of(file):
        return _checked(Space(file, settings, str(Path(path).parent), _values(settings.sweep)))


def _values(search: Search) -> dict[str, tuple[float, ...]]:
    """The values of each parameter."""
    by_name = {
        name: values
        for name in Parameters.keys
        if (values := getattr(search.parameters, name)) is not None
    }
    if not by_name:
        raise BadSetting(
            Key("sweep.parameters"),
            f": is empty, expected values of one or more of {', '.join(Parameters.keys)}",
        )
    if search.steps is None:
        return by_name
    return {
        name: tuple(np.linspace(values[0], values[-1], search.steps).tolist())
        for name, values in by_name.items()
    }


def _checked(space: Space) -> Space:
    """The space with the period of its requests.

    Raises:
        BadSetting: Settings contradict each other, or values are out of their range.
    """
    search, folder = space.settings.sweep, space.folder
    key = "sweep.parameters."
    for name in space.names:
        if name != "smoothness" and (name == "speed") == space.gait:
            other = "period_s" if space.gait else "speed"
            of = "a file" if name == "speed" else "a gait"
            raise BadSetting(
                Key(f"{key}{name}"), f": is of the path of {of}; use ", Key(f"{key}{other}")
            )
    if search.method == "cma":
        for name, values in space.values.items():
            if len(values) < 2:
                raise BadSetting(
                    Key(f"{key}{name}"), ": got one value, expected two or more with method cma"
                )
        if len(space.names) < 2:
            raise BadSetting(
                Key("sweep.method", "cma"), ": needs two parameters or more; use ",
                Key("sweep.method", "grid"),
            )  # fmt: skip
        try:
            import cma  # noqa: F401
        except ImportError as error:
            raise MissingExtra("a search by CMA-ES", "sweep") from error
    for name in search.without_effect(search.method):
        method = Key("sweep.method", search.method)
        raise BadSetting(Key(f"sweep.{name}"), " has no effect with ", method)
    required = [
        f"sweep.{name}"
        for name in ("at_error_cm", "at_error_deg", "at_speed_cm_s", "at_speed")
        if getattr(search, name) is not None
    ]
    if len(required) > 1:
        raise BadSetting(Key(required[1]), ": got ", Key(required[0]), " too, expected one of them")
    leg = load_leg(find_leg(space.settings.leg, folder))
    of_foot = space.gait or is_foot_path(path_table(beside(folder, str(space.settings.path.file))))
    space = replace(space, error_unit="cm" if of_foot else "deg")
    foreign = {
        "at_error_deg" if of_foot else "at_error_cm": "joints" if of_foot else "a foot",
        "at_speed" if space.gait else "at_speed_cm_s": "a file" if space.gait else "a gait",
    }
    for name, of in foreign.items():
        if f"sweep.{name}" in required:
            raise BadSetting(Key(f"sweep.{name}"), f": is for the path of {of}")
    if space.gait and leg is None:
        raise BadSetting(Key("sweep.parameters"), ": a gait needs a leg; set ", Key("leg.name"))
    if "period_s" in space.names:
        assert leg is not None, "a gait without a leg is refused"
        run = space.settings
        models = models_of(run.model, leg.joint_names, leg, folder, rate_hz=run.path.rate_hz)
        space = replace(space, period=models[0].period)
    for name, values in space.values.items():
        _check_values(space, name, values)
    return space


def _check_values(space: Space, name: str, values: tuple[float, ...]) -> None:
    """Make sure that each value of a parameter is valid in a run file."""
    first = {other: each[0] for other, each in space.values.items()}
    for value in values:
        point = space.canonical({**first, name: value}.values())
        try:
            Run.of(space.content(point))
        except Unfit as error:
            problem = error.problem.partition(", expected ")[2] or error.problem
            if name == "period_s":
                problem = f"4 to 1000000 requests, which are {space.period:g} s apart"
            raise BadSetting(
                Key(f"sweep.parameters.{name}"), f": got {value:g}, expected {problem}"
            ) from error


def point_of(space: Space, pairs: Sequence[tuple[str, float]]) -> Point:
    """A point from values by name.

    Raises:
        BadSetting: A parameter is missing or unknown.
    """
    values = dict(pairs)
    if values.keys() != space.values.keys():
        raise BadSetting(
            f"--at: got {', '.join(values) or 'nothing'}, expected a value for each of "
            f"{', '.join(space.names)}"
        )
    return space.canonical(values[name] for name in space.names)


def identity(space: Space) -> dict[str, Any]:
    """The inputs of all outcomes, beside the point."""
    content = {key: value for key, value in space.file.content.items() if key != "sweep"}
    run = space.settings
    files = [run.model.file, run.path.file, run.leg.urdf]
    files += [joint.file for joint in run.model.joints.values()]
    places = [Path(beside(space.folder, name)) for name in files if name]
    digests = {
        str(place): sha256(place.read_bytes()).hexdigest() for place in places if place.is_file()
    }
    return {"command": "sweep", "content": content, "files": digests}


def origin(space: Space) -> dict[str, Any]:
    """The inputs of a sweep: those of its points, and the search."""
    return {**identity(space), "sweep": space.settings.sweep.values()}


def number_of_points(space: Space) -> int:
    """How many points are planned at most."""
    search = space.settings.sweep
    if search.method == "cma":
        return search.evaluations or 200
    return math.prod(len(values) for values in space.values.values())
