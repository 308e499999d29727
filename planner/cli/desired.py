"""From settings to the desired motion: the robot, its models, the path, limits, starts and load."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from planner.arrays import Array, most_lost
from planner.cli import settings
from planner.cli.console import BadSetting, marked
from planner.exceptions import InvalidFile, InvalidModel, PlannerError, in_degrees, nearest
from planner.files import paths
from planner.files.columns import LEAST_DEG, SHARES, shown_units
from planner.files.joint_model import LegPlace, read_legs, read_model_file, read_servos
from planner.files.text import STANDARD_STREAM
from planner.model.evidence import check_unit, refusal
from planner.model.joint import JointModel
from planner.planning.task import limits_in_shares, limits_of_each

if TYPE_CHECKING:
    from kinematics import Leg


Load = Array | Callable[[Array], Array]
"""Torques [N m], shape (n, k), or a function of poses [rad], shape (n, k), that returns them."""


@dataclass(frozen=True)
class Desired:
    """The desired motion of all joints: the settings, and all that their files hold."""

    settings: settings.Run
    names: tuple[str, ...]
    angles: Array  # desired [rad], shape (n, k)
    models: tuple[JointModel, ...]
    units: tuple[str, ...]  # the joints' units in the file
    cyclic: bool = True  # whether the path repeats for ever
    remarks: Sequence[str] = ()  # what the user should know about path and models
    loads: Array | None = None  # torques in the file [N m], shape (n, k); None without any
    load: Load | None = None  # torques on the joints, if the settings have any

    limits: tuple[Array, Array] | None = None  # smallest and largest requests [rad], each (k,)
    starts: Mapping[str, float] = field(default_factory=dict)  # rest angles by joint [rad]

    # the leg that the settings name, or by name the legs of a whole robot with all joints here
    leg: Leg | None = None
    legs: Mapping[str, Leg] = field(default_factory=dict)

    # of a foot path: desired positions [m], shape (n, 3), with "clamp" those at the clamped
    # angles; None or those before; and how many of them the leg cannot reach
    foot: Array | None = None
    foot_given: Array | None = None
    unreachable: int = 0

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0].period

    @property
    def title(self) -> str:
        """What is planned: the leg, the legs or the joints."""
        leg, file = self.settings.leg, own_robot(self.settings)
        name = f"{Path(file).name} · {leg.foot}" if file else leg.name
        return name or ", ".join(self.legs or self.names)

    @property
    def shown_units(self) -> dict[str, Literal["deg", "percent"]]:
        """See :func:`planner.files.columns.shown_units`."""
        return shown_units(self.names, self.units)

    @property
    def torques(self) -> Array | None:
        """The load at the desired angles [N m], shape (n, k)."""
        return self.load(self.angles) if callable(self.load) else self.load

    def of_leg(self, leg: Leg) -> Desired:
        """The joints of a leg in its order, under a load of their desired poses."""
        columns = [self.names.index(name) for name in leg.joint_names]
        return replace(
            self,
            names=leg.joint_names,
            units=tuple(self.units[j] for j in columns),
            angles=self.angles[:, columns],
            models=tuple(self.models[j] for j in columns),
            leg=leg,
            limits=self.limits and (self.limits[0][columns], self.limits[1][columns]),
            load=None if self.torques is None else self.torques[:, columns],
        )

    def write(self, path: Path | str, angles: Array, loads: Array | None = None) -> None:
        """Write angles or requests [rad] and torques [N m], (n, k), as CSV in the joints' units."""
        period, units = self.period, self.units
        paths.write_joint_path(path, self.names, angles, period=period, units=units, loads=loads)


@contextmanager
def units_in_messages(units: Mapping[str, str]) -> Iterator[None]:
    """Let errors about single joints inside the block use their units, by joint."""
    try:
        yield
    except PlannerError as error:
        for name in getattr(error, "__notes__", ()):
            if units.get(name) == "percent":
                error.args = (in_degrees(error, "percent"),)
        raise


def desired_of(run: settings.Run) -> Desired:
    """The desired motion of the settings, with limits, starts and load, for any method."""
    path, leg = _path_of(run)
    of_foot = path.names == paths.AXES
    names = leg.joint_names if of_foot and leg is not None else path.names
    units = ("deg",) * len(names) if of_foot else path.units
    models = models_of(run, names, leg, units=units)
    path, cyclic, remarks = _in_step(path, run, models[0].period)
    if leg is not None and (foreign := [name for name in names if name not in leg.joint_names]):
        raise BadSetting(
            f"joint '{foreign[0]}' of {path.path} is not on the leg; its joints: "
            f"{', '.join(leg.joint_names)}"
        )
    if not of_foot and "unreachable" in run.leg.keys_set:
        raise BadSetting("‹leg.unreachable› has no effect on a path of joints; leave it out")
    if path.loads is not None and run.plan.load is None:
        words = "the load in the path's columns is not used: ask for it with "
        remarks.append(f'{words}‹plan.load = "column"›')
    legs = {} if leg is not None else legs_of(run, among=names)
    desired = Desired(
        run,
        names,
        path.values,
        models,
        units=units,
        cyclic=cyclic,
        remarks=[*remarks, refused_models(names, models)],
        loads=path.loads,
        limits=_limits_of(run, names, models, path, legs.values() if leg is None else (leg,)),
        starts=starts_of(run.start, names, cyclic=cyclic),
        leg=leg,
        legs=legs,
    )
    if of_foot and leg is not None:  # by inverse kinematics
        angles, reachable, _ = leg.inverse(path.values, unreachable=run.leg.unreachable)
        unreachable, foot, given = int((~reachable).sum()), path.values, None
        if unreachable and run.leg.unreachable == "clamp":
            foot, given = leg.foot_positions(angles), foot
        desired = replace(
            desired, angles=angles, foot=foot, foot_given=given, unreachable=unreachable
        )
    return replace(desired, load=_load_of(desired))


def _path_of(run: settings.Run) -> tuple[paths.SampledPath, Leg | None]:
    """The path of the settings, of joints or a foot, and its leg."""
    leg, path, walk = leg_of(run), run.path, run.path.half_ellipse
    if walk is not None:
        from planner.gait.half_ellipse import half_ellipse  # with kinematics
        from planner.gait.stride import stride

        if other := "path.file" if path.file else "path.joints" if path.joints else "":
            words = f"got ‹{other}› too, expected one of them; remove the other"
            raise BadSetting(f"‹path.half_ellipse›: {words}")
        if leg is None:
            raise BadSetting(
                "‹path.half_ellipse›: a foot path needs a leg; set ‹leg.name›, and of your own "
                "robot ‹leg.base› and ‹leg.foot›"
            )
        if walk.for_leg:
            leg_stride = stride(leg, **walk.arguments(given_only=True))
            positions = leg_stride.foot
            leg = leg if run.leg.near else replace(leg, near=leg_stride.pose)
        else:
            positions = half_ellipse(**walk.arguments())
        name, units = "path.half_ellipse", ("m",) * 3
        return paths.SampledPath(name, paths.AXES, units, positions, None), leg
    if path.file is None:
        raise BadSetting("no path: expected ‹path.file› or [path.half_ellipse]")
    file = run.place(path.file)
    table, even = paths.path_table(file), path.rate_hz is None and path.speed is None
    if not paths.is_foot_path(table):
        return paths.joint_path(table, joints=path.joints, even=even), leg
    if leg is None:
        raise BadSetting(f"{file} is a foot path: name its leg with ‹leg.name›")
    if path.joints:
        raise BadSetting("‹path.joints› chooses columns of a joint path; a foot moves all joints")
    return paths.foot_path(table, even=even), leg


def load_joints(run: settings.Run) -> Desired:
    """Read a joint path whose rate is that of the models."""
    path = paths.read_joint_path(str(run.path.file), joints=run.path.joints)
    models = models_of(run, path.names, units=path.units)
    advice = f"name the rate of its rows with --rate-hz {1.0 / path.step:.6g}"
    advice += ", or set tick and hold in the model"
    path.check_period(models[0].period, advice, first=_opening(run))
    cyclic, closing = repeats(path.values, run.plan.cyclic)
    remarks = closing, refused_models(path.names, models)
    return Desired(
        run, path.names, path.values, models, path.units, cyclic, remarks, loads=path.loads
    )


def _opening(run: settings.Run) -> str:
    """The first words of errors about the rate of a path: whether that is a default model's."""
    words = "no --model was given, so each joint is the Sony Aibo's (for your own: --model FILE); "
    return "" if "file" in run.model.keys_set or run.path.rate_hz is not None else words


def _in_step(
    path: paths.SampledPath, run: settings.Run, period: float
) -> tuple[paths.SampledPath, bool, list[str]]:
    """The path with a sample every ``period`` [s], whether it repeats, and remarks on it."""
    rows, speed = path.values, run.path.speed
    closed, closing = repeats(rows, run.plan.cyclic)
    remarks = [closing]
    if len(rows) >= 10 and set(path.units) == {"deg"}:
        span, name = float(np.max(np.degrees(np.ptp(rows, axis=0)))), path.names[0]
        if 0.0 < span < LEAST_DEG:
            words = f"{path.path}: the angles span only {span:.2g} degrees: are they radians? then "
            remarks.append(f"{words}rename {name}_deg to {name}_rad")
    first, resample = _opening(run), run.path.rate_hz is not None
    resampled = path.in_step(period, first, resample=resample, cyclic=closed, speed=speed)
    new_rows = resampled.values
    if (count := len(new_rows)) < 3:
        advice = "give a longer path, a higher rate or a lower speed"
        raise InvalidFile(path.path, f"got {count} samples, expected at least 3; {advice}")
    if path.times is None or len(new_rows) >= len(rows):
        return resampled, closed, remarks
    times, step = path.times - path.times[0], period * (speed or 1.0)
    if closed:  # stretched over a whole number of samples
        step = times[-1] * len(rows) / (len(rows) - 1) / len(new_rows)
        new_rows = np.vstack([new_rows, new_rows[:1]])
    new_times = np.asarray(step * np.arange(len(new_rows)), dtype=np.float64)
    if lost := most_lost(times, rows, new_times, new_rows):
        worst, share = lost
        remarks.append(
            f"{path.path}: with a request every {1e3 * period:.3g} ms the path of "
            f"{path.names[worst]} is missed by {100.0 * share:.0f} % of its motion (rms), and the "
            "errors are those from the path that is left: plan with a higher rate (--rate-hz) to "
            "keep it"
        )
    return resampled, closed, remarks


def repeats(rows: Array, cyclic: bool | None) -> tuple[bool, str]:
    """Whether a path of these rows (n, k) repeats, and a remark if its ends have decided that."""
    if cyclic is not None:
        return cyclic, ""
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0)
    gaps = np.abs(rows[-1] - rows[0])
    # the last sample is about a step before the first, and no jump keeps the ends apart
    if np.all((gaps <= 3.0 * steps) & ((len(rows) < 4) | (gaps <= 0.6 * np.ptp(rows, axis=0)))):
        ends = np.abs(np.stack([rows[1] - rows[0], rows[-1] - rows[-2]]))
        at_rest = (
            "the path begins and ends at rest in the same place: it is taken as a cycle; "
            "‹plan.cyclic = false› plans a motion that is executed once"
        )
        return True, at_rest if np.all(ends <= 0.01 * steps) else ""
    apart = np.max(gaps / np.maximum(steps, np.finfo(float).tiny))
    away = f", but {apart:.3g} of its largest steps away" if apart > 3.0 else ""
    return False, (
        f"the path does not end where it begins{away}: it is taken as a motion from rest, as with "
        "‹plan.cyclic = false›; ‹plan.cyclic = true› lets it repeat"
    )


# Limits, starts and load.


def values_by_joint(
    table: str, values: settings.Limits | settings.Start, joints: Sequence[str]
) -> dict[str, Any]:
    """Values of a table with ``deg`` for all joints and ``joints`` for single ones, as they are."""
    for joint in values.joints:
        if joint not in joints:
            words = f"no such joint in the path{nearest(joint, joints)}"
            key = marked((table, "joints", joint))
            raise BadSetting(f"{key}: {words}; joints: {', '.join(joints)}")
    return {**({} if values.deg is None else dict.fromkeys(joints, values.deg)), **values.joints}


def _limits_of(
    run: settings.Run,
    names: Sequence[str],
    models: Sequence[JointModel],
    path: paths.SampledPath,
    legs: Iterable[Leg],
) -> tuple[Array, Array] | None:
    """Limits of joints [rad]: of the settings, or else common to the servos and the legs.

    Angles, such as those of servos, say nothing about joints in shares of a range.
    """
    spans = dict[str, tuple[float, float]]()
    for leg in legs:
        spans |= zip(leg.joint_names, map(tuple, np.transpose(leg.limits).tolist()), strict=True)
    file = robot_file(run)
    servos = {} if file is None else read_servos(file, optional=True)
    for name in servos.keys() & {*names}:
        (low, high), (lower, upper) = servos[name].limits, spans.get(name, (-math.inf, math.inf))
        spans[name] = max(lower, low), min(upper, high)
    for name, model, unit, values in zip(names, models, path.units, path.values.T, strict=False):
        if unit in SHARES:
            spans[name] = limits_in_shares(model, values, SHARES["range"])
    for name, (low, high) in values_by_joint("limits", run.limits, names).items():
        spans[name] = math.radians(low), math.radians(high)
    own = {name: spans[name] for name in names if name in spans}
    return limits_of_each(own, names) if own else None


def starts_of(start: settings.Start, joints: Sequence[str], *, cyclic: bool) -> Mapping[str, float]:
    """Rest angles of joints before a path that does not repeat, by joint [rad]."""
    if cyclic and start.keys_set:
        key = marked(("start", min(start.keys_set)))
        raise BadSetting(f"{key}: a cycle has no start; add ‹plan.cyclic = false›")
    angles = values_by_joint("start", start, joints)
    return {name: math.radians(angle) for name, angle in angles.items()}


def _load_of(desired: Desired) -> Load | None:
    """The torques on the joints of a path; None if the settings have no load.

    Of ``urdf-dynamics`` inertia counts along the desired path and gravity in the predicted pose:
    differences of a prediction would not settle.
    """
    load, leg = desired.settings.plan.load, desired.leg
    if load is None:
        return None
    key = marked("plan.load", load)
    check_felt(key, desired.models)
    if load == "column":
        if desired.loads is None:
            raise BadSetting(f"{key}: the path has no columns <joint>_load_Nm")
        return desired.loads
    if leg is None or set(leg.joint_names) != set(desired.names):
        raise BadSetting(f"{key}: needs a path of all joints of a leg; name it with ‹leg.name›")
    poses = desired.angles[:, [desired.names.index(name) for name in leg.joint_names]]
    period, dynamics = desired.period, load == "urdf-dynamics"
    return leg.load_of_pose(
        desired.names, poses, dynamics=dynamics, period=period, cyclic=desired.cyclic
    )


def check_felt(key: str, models: Iterable[JointModel]) -> None:
    """Refuse a load that no model feels."""
    if not any(model.feels_load for model in models):
        raise BadSetting(
            f"{key} has no effect: compliance and speed_per_torque of the models are 0; identify "
            "them from logs with a load, or leave the load out"
        )


# The robot: its legs, and one model per joint.


def find_leg(run: settings.Run) -> LegPlace | None:
    """The description of the leg; None if the settings name no leg."""
    leg = run.leg
    near = leg.near and {joint: math.radians(angle) for joint, angle in leg.near.items()}
    is_described = leg.base or leg.foot or leg.lock or leg.lock_m
    if leg.name is None:
        if is_described or near:
            raise BadSetting(
                "‹leg.base›, ‹leg.foot›, ‹leg.lock› and ‹leg.near› are of a leg: name it with "
                "‹leg.name›"
            )
        return None
    if leg.name in settings.LEG_NAMES:
        if is_described:
            words = "leave out ‹leg.base›, ‹leg.foot› and ‹leg.lock›"
            raise BadSetting(f"‹leg.name› is a shipped leg: {words}")
        return _shipped(leg.name)._replace(near=near)
    file = run.place(leg.name)
    if leg.base is None or leg.foot is None:
        if not Path(file).exists():
            raise InvalidFile(leg.name, "no such file; check the name and the folder")
        raise BadSetting(
            f"{Path(file).name}: your own robot needs ‹leg.base› and ‹leg.foot›, the frames at the "
            "leg's two ends"
        )
    locked = {joint: math.radians(angle) for joint, angle in (leg.lock or {}).items()}
    return LegPlace(file, leg.base, leg.foot, locked | (leg.lock_m or {}), near)


def own_robot(run: settings.Run) -> str | None:
    """The URDF of the user's own robot; None of a shipped leg."""
    return None if run.leg.name in settings.LEG_NAMES else run.leg.name


def _shipped(name: str) -> LegPlace:
    """The simplified leg of the reference walk, or one of the four legs of the ERS-210A."""
    from kinematics import urdf_path

    if name == "reference":
        return LegPlace(str(urdf_path("reference_leg.urdf")), "hip", "foot")
    return LegPlace(str(urdf_path("ers210a.urdf")), "body", f"{name.replace('-', '_')}_ball")


def leg_of(run: settings.Run) -> Leg | None:
    """The leg; None if the settings name no leg."""
    place = find_leg(run)
    return None if place is None else _loaded(place)


def _loaded(place: LegPlace) -> Leg:
    from kinematics import Leg

    urdf, base, foot, locked, near = place
    return Leg.from_urdf(urdf, base=base, foot=foot, locked=locked, near=near)


def legs_of(run: settings.Run, *, among: Sequence[str] | None = None) -> dict[str, Leg]:
    """The legs of the robot in the model file; the ERS-210A's legs for its own model.

    Of joints that they are ``among``, those whose joints are all there.
    """
    file = robot_file(run)
    places = {} if file is None else read_legs(file)
    if run.model.file == settings.SHIPPED_MODEL:
        _, *names = settings.LEG_NAMES
        own = tuple(f"{name.replace('-', '_')}_" for name in names)
        if among is None or any(joint.startswith(own) for joint in among):
            places = {name: _shipped(name) for name in names}
    legs = {name: _loaded(place) for name, place in places.items()}
    return {
        name: leg for name, leg in legs.items() if among is None or {*leg.joint_names} <= {*among}
    }


def models_of(
    run: settings.Run, joints: Sequence[str], leg: Leg | None = None, *, units: Sequence[str] = ()
) -> tuple[JointModel, ...]:
    """One model per joint, all with the same time between requests, by default the models' own.

    Of joints whose ``units`` are shares of their range, a percent becomes a degree; by default the
    joints have angles.
    """
    file, rate = run.model.file, run.path.rate_hz
    models = _by_file(run, joints, leg)
    if rate is not None:
        try:
            models = tuple(each.requested_every(1.0 / rate) for each in models)
        except InvalidModel as error:
            reason = str(error).removeprefix("period: got ")
            hint = f"; a period of {rate:g} s is a rate of {1.0 / rate:.6g} Hz" * (rate < 1.0)
            raise BadSetting(f"‹path.rate_hz›: got {rate:g}, {reason}{hint}") from error
    period = models[0].period
    for name, each in zip(joints, models, strict=True):
        if abs(each.period - period) > 1e-9 * period:
            raise InvalidFile(
                run.place(file),
                f"'{name}' takes a request every {each.period:g} s and '{joints[0]}' every "
                f"{period:g} s, expected one rate; plan them one by one",
            )
    shares = [unit in SHARES for unit in units or ["deg"] * len(joints)]
    for name, each, share in zip(joints, models, shares, strict=True):
        check_unit(name, each.evidence, shares=share)
    if not any(shares):
        return models
    if file == settings.SHIPPED_MODEL:
        raise BadSetting(
            "the path has joints in shares of their range, of which the ERS-210A's model says "
            "nothing; name models of theirs, as identify writes them, with ‹model.file›"
        )
    pairs = zip(models, shares, strict=True)
    return tuple(scaled(each) if share else each for each, share in pairs)


def model_of(run: settings.Run, joint: str) -> JointModel:
    """The model of a joint without a path, in its own unit."""
    (model,) = _by_file(run, [joint], None)
    return model


def _by_file(run: settings.Run, joints: Sequence[str], leg: Leg | None) -> tuple[JointModel, ...]:
    name = run.model.file
    if name == settings.SHIPPED_MODEL:
        return (JointModel.ers210a(),) * len(joints)
    if name != settings.FROM_URDF:
        file = run.place(name)
        if not Path(file).suffix and not Path(file).exists():
            raise BadSetting(
                f"‹model.file›: got '{name}', expected '{settings.SHIPPED_MODEL}', "
                f"'{settings.FROM_URDF}', or a file that exists, such as joint.toml"
            )
        return read_model_file(file).for_joints(joints)
    key = marked("model.file", settings.FROM_URDF)
    if leg is None or leg.speeds is None:
        raise BadSetting(f"{key} takes speeds from a leg's URDF: name it with ‹leg.name›")
    speeds = dict(zip(leg.joint_names, leg.speeds.tolist(), strict=True))
    for joint in joints:
        if math.isnan(speeds.get(joint, math.nan)):
            raise BadSetting(
                f"{key}: the URDF has no usable top speed of joint '{joint}'; give a model file, "
                "as `identify` writes it"
            )
    paper = JointModel.ers210a()  # its theta_0 in the same ratio
    share = paper.theta_0 / paper.v_max
    return tuple(replace(paper, v_max=speeds[j], theta_0=speeds[j] * share) for j in joints)


def scaled(model: JointModel, factor: float = SHARES["range"]) -> JointModel:
    """The model of a joint in shares of its range, by default so that a percent is a degree."""
    angles = [each.name for each in fields(model) if each.metadata["unit"].startswith("rad")]
    other = replace(model, **{name: factor * getattr(model, name) for name in angles})
    return other.with_evidence(model.evidence and model.evidence.scaled(factor, angles))


def refused_models(names: Sequence[str], models: Sequence[JointModel]) -> str:
    """A remark on joints whose models are not to be planned with."""
    return refusal(dict(zip(names, (model.evidence for model in models), strict=True)))


def model_words(model: settings.Model) -> str:
    """The joint model of an answer, in words."""
    words = {
        settings.SHIPPED_MODEL: f"{settings.SHIPPED_MODEL}, a joint of the Sony Aibo",
        settings.FROM_URDF: "a joint of the Sony Aibo, with the top speeds of the URDF",
    }
    return f"model: {words.get(model.file, model.file)}"


def robot_file(run: settings.Run) -> str | None:
    """The model file, if it can be read again for legs and servos; else None."""
    no_files = (settings.SHIPPED_MODEL, settings.FROM_URDF, STANDARD_STREAM)
    return None if run.model.file in no_files else run.place(run.model.file)
