"""Sweep files and their points, each planned as a run file: a grid of them, or those of a search.

A point is a value for each parameter, and is judged by the speed and the error of its plan.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np

from planner.arrays import error_norm, index_of_largest
from planner.cli import options
from planner.cli.console import BadSetting, speaking_of
from planner.cli.declared import understand
from planner.cli.desired import Desired, leg_of, models_of, own_robot, refused_models
from planner.cli.planning import plan_of, prepare
from planner.cli.settings import SWEPT, Run, Samples, Sweep
from planner.evaluation.pareto_front import Outcome, Point, Requirement, Swept, search
from planner.exceptions import PlannerError, UnreachableFoot, importing
from planner.files.columns import shown_units
from planner.files.paths import is_foot_path, joint_path, path_table
from planner.files.results import Results, Task, digest_of
from planner.files.text import Kind, read_toml
from planner.gait.half_ellipse import walking_speed
from planner.parallel import carry_out, reason_of
from planner.report.wording import common

REQUIRED = {
    "at_error_cm": "a foot",
    "at_error_deg": "joints",
    "at_speed_cm_s": "a gait",
    "at_speed": "a file",
}
"""The errors and speeds that may be required, and the path that each is for."""


@dataclass(frozen=True)
class Space:
    """A checked sweep file."""

    settings: Sweep
    values: Mapping[str, tuple[float, ...]]  # of each parameter
    period: float  # time between requests [s], where a parameter is the period of a gait
    swept: Swept  # what is swept, without outcomes

    @property
    def most_points(self) -> int:
        """How many points are planned at most."""
        if self.settings.sweep.method == "cma":
            return self.settings.sweep.evaluations
        return math.prod(map(len, self.values.values()))

    def grid(self) -> Iterator[Point]:
        """The points of all combinations of the values."""
        return map(self.point, product(*self.values.values()))

    def point(self, values: Iterable[float]) -> Point:
        """A point from a value for each parameter, with a cycle of whole requests."""
        return tuple(
            round(round(value / self.period) * self.period, 12)
            if name == "period_s"
            else float(value)
            for name, value in zip(self.values, values, strict=True)
        )

    def content(self, point: Point) -> dict[str, Any]:
        """The run file of a point."""
        content = deepcopy(self.settings.source.content)
        content.pop("sweep", None)
        if self.settings.path.file is None:
            content.setdefault("path", {}).setdefault("half_ellipse", {})
        for name, value in zip(self.values, point, strict=True):
            in_file = round(value / self.period) if name == "period_s" else value
            options.put(content, SWEPT[name], in_file)
        return content

    def desired(self, point: Point) -> Desired:
        """The plan of a point, ready to be computed."""
        with speaking_of(self.settings.source):
            desired = prepared(self.content(point), self.settings.folder)
        desired.settings.source = self.settings.source
        return desired

    def remarks(self) -> Iterator[str]:
        """On joints with rejected models, the same at all points."""
        for point in self.grid():
            with suppress(PlannerError):  # such as a point out of reach
                desired = self.desired(point)
                if refused := refused_models(desired.names, desired.models):
                    yield refused
                break

    def inputs(self) -> dict[str, Any]:
        """The inputs of all outcomes, beside the point."""
        run = self.settings
        content = {key: each for key, each in run.source.content.items() if key != "sweep"}
        named = [run.model.file, run.path.file, own_robot(run)]
        places = [Path(run.place(name)) for name in named if name]
        files = {str(place): digest_of(place) for place in places if place.is_file()}
        return {"command": "sweep", "content": content, "files": files}


def read_sweep(path: str) -> Space:
    """Read a sweep file and its inputs, as far as they are the same for all points."""
    run = understand(read_toml(path, example="length = [0.03, 0.04]"), Sweep)
    search, gait = run.sweep, run.path.file is None
    kind = "a gait" if gait else "a file"
    with speaking_of(run.source):
        search.check_effect("sweep", "method")
        values = _values(run, kind)
        leg, period, requirement = leg_of(run), math.nan, None
        table = None if gait else path_table(run.place(str(run.path.file)))
        of_foot, unit = table is None or is_foot_path(table), "cm"
        if table is not None and not of_foot:
            joints = joint_path(table, joints=run.path.joints, even=False)
            unit = common(shown_units(joints.names, joints.units).values()).name
        required = [name for name in REQUIRED if getattr(search, name) is not None]
        if len(required) > 1:
            first, second, *_ = required
            raise BadSetting(f"‹sweep.{second}›: got ‹sweep.{first}› too, expected one of them")
        goals = [k for k, of in REQUIRED.items() if of in ("a foot" if of_foot else "joints", kind)]
        for name in required:
            if name not in goals:
                use = " or ".join(f"‹sweep.{goal}›" for goal in goals)
                raise BadSetting(f"‹sweep.{name}›: is for the path of {REQUIRED[name]}; use {use}")
            of: Literal["error", "speed"] = "error" if "error" in name else "speed"
            requirement = Requirement(of, getattr(search, name))
        if gait and leg is None:
            raise BadSetting("‹sweep.parameters›: a gait needs a leg; set ‹leg.name›")
        if leg is not None and "period_s" in values:
            period, samples = models_of(run, leg.joint_names, leg)[0].period, Kind(Samples)
            for value in values["period_s"]:
                try:
                    samples.fitted(round(value / period))
                except (ValueError, OverflowError) as error:
                    count = samples.expected.removeprefix("a whole number from ")
                    raise BadSetting(
                        f"‹sweep.parameters.period_s›: got {value:g}, expected {count} requests, "
                        f"which are {period:g} s apart"
                    ) from error
    swept = Swept(
        file=run.source.path,
        names=tuple(values),
        outcomes=(),
        speed_unit="cm/s" if gait else "×",
        error_unit=unit,
        requirement=requirement,
    )
    return Space(run, values, period, swept)


def _values(run: Sweep, path: str) -> dict[str, tuple[float, ...]]:
    """The values of each parameter."""
    search, every = run.sweep, run.sweep.parameters.values()
    by_name = {name: values for name, values in every.items() if values is not None}
    if not by_name:
        words = f"is empty, expected values of one or more of {', '.join(every)}"
        raise BadSetting(f"‹sweep.parameters›: {words}")
    for name, values in by_name.items():
        key, table = f"‹sweep.parameters.{name}›", SWEPT[name].partition(".")[0]
        of = {"path": "a file" if name == "speed" else "a gait"}.get(table, path)
        if of != path:
            other = "period_s" if name == "speed" else "speed"
            raise BadSetting(f"{key}: is for the path of {of}; use ‹sweep.parameters.{other}›")
        if search.method == "cma" and len(values) < 2:
            raise BadSetting(f"{key}: got one value, expected two or more with method cma")
    if search.method == "cma":
        if len(by_name) < 2:
            words = 'needs two parameters or more; use ‹sweep.method = "grid"›'
            raise BadSetting(f'‹sweep.method = "cma"› {words}')
        with importing("a search by CMA-ES", "sweep"):
            import cma  # noqa: F401
    return by_name


def planned_points(
    space: Space, results: Results, executor: Executor, *, progress: Callable[[str], None]
) -> Swept:
    """Plan the points of a grid or of a search."""
    by_point: dict[Point, Outcome] = {}
    search_settings, folder = space.settings.sweep, str(Path(space.settings.folder).resolve())

    def outcomes_at(points: Iterable[Point]) -> list[Outcome]:
        points = list(points)
        new = [point for point in dict.fromkeys(points) if point not in by_point]
        tasks = [Task(repr(point), (space.content(point), folder)) for point in new]
        failures = carry_out(evaluate, tasks, results, executor, progress=progress)
        for point, task in zip(new, tasks, strict=True):
            result = results.read(task)
            figures = {"reason": failures[task.name]} if result is None else json.loads(result)
            by_point[point] = Outcome(point, number=len(by_point) + 1, **figures)
        return [by_point[point] for point in points]

    if search_settings.method == "grid":
        outcomes_at(space.grid())
    else:
        search(
            lambda places: outcomes_at(map(space.point, places)),
            [(each[0], each[-1]) for each in space.values.values()],
            most=space.most_points,
            requirement=space.swept.requirement,
            seed=search_settings.seed,
        )
    return replace(space.swept, outcomes=tuple(by_point.values()))


def prepared(content: dict[str, Any], folder: str) -> Desired:
    """The plan of a point's run file in a folder, ready to be computed."""
    run = Run.of(content)
    run.folder = folder
    return prepare(run)


def evaluate(argument: tuple[dict[str, Any], str]) -> bytes:
    """Speed and errors of a point, or why it has none, as JSON: a task of :mod:`planner.parallel`.

    The argument is the run file of the point, and the folder from which files are named.
    """
    try:
        desired = prepared(*argument)
        plan = plan_of(desired, bounded=False)
    except PlannerError as error:  # kept, too: it is found only by planning
        reason = reason_of(error)
        if isinstance(error, UnreachableFoot):
            farthest = 100.0 * float(error.distances.max())
            reason = (
                f"foot out of reach at {len(error.indices)} samples, by up to {farthest:.2g} cm"
            )
        return json.dumps({"reason": reason}).encode()
    path, norm = desired.settings.path, plan.task.norm
    speed = path.speed or 1.0
    errors, direct = np.degrees(plan.errors), np.degrees(plan.direct.errors)
    if desired.foot is not None:
        errors, direct = 100.0 * plan.distances[:, None], 100.0 * plan.direct.distances[:, None]
        if (walk := path.half_ellipse) is not None:
            fraction, heading = walk.ground_fraction, math.radians(walk.heading_deg)
            speed = 100.0 * walking_speed(
                desired.foot, desired.period, ground_fraction=fraction, heading=heading
            )
    slowest = index_of_largest(plan.too_fast)
    figures = {
        "speed": speed,
        "error": max(error_norm(column, norm) for column in errors.T),
        "largest": float(np.max(np.abs(errors))),
        "direct": max(error_norm(column, norm) for column in direct.T),
        "too_fast": float(plan.too_fast[slowest]),
        "slowest": desired.names[slowest] if plan.too_fast[slowest] > 0.0 else "",
        "unreachable": desired.unreachable,
    }
    return json.dumps(figures).encode()
