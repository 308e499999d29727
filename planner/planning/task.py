"""What is asked of a plan: joints, goal, limits and what counts, checked once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from planner.exceptions import (
    Infeasible,
    InvalidInput,
    InvalidTrajectory,
    about,
    angle_text,
    nearest,
)
from planner.identification.result import Identification
from planner.model.drawn_models import drawn_models
from planner.model.joint import JointModel, checked_model
from planner.model.load import checked_load, load_columns, rest_angles
from planner.model.response import checked_start, simulate_joints
from planner.planning.arguments import (
    NEGLIGIBLE_SAG,
    ON_THE_LIMIT,
    Norm,
    Robust,
    check_norm,
    check_robust,
)
from planner.planning.error_norm import error_norm
from planner.robot.schedule import as_rows
from planner.trajectory import Array, Mask, as_trajectory, check_radians
from planner.validation import as_flag, as_number, as_positive, as_reals, freeze, shown

if TYPE_CHECKING:
    from kinematics.leg import Leg

Value = TypeVar("Value")

ModelOrModels = JointModel | Sequence[JointModel] | Identification
"""A joint: its model, several that it may have, or an identification, whose intervals give them."""

Models = ModelOrModels | Sequence[ModelOrModels] | Mapping[str, ModelOrModels]
"""One model for all joints, one for each, or models by joint; the key "" holds the default one.

Instead of one model: a sequence of candidate models, nominal first, or an identification.
"""

Limits = tuple[npt.ArrayLike, npt.ArrayLike] | Mapping[str, tuple[float, float]]
"""Smallest and largest request, as numbers or one of each joint, or pairs by joint."""

Scenarios = tuple[tuple[JointModel, ...], ...]
"""Models of joints that are planned together, the nominal ones first: in each scenario one for
each joint."""

SMOOTHNESS = 0.005
"""Relative rise of the error that smoother requests may cost where nothing else is asked for [-].
"""

MOST_SMOOTHNESS = 1e6
"""Largest rise that is taken [-]: requests that do not move at all are reached long before."""

COLUMNS = "columns of desired"
"""What has an entry for each joint, in messages, where the joints have no leg."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """What is asked of a plan. Checked once, by :meth:`of`; arrays are read-only.

    Attributes:
        names: The k joints; ``("",)`` for one that has no name.
        models: The models that each joint may have, the nominal one first.
        desired: Desired angles [rad], shape (n, k); for a foot those that bring it nearest.
        goal: Whether the error of each joint's angles counts, or that of the foot's position.
        leg: The leg whose joints these are, in its order; None where that is not known.
        foot: Desired positions of its foot [m], shape (n, 3); None for a path of joints.
        weights: How much each axis of the foot's position counts, shape (3,).
        reachable: Which of these positions the leg can reach, shape (n,).
        cyclic: Whether the path repeats for ever.
        norm: The error that counts.
        lower: Smallest request of each joint [rad], shape (k,); -inf where there is none.
        upper: Largest request of each joint [rad], shape (k,); inf where there is none.
        max_step: Largest change from one request to the next [rad], shape (k,); inf for any.
        start: From rest: angles at which the joints rest before the first request [rad], (k,).
        smoothness: Relative rise of the error that smoother requests may cost [-].
        robust: With several models: whether the "mean" or the "worst" of their errors counts.
        tolerance: Error that the plan should keep [rad], [m] for a foot; None for none.
        load: Torques in the period that ends in each sample [N m], shape (n, k), 0 for joints that
            feel none; None where no joint feels one.
        load_of_pose: Whether that is the load of the predicted angles.
        disturbance: What executed cycles add to the models' angles [rad], shape (n, k), or None.
    """

    names: tuple[str, ...]
    models: tuple[tuple[JointModel, ...], ...]
    desired: Array
    cyclic: bool
    norm: Norm
    lower: Array
    upper: Array
    max_step: Array
    smoothness: float
    goal: Literal["angles", "foot"] = "angles"
    leg: Leg | None = None
    foot: Array | None = None
    weights: Array | None = None
    reachable: Mask | None = None
    start: Array | None = None
    robust: Robust | None = None
    tolerance: float | None = None
    load: Array | None = None
    load_of_pose: bool = False
    disturbance: Array | None = None

    @classmethod
    def of(
        cls,
        models: Models,
        desired: npt.ArrayLike,
        *,
        names: Sequence[str] | None = None,
        leg: Leg | None = None,
        weights: npt.ArrayLike = (1.0, 1.0, 1.0),
        unreachable: Literal["nearest", "raise"] = "nearest",
        cyclic: bool = True,
        norm: Norm = "rms",
        limits: Limits | None = None,
        max_step: npt.ArrayLike | Mapping[str, float] | None = None,
        start: npt.ArrayLike | Mapping[str, float] | None = None,
        smoothness: float | None = None,
        robust: Robust | None = None,
        tolerance: float | None = None,
        load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None = None,
        disturbance: npt.ArrayLike | None = None,
    ) -> Task:
        """The task of arguments as :func:`planner.plan`, or with a leg :func:`planner.invert_foot`.

        A number counts for all joints, of an array each entry for one; a dict has some of them by
        name. Without a leg ``desired`` are angles (n, k) [rad], with one positions (n, 3) [m]. A
        load of the pose is the caller's: see :func:`planner.planning.load_of_pose.settled`.

        Raises:
            InvalidInput: An argument is none, or does not fit the others.
            InvalidTrajectory: ``desired`` is not finite, or has fewer than three rows.
            Infeasible: The limits exclude each other, the start or a desired angle.
            kinematics.KinematicsError: The leg has no inverse.
        """
        check_norm(norm)
        cyclic = as_flag("cyclic", cyclic)
        foot = importance = solution = None
        if leg is None:
            angles = as_rows(desired, name="desired")
            _check_length(len(angles))
            names, joints = joint_names(names, models, angles.shape[1]), COLUMNS
        else:
            names, joints = checked_leg(leg).joint_names, joints_of(leg)
        several = models_of_joints(
            models, names, robust, joints=joints, independent=leg is not None
        )
        _check_periods([each[0] for each in several], given_as="models")
        many = max(map(len, several)) > 1
        if leg is not None:
            _check_numbers(several, joints)
            importance = _checked_weights(weights)
            limits = leg.limits if limits is None else limits
        lower, upper = limits_of_each(limits, names, joints=joints)
        if leg is not None:
            for name, low, high in zip(names, lower, upper, strict=True):
                checked_limits((low, high), of=f"limits of {name}")
        steps = steps_of_each(max_step, names, joints=joints)
        share = checked_smoothness(smoothness)
        if leg is not None:
            solution = leg.inverse(desired, unreachable=unreachable)
            foot, angles = np.array(desired, dtype=np.float64), solution.angles
            if len(foot) < 3:
                raise InvalidInput(f"foot: got {len(foot)} points, expected at least 3")
        added = _checked_disturbance(disturbance, angles)
        resting = angles_of_each("start", start, names)
        for j, name in enumerate(names if leg is None else ()):
            with about(name):
                checked_start(resting[j], cyclic=cyclic)
                checked_limits((lower[j], upper[j]))
        begin = [
            each if rest is None else rest for each, rest in zip(angles[0], resting, strict=True)
        ]
        task = cls(
            names=names,
            models=tuple(several),
            desired=angles,
            cyclic=cyclic,
            norm=norm,
            lower=lower,
            upper=upper,
            max_step=steps,
            smoothness=share,
            goal="angles" if leg is None else "foot",
            leg=leg,
            foot=foot,
            weights=importance,
            reachable=None if solution is None else solution.reachable,
            start=None if cyclic else np.array(begin),
            robust=(robust or "mean") if many else None,
            tolerance=None if tolerance is None else checked_tolerance(tolerance),
            disturbance=added,
        )
        return task.under(load)

    def __post_init__(self) -> None:
        """Let nobody write to the arrays."""
        freeze(*(each for each in vars(self).values() if isinstance(each, np.ndarray)))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The same of those that were copied or read from a pickle."""
        self.__dict__.update(state)
        self.__post_init__()

    @property
    def nominal(self) -> tuple[JointModel, ...]:
        """The nominal model of each joint."""
        return tuple(each[0] for each in self.models)

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0][0].period

    @cached_property
    def scenarios(self) -> Scenarios:
        """The models of all joints together, in their order; one model counts in every scenario."""
        most = max(map(len, self.models))
        each = (models if len(models) == most else models * most for models in self.models)
        return tuple(zip(*each, strict=True))

    @cached_property
    def loads(self) -> tuple[Array | None, ...]:
        """Torque on each joint [N m], (n,), or None where none of its models feels it."""
        return tuple(
            column if any(model.feels_load for model in models) else None
            for models, column in zip(self.models, self.columns(self.load), strict=True)
        )

    def loads_on(self, models: Sequence[JointModel]) -> tuple[Array | None, ...]:
        """The same as one model of each joint feels it."""
        pairs = zip(models, self.loads, strict=True)
        return tuple(load if model.feels_load else None for model, load in pairs)

    @cached_property
    def starts(self) -> tuple[float | None, ...]:
        """From rest: angle of each joint before the first request [rad]; None in a cycle."""
        return (None,) * len(self.names) if self.start is None else tuple(self.start.tolist())

    @cached_property
    def limits(self) -> tuple[tuple[float, float] | None, ...]:
        """Smallest and largest request of each joint [rad]; None where it has no limits."""
        pairs = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        return tuple(None if (low, up) == (-math.inf, math.inf) else (low, up) for low, up in pairs)

    @property
    def desired_foot(self) -> Array:
        """Desired positions of the foot [m], (n, 3): of a path of joints those at its angles."""
        if self.foot is not None:
            return self.foot
        assert self.leg is not None, "a foot belongs to a leg"
        return self.leg.foot_positions(self.desired)

    def response(self, requests: Array, models: Sequence[JointModel] | None = None) -> Array:
        """Angles of the nominal or other models under requests [rad], (n, k); no disturbance."""
        return simulate_joints(
            self.nominal if models is None else models,
            requests,
            cyclic=self.cyclic,
            starts=self.starts,
            loads=self.loads,
        )

    def errors_of(self, angles: Array) -> Array:
        """Errors of angles (n, k) in the norm that counts: of each joint [rad], of the foot [m].

        The axes of the foot are weighted, the heaviest by 1.
        """
        if self.goal == "foot":
            assert self.leg is not None, "a foot belongs to a leg"
            assert self.weights is not None, "the axes of a foot have weights"
            away = self.leg.foot_positions(angles) - self.desired_foot
            away = np.linalg.norm(away * axis_scales(self.weights), axis=1)
            return np.array([error_norm(away, self.norm)])
        errors = (np.ascontiguousarray(column) for column in (angles - self.desired).T)
        return np.array([error_norm(each, self.norm) for each in errors])

    def with_models(self, models: Sequence[JointModel]) -> Task:
        """The same task for one model of each joint."""
        return replace(self, models=tuple((each,) for each in models), robust=None)

    def joint(self, j: int) -> Task:
        """The task of one of the joints, which are planned one by one."""
        own: dict[str, Any] = {name: getattr(self, name)[j : j + 1] for name in _BY_JOINT}
        for name in ("desired", "load", "disturbance"):
            own[name] = _column(getattr(self, name), j)
        own["start"] = None if self.start is None else self.start[j : j + 1]
        own["robust"] = self.robust if len(self.models[j]) > 1 else None
        own |= dict.fromkeys(("leg", "foot", "weights", "reachable"))
        return replace(self, goal="angles", **own)

    @classmethod
    def joined(cls, tasks: Sequence[Task]) -> Task:
        """The task of several joints that are planned one by one, all with the same options."""
        own: dict[str, Any] = {
            name: sum((getattr(each, name) for each in tasks), ()) for name in ("names", "models")
        }
        for name in ("lower", "upper", "max_step"):
            own[name] = np.concatenate([getattr(each, name) for each in tasks])
        own["desired"] = np.hstack([each.desired for each in tasks])
        own["load"] = load_columns([each.loads[0] for each in tasks], len(tasks[0].desired))
        if tasks[0].start is not None:
            own["start"] = np.array([each.starts[0] for each in tasks])
        if tasks[0].disturbance is not None:
            own["disturbance"] = np.hstack([each.disturbance for each in tasks])  # type: ignore[misc]
        own["robust"] = next((each.robust for each in tasks if each.robust), None)
        own["load_of_pose"] = any(each.load_of_pose for each in tasks)
        return replace(tasks[0], **own)

    def under(
        self, load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None, *, of_pose: bool = False
    ) -> Task:
        """The same task under another load [N m], which may be that of a pose, checked.

        Raises:
            InvalidInput: It is not of one of the shapes of :meth:`of`, or a joint cannot move
                against it.
            Infeasible: Under it the limits exclude the start or a desired angle.
        """
        given = loads_of_each(load, self.names, self.desired.shape, joints=self._joints)
        loads: list[Array | None] = []
        for name, models, column in zip(self.names, self.models, given, strict=True):
            with about(name if self.goal == "angles" else ""):
                felt = [checked_load(column, each, len(self.desired)) for each in models]
                loads.append(next((each for each in felt if each is not None), None))
        columns = load_columns(loads, len(self.desired))
        freeze(columns)
        task = replace(self, load=columns, load_of_pose=of_pose and columns is not None)
        if task.goal == "angles":
            for j, name in enumerate(task.names):
                with about(name):
                    task._check_within(j)
            return task
        if task.cyclic:
            return task
        ends = (rest_angles(task.nominal, end, task.loads) for end in (task.lower, task.upper))
        return replace(task, start=np.clip(task.desired, *ends)[0])

    @property
    def _joints(self) -> str:
        return joints_of(self.leg) if self.leg and self.goal == "foot" else COLUMNS

    def columns(self, rows: Array | None) -> list[Array | None]:
        """An array (n, k) by joint, each of shape (n,), or None."""
        if rows is None:
            return [None] * len(self.names)
        columns = [np.ascontiguousarray(rows[:, j]) for j in range(len(self.names))]
        freeze(*columns)
        return [*columns]

    def _check_within(self, j: int) -> None:
        """Raise Infeasible where the start or a desired angle is one that no request can hold.

        A negligible sag is left out of it: the joint then stays that little short of the limit. Dry
        friction holds the joint wherever the request is within the dead band.
        """
        limits, model = self.limits[j], self.models[j][0]
        if limits is None:
            return
        (lower, upper), angles = limits, self.desired[:, j]
        load = self.loads_on(self.nominal)[j]
        torques = np.zeros(len(angles)) if load is None else load
        count = len(angles)
        if self.start is not None:
            angles, torques = np.append(angles, self.start[j]), np.append(torques, torques[0])
        sags = model.sag(torques)
        beyond = np.maximum(lower - (angles - sags), (angles - sags) - upper) - model.dead_band
        worst = int(np.argmax(beyond - np.minimum(np.abs(sags), NEGLIGIBLE_SAG)))
        sag = float(sags[worst])
        if beyond[worst] > ON_THE_LIMIT + min(abs(sag), NEGLIGIBLE_SAG):
            what = f"desired: sample {worst}" if worst < count else "start: it"
            raise Infeasible(
                f"{what} is {angle_text(angles[worst])}, {angle_text(beyond[worst])} beyond the "
                f"angles {angle_text(lower + sag - model.dead_band, upper + sag + model.dead_band)}"
                " where the limits on the requests let the joint rest; clip the trajectory, or "
                "widen the limits"
            )


_BY_JOINT = ("names", "models", "lower", "upper", "max_step")


def _column(rows: Array | None, j: int) -> Array | None:
    return None if rows is None else np.ascontiguousarray(rows[:, j : j + 1])


def axis_scales(weights: Array) -> Array:
    """Factors of a foot's three axes, the heaviest 1: the root of each weight, shape (3,)."""
    scales: Array = np.sqrt(weights / np.max(weights))
    return scales


def checked_leg(leg: object) -> Leg:
    """The leg, or InvalidInput where it is none."""
    from kinematics.leg import Leg  # with Pinocchio

    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    return leg


def joints_of(leg: Leg) -> str:
    """The joints of a leg, in words."""
    return f"leg's joints ({', '.join(leg.joint_names)})"


def one_path(desired: npt.ArrayLike) -> Array:
    """The desired angles of one joint [rad], (n,); raise InvalidTrajectory where they are none."""
    angles = as_trajectory(desired, name="desired", minimum=3)
    check_radians(angles, name="desired")
    return angles


def joint_names(
    names: Sequence[str] | None, models: object, count: int, *, joints: str = COLUMNS
) -> tuple[str, ...]:
    """The names of joints, all different; by default the keys of models, or joint_1 and so on."""
    if names is not None:
        given = tuple(names) if isinstance(names, list | tuple) else ()
        are_texts = all(isinstance(name, str) for name in given)
        if not are_texts or len(given) != count or len(set(given)) != count:
            raise InvalidInput(
                f"names: got {shown(names)}, expected {count} different names, one for each of the "
                f"{joints}"
            )
        return given
    if isinstance(models, Mapping) and (named := tuple(name for name in models if name)):
        if len(named) != count:
            raise InvalidInput(
                f"desired: got {count} columns for the models of {', '.join(named)}; name the "
                "joints of the columns with names="
            )
        return named
    return tuple(f"joint_{j + 1}" for j in range(count))


def checked_models(
    model: ModelOrModels, robust: Robust | None = None, *, seed: int = 0
) -> tuple[JointModel, ...]:
    """The models that a joint may have, the nominal one first.

    A model by itself is the only one, unless ``robust`` asks for those that its intervals allow. A
    sequence has all of them: of one, the joint has that model in any case. Those of an
    identification are always drawn from its intervals.

    Args:
        model: The joint.
        robust: Which error over several models counts.
        seed: That of :func:`drawn_models`.

    Raises:
        InvalidInput: There is none, one is no JointModel, their request periods differ, or one by
            itself has no intervals.
    """
    if isinstance(model, Identification):
        return drawn_models(model.model, seed=seed)
    if isinstance(model, JointModel) or not isinstance(model, Sequence) or isinstance(model, str):
        only = checked_model(model)
        return (only,) if robust is None else drawn_models(only, seed=seed)
    models = tuple(checked_model(each) for each in model)
    if not models or len({each.period for each in models}) > 1:
        raise InvalidInput(
            f"model: got {len(models)} models with periods of "
            f"{', '.join(f'{each.period:g}' for each in models) or 'nothing'} s, expected at least "
            "one, all of one joint with one request period"
        )
    return models


def models_of_joints(
    models: Models,
    names: Sequence[str],
    robust: Robust | None = None,
    *,
    joints: str = COLUMNS,
    independent: bool = False,
) -> list[tuple[JointModel, ...]]:
    """The models that each joint may have, the nominal one first, in the order of the joints.

    Args:
        models: See :data:`Models`. For one joint a flat sequence of more than one has its models.
        names: The joints.
        robust: Whether others are drawn for models by themselves.
        joints: What has a joint each, in words.
        independent: Whether the models of different joints are drawn independently of one another.
            Joints with the same model share what is not known of it.

    Raises:
        InvalidInput: They do not fit the joints, see :func:`checked_models`, or ``robust`` is no
            error over models, or is given where every joint has one model in any case.
    """
    check_robust(robust)
    given: list[Any]
    if isinstance(models, Mapping):
        if missing := [name for name in names if name not in models and "" not in models]:
            raise InvalidInput(
                f"models: none for joint '{missing[0]}'; got "
                f"{', '.join(map(str, models)) or 'none'}"
            )
        given = [models[name] if name in models else models[""] for name in names]
    elif isinstance(models, JointModel | Identification):
        given = [models] * len(names)
    else:
        try:
            given = list(models)
        except TypeError:
            given = []
        if len(names) == 1 and len(given) > 1:
            given = [given]
        fit = all(isinstance(each, JointModel | Identification | Sequence) for each in given)
        fit = fit and not any(isinstance(each, str) for each in given)
        if len(given) != len(names) or (not fit and names != ("",)):
            raise InvalidInput(
                f"models: got {len(given)} of them for {len(names)} joints, expected one "
                f"JointModel, or one for each of the {joints}"
            )
    known = [_what_is_known(each) for each in given]
    seeds = [known.index(each) if independent else 0 for each in known]
    pairs = zip(given, seeds, strict=True)
    several = [checked_models(each, robust, seed=seed) for each, seed in pairs]
    if robust is not None and all(len(each) == 1 for each in several):
        raise InvalidInput(
            f"robust: got {robust!r} for a sequence of one model, which the joint has in any case; "
            "expected several models, or the model by itself, from whose intervals others are drawn"
        )
    return several


def _what_is_known(model: ModelOrModels) -> object:
    """What models are drawn from, to compare."""
    model = model.model if isinstance(model, Identification) else model
    return (model, model.evidence) if isinstance(model, JointModel) else model


def _check_periods(models: Sequence[JointModel], *, given_as: str) -> None:
    """Raise InvalidInput where joints are not requested at one rate."""
    periods = sorted({model.period for model in models})
    if len(periods) > 1:
        raise InvalidInput(
            f"{given_as}: their periods are {', '.join(f'{p:g}' for p in periods)} s, expected one "
            "period: joints that are requested at different rates are not planned together"
        )


def _check_numbers(several: Sequence[tuple[JointModel, ...]], joints: str) -> None:
    """Raise InvalidInput where joints of one leg have different numbers of models."""
    if len({len(each) for each in several} - {1}) > 1:
        raise InvalidInput(
            f"models: got {', '.join(str(len(each)) for each in several)} of the {joints}, "
            "expected as many of each, taken in their order, or one where a joint has but one"
        )


def model_of_each(
    models: JointModel | Sequence[JointModel], count: int, *, given_as: str, joints: str
) -> tuple[JointModel, ...]:
    """One model for every joint; raise InvalidInput where they do not fit.

    Args:
        models: One for all of them, or one for each.
        count: How many joints there are.
        given_as: What the caller calls the models.
        joints: What has a joint each, in words.
    """
    try:
        each = (models,) * count if isinstance(models, JointModel) else tuple(models)
    except TypeError:
        each = ()
    if len(each) != count or not all(isinstance(model, JointModel) for model in each):
        raise InvalidInput(
            f"{given_as}: got {len(each)} of them for {count} joints, expected one JointModel, or "
            f"one for each of the {joints}"
        )
    _check_periods(each, given_as=given_as)
    return each


def checked_limits(limits: object, *, of: str = "limits") -> tuple[float, float]:
    """The limits as floats.

    Raises:
        InvalidInput: The limits are not two numbers.
        Infeasible: The lower limit is above the upper one.
    """
    try:
        lower, upper = (as_number(limit, infinite=True) for limit in limits)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        lower = upper = math.nan
    if math.isnan(lower) or math.isnan(upper):
        raise InvalidInput(
            f"{of}: got {shown(limits)}, "
            "expected (lower, upper) [rad]; use -inf or inf for no limit"
        )
    if lower > upper:
        raise Infeasible(
            f"{of}: the lower one, {angle_text(lower)}, is above the upper one, "
            f"{angle_text(upper)}; swap them, or check their units"
        )
    return lower, upper


def limits_of_each(
    limits: Limits | None, names: Sequence[str], *, joints: str = COLUMNS
) -> tuple[Array, Array]:
    """Smallest and largest request of every joint [rad], each of shape (k,), not yet compared.

    Raises:
        InvalidInput: They are no pair of numbers, or of as many as there are joints, or of a joint
            that is not planned.
    """
    if limits is None:
        limits = {}
    if isinstance(limits, Mapping):
        _check_known("limits", limits, names)
        pairs = []
        for name in names:
            with about(name):
                pairs.append(checked_limits(limits.get(name, (-math.inf, math.inf))))
        lower, upper = np.array(pairs).T
        return lower, upper
    if names == ("",):
        checked_limits(limits)
    try:
        lower, upper = (np.broadcast_to(as_reals(limit), len(names)).copy() for limit in limits)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"limits: got {shown(limits)}, "
            f"expected (lower, upper) [rad], each a number or one for each of the {joints}"
        ) from error
    return lower, upper


def angles_of_each(
    what: str,
    given: npt.ArrayLike | Mapping[str, float] | None,
    names: Sequence[str],
    *,
    joints: str = COLUMNS,
    expected: str = "a number [rad] or one",
) -> list[float | None]:
    """An angle of every joint [rad]; None where it has none.

    Raises:
        InvalidInput: They are no numbers, not as many as there are joints, or of one that is not
            planned.
    """
    if given is None:
        return [None] * len(names)
    if isinstance(given, Mapping):
        _check_known(what, given, names)
        return [given.get(name) for name in names]
    if names == ("",):
        return [given]  # type: ignore[list-item]  # checked by the caller
    try:
        return list(np.broadcast_to(as_reals(given), len(names)).tolist())
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"{what}: got {shown(given)}, expected {expected} for each of the {joints}"
        ) from error


def steps_of_each(
    max_step: npt.ArrayLike | Mapping[str, float] | None,
    names: Sequence[str],
    *,
    joints: str = COLUMNS,
) -> Array:
    """Largest change of every joint's request [rad], shape (k,), inf where there is no limit.

    Raises:
        InvalidInput: They are not above 0, or not as many as there are joints.
    """
    expected = "an angle above 0 [rad], or one"
    given = angles_of_each("max_step", max_step, names, joints=joints, expected=expected)
    steps = np.full(len(names), math.inf)
    for j, (name, step) in enumerate(zip(names, given, strict=True)):
        if step is not None:
            steps[j] = as_number(step, infinite=True)
        with about(name):
            if not steps[j] > 0.0:
                raise InvalidInput(
                    f"max_step: got {shown(step)}, expected an angle above 0 [rad], the largest "
                    "change from one request to the next; leave it out for no limit"
                )
    return steps


def loads_of_each(
    load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None,
    names: Sequence[str],
    shape: tuple[int, ...],
    *,
    joints: str = COLUMNS,
) -> list[npt.ArrayLike | None]:
    """Torque on each joint [N m], a number or shape (n,), or None; not yet held against models.

    Args:
        load: A number, one for each joint, or one for each joint at every sample; for one joint
            also shape (n,); or by joint.
        names: The joints.
        shape: Samples and joints, (n, k).
        joints: What has a joint each, in words.

    Raises:
        InvalidInput: It has another shape, or a joint that is not planned.
    """
    if load is None:
        return [None] * len(names)
    if isinstance(load, Mapping):
        _check_known("load", load, names)
        return [load.get(name) for name in names]
    if names == ("",):
        return [load]
    try:
        torques = as_reals(load)
        if torques.ndim == 1 and shape[1] == 1:
            torques = torques[:, np.newaxis]
        return list(np.broadcast_to(torques, shape).T)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: got {shown(load)}, expected torques [N m] of shape {tuple(shape)} or "
            f"({shape[1]},), one for each of the {joints}, or a number"
        ) from error


def checked_smoothness(smoothness: float | None) -> float:
    """The relative rise of the error that smoother requests may cost [-].

    Raises:
        InvalidInput: It is no number from 0 to :data:`MOST_SMOOTHNESS`.
    """
    if smoothness is None:
        return SMOOTHNESS
    number = as_number(smoothness)
    if not 0.0 <= number <= MOST_SMOOTHNESS:
        raise InvalidInput(
            f"smoothness: got {shown(smoothness)}, expected the share of the error that may be "
            f"added, from 0 to {MOST_SMOOTHNESS:g}; 0.005 is half a per cent"
        )
    return number


def checked_tolerance(tolerance: float) -> float:
    """The tolerance as a float; raise InvalidInput for no number above 0."""
    return as_positive("tolerance", tolerance, "a finite number above 0")


def _check_known(what: str, values: Mapping[str, Value], names: Sequence[str]) -> None:
    """Raise InvalidInput unless values by joint are of joints that are planned."""
    if strange := [name for name in values if name not in names]:
        hint = nearest(str(strange[0]), names)
        raise InvalidInput(
            f"{what}: no joint {shown(strange[0])}{hint}; joints: {', '.join(names)}"
        )


def _check_length(samples: int) -> None:
    if samples < 3:
        raise InvalidTrajectory(f"desired: got {samples} samples, expected at least 3")


def _checked_weights(weights: npt.ArrayLike) -> Array:
    try:
        importance = as_reals(weights)
    except (TypeError, ValueError):
        importance = np.empty(0)
    fit = importance.shape == (3,) and bool(np.all(np.isfinite(importance)))
    if not fit or np.any(importance < 0.0) or not np.any(importance > 0.0):
        raise InvalidInput(
            f"weights: got {shown(weights)}, expected three numbers, 0 or more and not all 0"
        )
    return importance


def _checked_disturbance(disturbance: npt.ArrayLike | None, angles: Array) -> Array | None:
    """The disturbance [rad], a copy of the shape of the angles (n, k); None where there is none."""
    if disturbance is None:
        return None
    try:
        added = as_reals(disturbance)
    except (TypeError, ValueError):
        added = np.empty(0)
    if added.shape != angles.shape or not np.all(np.isfinite(added)):
        raise InvalidInput(
            f"disturbance: got {shown(disturbance)}, expected finite angles [rad] of shape "
            f"{angles.shape}, a column for each joint"
        )
    return added
