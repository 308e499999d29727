"""From settings to a leg, its joints' models, desired angles, limits and starts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from planner.cli import settings
from planner.cli.console import BadSetting, Key, Remark
from planner.cli.models import beside, check_joints, models_of
from planner.exceptions import ANGLE_UNIT, JOINT_UNITS, InvalidFile
from planner.files.columns import LEAST_DEG, SHARES
from planner.files.joint_model import has_servos, read_servos
from planner.files.paths import (
    FootPath,
    JointPath,
    foot_path,
    is_foot_path,
    joint_path,
    path_table,
    write_joint_path,
)
from planner.files.robot import LegPlace, read_legs
from planner.files.text import STANDARD_STREAM
from planner.model.evidence import refusal
from planner.model.joint import JointModel
from planner.trajectory import Array, most_lost

if TYPE_CHECKING:
    from kinematics import Leg

AnyPath = TypeVar("AnyPath", JointPath, FootPath)

Limits = Mapping[str, tuple[float, float]]
"""Smallest and largest request by joint [rad]."""

SHIPPED = {
    "reference": LegPlace("reference_leg.urdf", "hip", "foot"),
    **{
        f"{end}-{side}": LegPlace("ers210a.urdf", "body", f"{end}_{side}_ball")
        for end in ("front", "hind")
        for side in ("left", "right")
    },
}
"""The simplified leg of the reference walk, and the four legs of the ERS-210A."""


@dataclass(frozen=True)
class Desired:
    """The desired motion of all joints."""

    names: tuple[str, ...]
    angles: Array  # desired [rad], shape (n, k)
    models: tuple[JointModel, ...]

    # smallest and largest angle of each joint [rad], where a leg has them
    limits: dict[str, tuple[float, float]]
    leg: Leg | None = None  # the leg, if the settings name one

    # desired positions of the foot [m], shape (n, 3), for a foot path; with "clamp", the
    # positions at the clamped angles
    foot: Array | None = None

    # with "clamp", the positions before clamping; None if the leg reaches them all
    foot_given: Array | None = None
    unreachable: int = 0  # samples whose position the leg cannot reach
    units: tuple[str, ...] | None = None  # the joints' units in the file; None if all are angles
    cyclic: bool = True  # whether the path repeats for ever
    remarks: tuple[Remark, ...] = ()  # what the user should know about the path

    # torques on the joints in the file [N m], shape (n, k); None if it has no torques
    loads: Array | None = None

    # the legs of a whole robot, by name, whose joints are all among these
    legs: Mapping[str, Leg] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period

    def unit(self, joint: int) -> Literal["deg", "percent"]:
        """The unit of a joint's degrees: "deg", or "percent" of its range."""
        return "deg" if self.units is None or self.units[joint] not in SHARES else "percent"

    @contextmanager
    def units_in_messages(self) -> Iterator[None]:
        """Let messages about single joints inside the block use their units."""
        units = {name: self.unit(j) for j, name in enumerate(self.names)}
        token = JOINT_UNITS.set(None if ANGLE_UNIT.get() == "rad" else units)
        try:
            yield
        finally:
            JOINT_UNITS.reset(token)

    def write(self, path: Path | str, angles: Array, loads: Array | None = None) -> None:
        """Write angles or requests [rad] and torques [N m], (n, k), as CSV in the joints' units."""
        write_joint_path(
            path, self.names, angles, period=self.period, units=self.units, loads=loads
        )


def find_leg(leg: settings.Leg, folder: str = "") -> LegPlace | None:
    """The description of the leg; None if the settings name no leg."""
    near = leg.near and {joint: math.radians(angle) for joint, angle in leg.near.items()}
    urdf, base, foot, lock = (Key(f"leg.{key}") for key in ("urdf", "base", "foot", "lock"))
    is_described = leg.base or leg.foot or leg.lock or leg.lock_m
    if leg.name is not None:
        if leg.urdf or is_described:
            name = Key("leg.name")
            raise BadSetting(
                name, " is a shipped leg: leave out ", urdf, ", ", base, ", ", foot, " and ", lock
            )
        from kinematics import urdf_path

        shipped = SHIPPED[leg.name]
        return shipped._replace(urdf=str(urdf_path(shipped.urdf)), near=near)
    if leg.urdf is None:
        if is_described or near:
            keys = (base, ", ", foot, ", ", lock, " and ", Key("leg.near"))
            raise BadSetting(*keys, " are of a leg: name it with ", Key("leg.name"), " or ", urdf)
        return None
    if leg.base is None or leg.foot is None:
        raise BadSetting(urdf, " needs ", base, " and ", foot, ", the frames at the leg's two ends")
    locked = {joint: math.radians(angle) for joint, angle in (leg.lock or {}).items()}
    locked |= leg.lock_m or {}
    return LegPlace(beside(folder, leg.urdf), leg.base, leg.foot, locked, near)


def load_leg(place: LegPlace | None) -> Leg | None:
    """The leg of a description."""
    if place is None:
        return None
    from kinematics import Leg

    return Leg.from_urdf(
        place.urdf, base=place.base, foot=place.foot, locked=place.locked, near=place.near
    )


def legs_of(model: settings.Model, folder: str = "") -> dict[str, LegPlace]:
    """The legs of the robot in the model file; the ERS-210A's legs for its own model."""
    if model.file == settings.SHIPPED_MODEL:
        from kinematics import urdf_path

        return {
            name: place._replace(urdf=str(urdf_path(place.urdf)))
            for name, place in SHIPPED.items()
            if name != "reference"
        }
    file = _robot_file(model, folder)
    return read_legs(file) if file is not None else {}


def legs_among(joints: Sequence[str], model: settings.Model, folder: str = "") -> dict[str, Leg]:
    """The legs of the robot whose joints are all among these, by name."""
    if model.file == settings.SHIPPED_MODEL:  # the URDF is read for its own joints only
        named = tuple(f"{name.replace('-', '_')}_" for name in SHIPPED)
        if not any(joint.startswith(named) for joint in joints):
            return {}
    legs = {}
    for name, place in legs_of(model, folder).items():
        leg = load_leg(place)
        if leg is not None and set(leg.joint_names) <= set(joints):
            legs[name] = leg
    return legs


def _robot_file(model: settings.Model, folder: str) -> str | None:
    """The model file, if it can be read again for legs and servos; else None."""
    if model.file in (settings.SHIPPED_MODEL, settings.FROM_URDF, STANDARD_STREAM):
        return None
    return beside(folder, model.file)


def leg_title(leg: settings.Leg) -> str:
    """The name of the leg on pages; empty if the settings name no leg."""
    return leg.name or (f"{Path(leg.urdf).name} · {leg.foot}" if leg.urdf else "")


def desired_of(run: settings.Run, leg: Leg | None, folder: str = "") -> Desired:
    """The desired motion: joint angles of a file, or a foot path by inverse kinematics."""
    path = run.path
    if path.half_ellipse is not None:
        if path.file is not None or path.joints:
            other = Key("path.file" if path.file is not None else "path.joints")
            half = Key("path.half_ellipse")
            raise BadSetting(half, ": got ", other, " too, expected one of them; remove the other")
        return _half_ellipse(run, path.half_ellipse, leg, folder)
    if path.file is None:
        raise BadSetting("no path: expected ", Key("path.file"), " or [path.half_ellipse]")
    file = beside(folder, path.file)
    table, even = path_table(file), path.rate_hz is None and path.speed is None
    if is_foot_path(table):
        if leg is None:
            raise BadSetting(f"{file} is a foot path: name its leg with ", Key("leg.name"))
        if path.joints:
            raise BadSetting(
                Key("path.joints"), " chooses columns of a joint path; a foot moves all joints"
            )
        return _from_foot(foot_path(table, even=even), run, leg, folder)
    joints = joint_path(table, joints=path.joints, even=even)
    models = models_of(run.model, joints.names, leg, folder, rate_hz=path.rate_hz)
    models = _models_in(joints.units, run.model, models)
    joints, closed, remarks = _in_step(joints, run, models[0].period)
    legs = {} if leg is not None else legs_among(joints.names, run.model, folder)
    named = tuple(legs.values()) if leg is None else (leg,)
    foreign = [name for name in joints.names if leg is not None and name not in leg.joint_names]
    if leg is not None and foreign:
        raise BadSetting(
            f"joint '{foreign[0]}' of {joints.path} is not on the leg; its joints: "
            f"{', '.join(leg.joint_names)}"
        )
    limits = _limits_of(joints.names, named, run.model, folder)
    return _of_joints(joints, models, closed, remarks, limits=limits, leg=leg, legs=legs)


def _of_joints(
    path: JointPath,
    models: tuple[JointModel, ...],
    cyclic: bool,
    remarks: tuple[Remark, ...],
    *,
    limits: dict[str, tuple[float, float]],
    leg: Leg | None = None,
    legs: Mapping[str, Leg] | None = None,
) -> Desired:
    """The desired motion of a joint path."""
    remarks = (*remarks, *refused_models(path.names, models))
    return Desired(
        path.names,
        path.angles,
        models,
        limits,
        leg=leg,
        units=path.units,
        cyclic=cyclic,
        remarks=remarks,
        loads=path.loads,
        legs=legs or {},
    )


def _in_step(
    path: AnyPath, run: settings.Run, period: float
) -> tuple[AnyPath, bool, tuple[Remark, ...]]:
    """The path with a sample every ``period`` [s], whether it repeats, and remarks on it."""
    first, speed = path.samples[0], run.path.speed
    closed, remarks = repeats(getattr(path, first), run.plan.cyclic)
    if isinstance(path, JointPath) and len(path.angles) >= 10 and set(path.units) == {"deg"}:
        span, name = float(np.max(np.degrees(np.ptp(path.angles, axis=0)))), path.names[0]
        if 0.0 < span < LEAST_DEG:
            words = f"{path.path}: the angles span only {span:.2g} degrees: are they radians? then "
            remarks += (Remark(f"{words}rename {name}_deg to {name}_rad"),)
    resample = run.path.rate_hz is not None
    resampled = path.in_step(period, resample=resample, cyclic=closed, speed=speed)
    rows: Array = getattr(path, first)
    new_rows: Array = getattr(resampled, first)
    if path.times is None or len(new_rows) >= len(rows):
        return resampled, closed, remarks
    times, step = path.times - path.times[0], period * (speed or 1.0)
    if closed:  # stretched over a whole number of samples
        step = times[-1] * len(rows) / (len(rows) - 1) / len(new_rows)
        new_rows = np.vstack([new_rows, new_rows[:1]])
    new_times = np.asarray(step * np.arange(len(new_rows)), dtype=np.float64)
    if lost := most_lost(times, rows, new_times, new_rows):
        worst, share = lost
        names = path.names if isinstance(path, JointPath) else ("x", "y", "z")
        words = (
            f"{path.path}: with a request every {1e3 * period:.3g} ms the path of {names[worst]} "
            f"is missed by {100.0 * share:.0f} % of its motion (rms), and the errors are those "
            "from the path that is left: plan with a higher rate (--rate-hz) to keep it"
        )
        remarks += (Remark(words),)
    return resampled, closed, remarks


def load_joints(file: str, run: settings.Run) -> Desired:
    """Read a joint path whose rate is that of the models."""
    table = path_table(file)
    if is_foot_path(table):
        raise InvalidFile(file, "a foot path, expected columns <joint>_deg or <joint>_rad")
    joints = joint_path(table, joints=run.path.joints)
    models = models_of(run.model, joints.names, rate_hz=run.path.rate_hz)
    models = _models_in(joints.units, run.model, models)
    joints.check_period(models[0].period)
    return _of_joints(joints, models, *repeats(joints.angles, run.plan.cyclic), limits={})


def refused_models(names: Sequence[str], models: Sequence[JointModel]) -> tuple[Remark, ...]:
    """A remark on joints whose models are not to be planned with."""
    evidence = [model.evidence for model in models]
    words = refusal(dict(zip(names, evidence, strict=True)))
    return (Remark(words),) if words else ()


def check_angles(names: Sequence[str], units: Sequence[str] | None) -> None:
    """Refuse joints in shares of their range where angles are needed."""
    for name, unit in zip(names, units or (), strict=units is not None):
        if unit in SHARES:
            joints = Key("path.joints")
            raise BadSetting(
                f"'{name}' is in shares of its range, expected an angle; choose others with ",
                joints,
            )


def _models_in(
    units: Sequence[str], model: settings.Model, models: tuple[JointModel, ...]
) -> tuple[JointModel, ...]:
    """The models; for joints in shares of their range, scaled so that a percent is a degree."""
    if set(units) & set(SHARES) and model.file == settings.SHIPPED_MODEL:
        raise BadSetting(
            "the path has joints in shares of their range, of which the ERS-210A's model says "
            "nothing; name models of theirs, as identify writes them, with ",
            Key("model.file"),
        )
    factor, in_units = SHARES["range"], []
    for unit, each in zip(units, models, strict=True):
        if unit in SHARES:
            angles = [f.name for f in fields(each) if f.metadata["unit"].startswith("rad")]
            scaled = replace(each, **{name: factor * getattr(each, name) for name in angles})
            each = scaled.with_evidence(each.evidence and each.evidence.scaled(factor))
        in_units.append(each)
    return tuple(in_units)


def limits_of(limits: settings.Limits, desired: Desired) -> Limits:
    """Limits of the requests by joint [rad]: the settings' limits, else the leg's."""
    check_joints("limits.joints", limits.joints, desired.names)
    common = {} if limits.deg is None else dict.fromkeys(desired.names, limits.deg)
    user_limits = {
        joint: (math.radians(low), math.radians(high))
        for joint, (low, high) in {**common, **limits.joints}.items()
    }
    by_joint = {**desired.limits, **user_limits}
    return {joint: by_joint[joint] for joint in desired.names if joint in by_joint}


def starts_of(start: settings.Start, joints: Sequence[str], *, cyclic: bool) -> Mapping[str, float]:
    """Rest angles of joints before a path that does not repeat, by joint [rad]."""
    if cyclic and (start.deg is not None or start.joints):
        raise BadSetting(
            Key("start.deg"), ": a cycle has no start; add ", Key("plan.cyclic", False)
        )
    check_joints("start.joints", start.joints, joints)
    common = {} if start.deg is None else dict.fromkeys(joints, start.deg)
    return {joint: math.radians(each) for joint, each in {**common, **start.joints}.items()}


def _limits_of(
    names: Sequence[str], legs: Sequence[Leg], model: settings.Model, folder: str
) -> dict[str, tuple[float, float]]:
    """Ranges of joints [rad]: the intersection of the servos' ranges and the legs'."""
    limits = dict[str, tuple[float, float]]()
    for leg in legs:
        limits |= zip(
            leg.joint_names, zip(*np.array(leg.limits).tolist(), strict=True), strict=True
        )
    file = _robot_file(model, folder)
    servos = read_servos(file) if file is not None and has_servos(file) else {}
    for name in [name for name in names if name in servos]:
        (low, high), (lower, upper) = servos[name].limits, limits.get(name, (-math.inf, math.inf))
        limits[name] = max(lower, low), min(upper, high)
    return limits


def _from_foot(points: FootPath, run: settings.Run, leg: Leg, folder: str) -> Desired:
    """The desired motion of a leg's joints for its foot to follow a path."""
    unreachable = run.leg.unreachable
    models = models_of(run.model, leg.joint_names, leg, folder, rate_hz=run.path.rate_hz)
    points, closed, remarks = _in_step(points, run, models[0].period)
    solution = leg.inverse(points.positions, unreachable=unreachable)
    count = int((~solution.reachable).sum())
    clamped = unreachable == "clamp" and count > 0
    foot = leg.foot_positions(solution.angles) if clamped else points.positions
    before = points.positions if clamped else None
    return Desired(
        leg.joint_names,
        solution.angles,
        models,
        _limits_of(leg.joint_names, (leg,), run.model, folder),
        leg,
        foot,
        before,
        count,
        cyclic=closed,
        remarks=(*remarks, *refused_models(leg.joint_names, models)),
    )


def repeats(rows: Array, cyclic: bool | None) -> tuple[bool, tuple[Remark, ...]]:
    """Whether a path of these rows (n, k) repeats, and a remark if its ends have decided that."""
    if cyclic is not None:
        return cyclic, ()
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0)
    gaps = np.abs(rows[-1] - rows[0])
    if np.all(gaps <= 3.0 * steps):  # the last sample is about a step before the first
        ends = np.abs(np.stack([rows[1] - rows[0], rows[-1] - rows[-2]]))
        if not np.all(ends <= 0.01 * steps):
            return True, ()
        remark = Remark(
            "the path begins and ends at rest in the same place: it is taken as a cycle; ",
            Key("plan.cyclic", False),
            " plans a motion that is executed once",
        )
        return True, (remark,)
    apart = np.max(gaps / np.maximum(steps, np.finfo(float).tiny))
    remark = Remark(
        f"the path does not close, its ends are {apart:.3g} times its largest step apart: it is "
        "taken as a motion from rest, as with ",
        Key("plan.cyclic", False),
        "; ",
        Key("plan.cyclic", True),
        " lets it repeat",
    )
    return False, (remark,)


def _half_ellipse(
    run: settings.Run, walk: settings.HalfEllipse, leg: Leg | None, folder: str
) -> Desired:
    from planner.gait.half_ellipse import half_ellipse  # with kinematics
    from planner.gait.stride import stride

    if leg is None:
        keys = (Key("leg.urdf"), ", ", Key("leg.base"), " and ", Key("leg.foot"))
        half = Key("path.half_ellipse")
        raise BadSetting(half, ": a foot path needs a leg; set ", Key("leg.name"), ", or ", *keys)
    if walk.for_leg:
        leg_stride = stride(leg, **walk.arguments(given_only=True))
        positions = leg_stride.foot
        leg = leg if run.leg.near else replace(leg, near=leg_stride.pose)
    else:
        positions = half_ellipse(**walk.arguments())
    return _from_foot(FootPath("path.half_ellipse", positions, None), run, leg, folder)
