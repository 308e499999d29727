"""The task of a plan: joints, goal, limits and norm, checked once."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from planner.arrays import (
    Array,
    Mask,
    ReadOnly,
    as_flag,
    as_number,
    as_positive,
    as_reals,
    as_rows,
    as_trajectory,
    check_choice,
    check_radians,
    error_norm,
    excess,
    freeze,
    shown,
    steps,
)
from planner.exceptions import (
    Infeasible,
    InvalidInput,
    InvalidTrajectory,
    about,
    angle_text,
    nearest,
)
from planner.model.joint import JointModel, checked_model
from planner.model.response import (
    checked_load,
    checked_start,
    load_columns,
    of_joints,
    simulate_joints,
)

if TYPE_CHECKING:
    from kinematics.leg import Leg
    from planner.identification.result import Identification

Norm = Literal["rms", "max"]

NORMS: tuple[Norm, ...] = ("rms", "max")
"""The error that counts: the root mean square, or the largest."""

Robust = Literal["mean", "worst"]
"""The error over several models that is minimised."""

ModelOrModels: TypeAlias = "JointModel | Sequence[JointModel] | Identification"
"""A joint: its model, candidate models, or an identification, whose intervals give candidates."""

Models: TypeAlias = "ModelOrModels | Sequence[ModelOrModels] | Mapping[str, ModelOrModels]"
"""One model for all joints, one for each, or models by joint; the key "" holds the default one.

Instead of one model: a sequence of candidate models, nominal first, or an identification.
"""

Solver = Literal["gauss-newton", "ipopt"]

SOLVERS: tuple[Solver, ...] = ("gauss-newton", "ipopt")
"""Solvers of the optimised inversion: the package's own, and IPOPT through CasADi."""

LoadOfPose = Callable[[Array], npt.ArrayLike]
"""Torques on the joints [N m], shape (n, k), by their angles [rad], shape (n, k)."""

JointLimits = tuple[npt.ArrayLike, npt.ArrayLike] | Mapping[str, tuple[float, float]]
"""Smallest and largest request, as numbers or one of each joint, or pairs by joint."""

ON_THE_LIMIT = 1e-9
"""How far beyond its limits a desired angle may lie [rad]: rounding of degrees, no more."""

NEGLIGIBLE_SAG = 1e-3
"""A sag up to this does not put a path out of reach [rad]: a fifth of a count of the ERS-210A's
sensor, and the error of an identified sag of 0."""

SMOOTHNESS = 0.005
"""Default relative rise of the error that smoother requests may cost [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task(ReadOnly):
    """The task of a plan. Checked once, by :meth:`of`; arrays are read-only.

    Attributes:
        names: The k joints; ``("",)`` for one that has no name.
        models: The models that each joint may have, the nominal one first.
        desired: Desired angles [rad], shape (n, k); for a foot the angles that bring it nearest.
        goal: Whether the error of each joint's angles counts, or of the foot's position.
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
        load: Torques at each sample [N m], shape (n, k), 0 for joints that feel none; None where no
            joint feels one.
        load_of_pose: Whether ``load`` is the load at the predicted angles.
        disturbance: Measured minus modelled angles in executed cycles [rad], (n, k), or None.
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
    weights: Array = field(default_factory=partial(np.ones, 3))
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
        limits: JointLimits | None = None,
        max_step: npt.ArrayLike | Mapping[str, float] | None = None,
        start: npt.ArrayLike | Mapping[str, float] | None = None,
        smoothness: float | None = None,
        robust: Robust | None = None,
        tolerance: float | None = None,
        load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None = None,
        disturbance: npt.ArrayLike | None = None,
    ) -> Task:
        """The task of arguments as :func:`planner.plan`, or with a leg :func:`planner.invert_foot`.

        Without a leg ``desired`` are angles (n, k) [rad], with one positions (n, 3) [m].
        """
        check_choice("norm", norm, NORMS)
        cyclic = as_flag("cyclic", cyclic)
        if leg is not None:
            names = checked_leg(leg).joint_names
        elif isinstance(names, tuple) and names == ("",):
            angles = as_trajectory(desired, name="desired", minimum=3)[:, np.newaxis]
            check_radians(angles[:, 0], name="desired")
        else:
            angles = as_rows(desired, name="desired")
            if len(angles) < 3:
                raise InvalidTrajectory(f"desired: got {len(angles)} samples, expected at least 3")
            names = joint_names(names, models, angles.shape[1])
        several = models_of_joints(models, names, robust, independent=leg is not None)
        of_foot: dict[str, Any] = {}
        if leg is not None:
            if len({len(each) for each in several} - {1}) > 1:
                raise InvalidInput(
                    f"models: got {', '.join(str(len(each)) for each in several)} of the joints "
                    f"{', '.join(names)}, expected as many of each, taken in their order, or one "
                    "where a joint has but one"
                )
            limits = leg.limits if limits is None else limits
            of_foot = {"goal": "foot", "leg": leg, "weights": _finite(weights)}
            importance = of_foot["weights"]
            if importance.shape != (3,) or np.any(importance < 0.0) or not np.any(importance):
                raise InvalidInput(
                    f"weights: got {shown(weights)}, expected three numbers, 0 or more and not all "
                    "0"
                )
            solution = leg.inverse(desired, unreachable=unreachable)
            angles, of_foot["reachable"] = solution.angles, solution.reachable
            of_foot["foot"] = np.array(desired, dtype=np.float64)
            if len(angles) < 3:
                raise InvalidInput(f"foot: got {len(angles)} points, expected at least 3")
        lower, upper = limits_of_each(limits, names)
        largest_rise = SMOOTHNESS if smoothness is None else as_number(smoothness)
        if not 0.0 <= largest_rise <= 1e6:  # requests are constant long before
            raise InvalidInput(
                f"smoothness: got {shown(smoothness)}, expected the share of the error that may be "
                "added, from 0 to 1e+06; 0.005 is half a per cent"
            )
        starts = angles[0].copy()  # by default joints rest where their paths begin
        expected = "a number [rad] or one for each joint"
        for j, rest in enumerate(of_each("start", start, names, expected=expected)):
            if rest is None:
                continue
            with about(names[j]):
                starts[j] = checked_start(rest, float(angles[0, j]), cyclic=cyclic)
        added = None if disturbance is None else _finite(disturbance)
        if added is not None and added.shape != angles.shape:
            raise InvalidInput(
                f"disturbance: got {shown(disturbance)}, expected finite angles [rad] of shape "
                f"{angles.shape}, a column for each joint"
            )
        task = cls(
            names=names,
            models=tuple(several),
            desired=angles,
            cyclic=cyclic,
            norm=norm,
            lower=lower,
            upper=upper,
            max_step=steps_of_each(max_step, names),
            smoothness=largest_rise,
            start=None if cyclic else starts,
            robust=(robust or "mean") if max(map(len, several)) > 1 else None,
            tolerance=None
            if tolerance is None
            else as_positive("tolerance", tolerance, "a finite number above 0"),
            disturbance=added,
            **of_foot,
        )
        return task.under(load)

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for each in vars(self).values():
            if isinstance(each, np.ndarray):
                freeze(each)

    @cached_property
    def nominal(self) -> tuple[JointModel, ...]:
        """The nominal model of each joint."""
        return tuple(map(itemgetter(0), self.models))

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.models[0][0].period

    @cached_property
    def scenarios(self) -> tuple[tuple[JointModel, ...], ...]:
        """Models of all joints together, nominal ones first; the last of fewer ones fills up."""
        if (most := max(map(len, self.models))) == 1:
            return (self.nominal,)
        each = (models + models[-1:] * (most - len(models)) for models in self.models)
        return tuple(zip(*each, strict=True))

    @cached_property
    def loads(self) -> tuple[Array | None, ...]:
        """Torque on each joint [N m], (n,), or None where none of its models feels it."""
        if self.load is None:
            return (None,) * len(self.names)
        columns = columns_of(self.load)
        freeze(*columns)
        return tuple(
            column if any(model.feels_load for model in models) else None
            for models, column in zip(self.models, columns, strict=True)
        )

    def loads_on(self, models: Sequence[JointModel]) -> Array:
        """The loads on one model of each joint [N m], (k, n); 0 where the model feels none."""
        loads = np.zeros_like(self.desired.T, order="C")
        for j, model in enumerate(models):
            if self.load is not None and model.feels_load:
                loads[j] = self.load[:, j]
        return loads

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
        """Desired positions of the foot [m], (n, 3): for a path of joints, at its angles."""
        return self.foot_at(self.desired) if self.foot is None else self.foot

    def foot_at(self, angles: Array) -> Array:
        """Position of the leg's foot at angles (n, k) [m], (n, 3)."""
        if self.leg is None:  # so that ``hasattr(plan, "foot")`` is False
            raise AttributeError("a plan without a leg has no foot; see planner.invert_foot")
        return self.leg.foot_positions(angles)

    @property
    def axis_scales(self) -> Array:
        """Factors of a foot's three axes, the heaviest 1: the root of each weight, shape (3,)."""
        scales: Array = np.sqrt(self.weights / np.max(self.weights))
        return scales

    def foot_jacobians(self, angles: Array) -> Array:
        """Derivatives of the foot's position, its axes scaled, by angles (n, k) [m], (n, 3, k)."""
        assert self.leg is not None, "a foot belongs to a leg"
        return self.leg.jacobians(angles) * self.axis_scales[:, np.newaxis]

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
        """Errors of angles (n, k) in the norm that counts: of each joint [rad], of the foot [m]."""
        if self.goal == "foot":
            away = self.foot_at(angles) - self.desired_foot
            away = np.linalg.norm(away * self.axis_scales, axis=1)
            return np.array([error_norm(away, self.norm)])
        errors = columns_of(angles - self.desired)
        return np.array([error_norm(each, self.norm) for each in errors])

    def error_made_by(self, deviations: Array, angles: Array) -> float:
        """Error by rms deviations [rad], (k,), from angles (n, k): of a joint [rad], a foot [m]."""
        if self.goal == "angles":
            return float(deviations[0])
        squares = (self.foot_jacobians(angles) * deviations) ** 2
        return float(np.sqrt(np.mean(np.sum(squares, axis=(1, 2)))))

    @property
    def unlimited(self) -> Self:
        """The same task without limits on the requests."""
        any_request = np.full(len(self.names), math.inf)
        return replace(self, lower=-any_request, upper=any_request, max_step=any_request)

    @property
    def unsmoothed(self) -> Task:
        """The same task without smoothing."""
        return self if self.smoothness == 0.0 else replace(self, smoothness=0.0)

    def keeps(self, requests: Array, *, rounding: float) -> bool:
        """Whether requests [rad], (n, k), keep the limits and the largest step, up to rounding."""
        changes = np.abs(steps(requests, cyclic=self.cyclic))
        within = np.all((requests >= self.lower - rounding) & (requests <= self.upper + rounding))
        return bool(within and np.all(changes <= self.max_step + rounding))

    def with_models(self, models: Sequence[JointModel]) -> Task:
        """The same task for one model of each joint."""
        return replace(self, models=tuple((each,) for each in models), robust=None)

    def joint(self, j: int) -> Task:
        """The task of one of the joints, which are planned one by one."""
        if len(self.names) == 1 and self.goal == "angles" and self.leg is None:
            return self
        own: dict[str, Any] = {name: getattr(self, name)[j : j + 1] for name in _BY_JOINT}
        for name in ("desired", "load", "disturbance"):
            rows = getattr(self, name)
            own[name] = None if rows is None else np.ascontiguousarray(rows[:, j : j + 1])
        own["start"] = None if self.start is None else self.start[j : j + 1]
        own["robust"] = self.robust if len(self.models[j]) > 1 else None
        return replace(self, goal="angles", leg=None, foot=None, reachable=None, **own)

    @classmethod
    def joined(cls, tasks: Sequence[Task]) -> Task:
        """The task of several joints that are planned one by one, all with the same options."""
        first = tasks[0]
        own: dict[str, Any] = {
            name: sum((getattr(each, name) for each in tasks), ()) for name in _BY_JOINT[:2]
        }
        for name in (*_BY_JOINT[2:], "start", "desired", "disturbance"):
            if getattr(first, name) is not None:
                own[name] = np.concatenate([getattr(each, name) for each in tasks], axis=-1)
        own["load"] = load_columns([each.loads[0] for each in tasks], len(first.desired))
        own["robust"] = next((each.robust for each in tasks if each.robust), None)
        own["load_of_pose"] = any(each.load_of_pose for each in tasks)
        return replace(first, **own)

    def under(
        self, load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None, *, of_pose: bool = False
    ) -> Task:
        """The same task under another load [N m], also of a pose, checked as in :meth:`of`."""
        task, columns = self, None
        if load is not None:
            samples, joints = shape = self.desired.shape
            expected = (
                f"torques [N m] of shape {shape} or ({joints},), one for each joint, or a number"
            )
            values = of_each("load", load, self.names, expected=expected, shape=shape)
            loads = list[Array | None]([None] * joints)
            for j, name in enumerate(self.names):
                with about(name if self.goal == "angles" else ""):
                    for model in self.models[j]:
                        felt = checked_load(values[j], model, samples)
                        loads[j] = felt if loads[j] is None else loads[j]
            columns = load_columns(loads, samples)
        if columns is not None or self.load is not None:
            task = replace(self, load=columns, load_of_pose=of_pose and columns is not None)
        if task.goal == "angles":
            task._check_within()
        elif not task.cyclic:
            ends = (
                of_joints(JointModel.rest, task.nominal, end, task.loads)
                for end in (task.lower, task.upper)
            )
            return replace(task, start=np.clip(task.desired, *ends)[0])
        return task

    def _check_within(self) -> None:
        """Raise Infeasible where no request can hold the start or a desired angle of a joint.

        A negligible sag is ignored. Dry friction holds the joint within the dead band.
        """
        for j in np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper)):
            lower, upper, model = self.lower[j], self.upper[j], self.nominal[j]
            torques, angles = self.loads_on(self.nominal)[j], self.desired[:, j]
            count = len(angles)
            if self.start is not None:
                angles, torques = np.append(angles, self.start[j]), np.append(torques, torques[0])
            sags, band = model.sag(torques) + model.pose_sag(angles), model.steady.dead_band
            beyond = excess(angles - sags, lower, upper) - band
            negligible = np.minimum(np.abs(sags), NEGLIGIBLE_SAG)
            worst = int(np.argmax(beyond - negligible))
            if beyond[worst] <= ON_THE_LIMIT + negligible[worst]:
                continue
            ends = np.array([lower - band, upper + band])
            least, most = model.rest(ends, torques[worst]).tolist()
            what, remedy = "start: it", "choose a start there"
            if worst < count:
                what, remedy = f"desired: sample {worst}", "clip the trajectory"
            with about(self.names[j]):
                raise Infeasible(
                    f"{what} is {angle_text(angles[worst])}, "
                    f"{angle_text(beyond[worst])} beyond the angles "
                    f"{angle_text(least, most)} where the limits on the requests let "
                    f"the joint rest; {remedy}, or widen the limits"
                )


def columns_of(rows: Array) -> list[Array]:
    """The columns of an array (n, k), each of its own, (n,)."""
    return [np.ascontiguousarray(column) for column in rows.T]


_BY_JOINT = ("names", "models", "lower", "upper", "max_step")


def checked_leg(leg: object) -> Leg:
    """The leg, or InvalidInput where it is no Leg."""
    from kinematics.leg import Leg  # with Pinocchio

    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {shown(leg)}, expected a kinematics.Leg")
    return leg


def models_of_joints(
    # see :data:`Models`. For one joint a flat sequence of more than one has its models.
    models: Models,
    names: Sequence[str],
    robust: Robust | None = None,  # whether candidates are drawn for single models
    *,
    independent: bool = False,  # whether those of different models are drawn independently
) -> list[tuple[JointModel, ...]]:
    """The candidate models of each joint, checked, the nominal one first.

    A sequence lists all candidates; those of an identification, and with ``robust`` of a single
    model, are drawn from its intervals.
    """
    if robust is not None:
        check_choice("robust", robust, get_args(Robust))
    # An identification exists only where its module is loaded, which takes SciPy.
    module = sys.modules.get("planner.identification.result")
    identification: Any = getattr(module, "Identification", ())
    entries: list[Any]
    if isinstance(models, Mapping):
        if missing := [name for name in names if name not in models and "" not in models]:
            raise InvalidInput(
                f"models: none for joint '{missing[0]}'; got "
                f"{', '.join(map(str, models)) or 'none'}"
            )
        entries = [models[name] if name in models else models[""] for name in names]
    elif isinstance(models, (JointModel, identification)):
        entries = [models] * len(names)
    else:
        try:
            entries = list(models)  # type: ignore[arg-type]  # other types are rejected below
        except TypeError:
            entries = []
        if len(names) == 1 and len(entries) > 1:
            entries = [entries]
        fit = names == ("",) or all(
            isinstance(each, (JointModel, Sequence, identification)) and not isinstance(each, str)
            for each in entries
        )
        if len(entries) != len(names) or not fit:
            raise InvalidInput(
                f"models: got {len(entries)} of them for {len(names)} joints ({', '.join(names)}), "
                "expected one JointModel, or one for each"
            )
    several, sources = list[tuple[JointModel, ...]](), list[Any]()  # sources of draws
    for entry in entries:
        identified = isinstance(entry, identification)
        model = entry.model if identified else entry
        sources.append((model, getattr(model, "evidence", None)))
        if isinstance(model, Sequence) and not isinstance(model, str):
            several.append(tuple(map(checked_model, model)))
            own = [each.period for each in several[-1]]
            if not own or len(set(own)) > 1:
                raise InvalidInput(
                    f"model: got {len(own)} models with periods of "
                    f"{', '.join(f'{period:g}' for period in own) or 'nothing'} s, expected at "
                    "least one, all of one joint with one request period"
                )
        elif robust is None and not identified:
            several.append((checked_model(model),))
        else:
            from planner.planning.candidate_models import drawn_models

            seed = sources.index(sources[-1]) if independent else 0
            several.append(drawn_models(checked_model(model), seed=seed))
    if robust is not None and all(len(each) == 1 for each in several):
        raise InvalidInput(
            f"robust: got {robust!r} for a sequence of one model, which the joint has in any case; "
            "expected several models, or the model by itself, from whose intervals others are drawn"
        )
    if len(periods := sorted(set(map(attrgetter("period"), map(itemgetter(0), several))))) > 1:
        raise InvalidInput(
            f"models: their periods are {', '.join(f'{p:g}' for p in periods)} s, expected one "
            "period: joints that are requested at different rates are not planned together"
        )
    return several


def joint_names(names: Sequence[str] | None, models: object, count: int) -> tuple[str, ...]:
    """The names of joints, all different; by default the keys of models, or joint_1 and so on."""
    if names is not None:
        user_names = tuple(names) if isinstance(names, list | tuple) else ()
        are_texts = all(isinstance(name, str) for name in user_names)
        if not are_texts or len(user_names) != count or len(set(user_names)) != count:
            raise InvalidInput(
                f"names: got {shown(names)}, expected {count} different names, one for each of the "
                "columns of desired"
            )
        return user_names
    if isinstance(models, Mapping) and (named := tuple(name for name in models if name)):
        if len(named) != count:
            raise InvalidInput(
                f"desired: got {count} columns for the models of {', '.join(named)}; name the "
                "joints of the columns with names="
            )
        return named
    return tuple(f"joint_{j + 1}" for j in range(count))


def of_each(
    what: str,
    value: Any,
    names: Sequence[str],
    *,
    expected: str,
    shape: tuple[int, ...] | None = None,
) -> list[Any]:
    """The values of a dict by joint, of one number, or of one for each joint; None where missing.

    Where there may be one at every sample, ``shape`` is (n, k). A single nameless joint gets its
    value as it is.
    """
    if value is None:
        return [None] * len(names)
    if isinstance(value, Mapping):
        if strange := [name for name in value if name not in names]:
            hint = nearest(str(strange[0]), names)
            raise InvalidInput(
                f"{what}: no joint {shown(strange[0])}{hint}; joints: {', '.join(names)}"
            )
        return [value.get(name) for name in names]
    if names == ("",):
        return [value]
    try:
        values = as_reals(value)
        if shape is not None and values.ndim == 1 and len(names) == 1:
            values = values[:, np.newaxis]
        each = np.broadcast_to(values, shape or (len(names),)).T
        return each.tolist() if shape is None else list(each)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{what}: got {shown(value)}, expected {expected}") from error


def limits_in_shares(
    model: JointModel | None, values: Array, whole: float = 1.0
) -> tuple[float, float]:
    """Limits of a joint in shares: 0 to ``whole``, extended to the ``values`` and by the sag.

    The sag is the largest by its model: with it the joint reaches both ends of its range.
    """
    sag = 0.0 if model is None else abs(float(model.sag())) + model.most_pose_sag
    return min(0.0, float(np.min(values))) - sag, max(whole, float(np.max(values))) + sag


def limits_of_each(limits: JointLimits | None, names: Sequence[str]) -> tuple[Array, Array]:
    """Smallest and largest request of every joint [rad], each of shape (k,), checked."""
    pairs: Iterable[Any]
    if limits is None or isinstance(limits, Mapping) or names == ("",):
        pairs = of_each("limits", limits, names, expected="")
    else:
        try:
            each = (np.broadcast_to(as_reals(limit), len(names)).tolist() for limit in limits)
            lowest, highest = each
        except (TypeError, ValueError) as error:
            raise InvalidInput(
                f"limits: got {shown(limits)}, expected (lower, upper) [rad], each a number or one "
                "for each joint"
            ) from error
        pairs = zip(lowest, highest, strict=True)
    ends = np.full((2, len(names)), [[-math.inf], [math.inf]])
    for j, (name, pair) in enumerate(zip(names, pairs, strict=True)):
        if pair is None:
            continue
        with about(name):
            try:
                lower, upper = (as_number(limit, infinite=True) for limit in pair)
            except (TypeError, ValueError):
                lower = upper = math.nan
            if math.isnan(lower) or math.isnan(upper):
                raise InvalidInput(
                    f"limits: got {shown(pair)}, expected (lower, upper) [rad]; use -inf or inf "
                    "for no limit"
                )
            if lower > upper:
                raise Infeasible(
                    f"limits: the lower one, {angle_text(lower)}, is above the upper one, "
                    f"{angle_text(upper)}; swap them, or check their units"
                )
            ends[:, j] = lower, upper
    return ends[0], ends[1]


def steps_of_each(
    max_step: npt.ArrayLike | Mapping[str, float] | None, names: Sequence[str]
) -> Array:
    """Largest change of every joint's request [rad], shape (k,), checked; inf for any."""
    expected = "an angle above 0 [rad], or one for each joint"
    largest = np.full(len(names), math.inf)
    for j, step in enumerate(of_each("max_step", max_step, names, expected=expected)):
        if step is None:
            continue
        with about(names[j]):
            largest[j] = as_number(step, infinite=True)
            if not largest[j] > 0.0:
                raise InvalidInput(
                    f"max_step: got {shown(step)}, expected an angle above 0 [rad], the largest "
                    "change from one request to the next; leave it out for no limit"
                )
    return largest


def _finite(values: npt.ArrayLike) -> Array:
    """The numbers as a new array; an empty one where one of them is not finite or no number."""
    try:
        numbers = as_reals(values)
    except (TypeError, ValueError):
        return np.empty(0)
    return numbers if np.all(np.isfinite(numbers)) else np.empty(0)
