"""Plans for several joints: the inversion of each, joined, and written for robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, PlannerError
from planner.files.paths import write_joint_path
from planner.model.joint import JointModel
from planner.model.load import checked_load, felt
from planner.planning.arguments import model_of_each, range_of_each
from planner.planning.closed_form import invert_closed_form
from planner.planning.load_of_pose import LoadOfPose, settled
from planner.planning.optimal import invert_optimal
from planner.planning.result import Inversion, Method
from planner.planning.robust import ModelOrModels, Robust, models_of_joints
from planner.robot.schedule import as_rows
from planner.trajectory import Array
from planner.validation import as_reals, is_one_of, shown

Value = TypeVar("Value")

Models = ModelOrModels | Sequence[ModelOrModels] | Mapping[str, ModelOrModels]
"""One model for all joints, one for each, or models by joint; "" is that of every other joint.

In the place of a model there may be several that the joint may have, or an identification.
"""

Limits = tuple[npt.ArrayLike, npt.ArrayLike] | Mapping[str, tuple[float, float]]
"""Smallest and largest request, as numbers or one of each joint, or pairs by joint."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Requests for several joints, each planned by itself.

    Attributes:
        names: The joints.
        inversions: The plan of each joint, with its error, its lower bound and its gap.
    """

    names: tuple[str, ...]
    inversions: tuple[Inversion, ...]

    @property
    def models(self) -> tuple[JointModel, ...]:
        """The model of each joint."""
        return tuple(each.model for each in self.inversions)

    @property
    def period(self) -> float:
        """Time between requests [s]."""
        return self.inversions[0].model.period

    @property
    def cyclic(self) -> bool:
        """Whether the requests repeat for ever."""
        return self.inversions[0].cyclic

    @cached_property
    def desired(self) -> Array:
        """Desired angles [rad], shape (n, k)."""
        return _columns([each.desired for each in self.inversions])

    @cached_property
    def requests(self) -> Array:
        """What to send to the joints [rad], shape (n, k)."""
        return _columns([each.requests for each in self.inversions])

    @cached_property
    def predicted(self) -> Array:
        """Angles of the exact models under the requests [rad], shape (n, k)."""
        return _columns([each.predicted for each in self.inversions])

    @property
    def rms(self) -> Array:
        """Root mean square of the errors of each joint [rad], shape (k,)."""
        return np.array([each.rms for each in self.inversions])

    @property
    def expected_rms(self) -> Array:
        """Errors to expect on the robot [rad], shape (k,); NaN where a model was not tested.

        The plan's own error and that of the model, by what it was tested on. A joint whose
        ``inversions[j].expected.untested`` is not empty moves in another way than that.
        """
        return np.array([each.expected.error for each in self.inversions])

    @property
    def stopped(self) -> dict[str, str]:
        """Why learning from executed cycles has ended, by joint: those for which it has."""
        pairs = zip(self.names, self.inversions, strict=True)
        return {name: each.stopped for name, each in pairs if each.stopped}

    def under(self, torques: Array) -> Self:
        """The same requests under the load of a pose [N m], shape (n, k)."""
        pairs = zip(self.inversions, torques.T, strict=True)
        return replace(self, inversions=tuple(_under(each, column) for each, column in pairs))

    def save(self, path: Path | str) -> None:
        """Write the requests as CSV: ``t_s`` [s] and one ``<joint>_deg`` column per joint.

        ``request-planner export``, ``simulate`` and ``view`` read this file.

        Args:
            path: The file, or ``-`` for standard output.

        Raises:
            InvalidFile: The file cannot be written.
        """
        write_joint_path(path, self.names, self.requests, period=self.period)


def plan(
    models: Models,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: Limits | None = None,
    names: Sequence[str] | None = None,
    start: npt.ArrayLike | Mapping[str, float] | None = None,
    load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | LoadOfPose | None = None,
    max_step: npt.ArrayLike | Mapping[str, float] | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
    method: Method = "optimal",
    progress: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Plan:
    """Requests that make several joints follow desired angles, each joint planned by itself.

    Where the position of a foot counts and not the angles, :func:`planner.invert_foot` plans for
    all joints of a leg at once.

    Args:
        models: One model for all joints, one for each, or a dict by joint, as
            :func:`planner.read_models` returns it; "" in it is the model of every other joint. In
            the place of a model there may be a sequence of models that the joint may have, the
            nominal one first, or the answer of :func:`planner.identify`: its requests are then good
            for all of them, see :func:`planner.invert_optimal`. A joint with a sequence of one has
            that model in any case. For one joint a flat sequence of more than one is such a
            sequence. Only with method "optimal".
        desired: Desired angles [rad], shape (n, k), or (n,) for one joint; a row every period of
            the models, which must have the same one.
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest request [rad], each a number or an array of shape (k,); or a
            dict of such pairs by joint. Only with method "optimal".
        names: The joints, for dicts and files; by default the keys of ``models``, where it is a
            dict of k joints, else joint_1 to joint_k.
        start: From rest: where the joints rest before [rad], a number, shape (k,), or a dict by
            joint; by default at the first row. Only with method "optimal".
        load: Torque on each joint in the direction of positive angles [N m]: shape (n, k), or (k,)
            or a number where it does not change, or a dict by joint of numbers or shape (n,). Or a
            function of the joints' angles [rad], shape (n, k), that returns the torques in that
            pose, such as :meth:`kinematics.Leg.load_torques`: the plan is then repeated until the
            load is that of the predicted angles, and has no lower bound.
        max_step: Largest change from one request to the next [rad], a number, shape (k,), or a dict
            by joint: see :func:`planner.invert_optimal`. Only with method "optimal".
        smoothness: Relative rise of the error that a robot would show which smoother requests may
            cost, as there; by default 0.005. Only with method "optimal".
        robust: "mean" or "worst": which error over the models that each joint may have counts, as
            there; a model that is in no such sequence needs intervals, from which others are
            drawn. Only with method "optimal".
        method: "optimal" for :func:`planner.invert_optimal`, "closed_form" for
            :func:`planner.invert_closed_form`.
        progress: Called with the name of each joint before it is planned.
        **options: What the function of the method takes beyond these: ``norm``, ``tolerance``
            and ``solver`` of the one, ``segments``, ``rule`` and ``refine`` of the other.

    Returns:
        The plan.

    Raises:
        InvalidInput: The arguments do not fit together; an error about one joint has its name as a
            note.
        InvalidTrajectory: ``desired`` is not a finite array of shape (n, k) with n >= 3.
        Infeasible: The limits exclude each other or a desired angle.
        SolverFailed: No requests were found that lead to a steady cycle, or the load of the pose
            does not settle.

    Example:
        >>> import numpy as np
        >>> phase = 2 * np.pi * np.arange(100) / 100
        >>> desired = np.column_stack([0.3 * np.sin(phase), 0.2 * np.cos(phase)])
        >>> made = plan(JointModel.ers210a(), desired, names=["hip", "knee"], limits=(-0.6, 0.6))
        >>> made.requests.shape
        (100, 2)
        >>> bool(np.max(np.degrees(made.rms)) < 0.01)
        True
    """
    if not is_one_of(method, get_args(Method)):
        raise InvalidInput(f"method: got {shown(method)}, expected 'optimal' or 'closed_form'")
    rows = as_rows(desired, name="desired")
    count = rows.shape[1]
    names = _names(names, models, count)
    several = _of_joints(models, names, robust)
    first = [each[0] for each in several]
    each = model_of_each(first, count, given_as="models", joints=_JOINTS)
    if callable(load):
        again = partial(
            plan,
            dict(zip(names, several, strict=True)),
            rows,
            cyclic=cyclic,
            limits=limits,
            names=names,
            start=start,
            max_step=max_step,
            smoothness=smoothness,
            robust=robust,
            method=method,
            progress=progress,
            **options,
        )
        return settled(lambda torques: again(load=torques), load, rows)
    ranges, starts = _ranges(limits, names), _of_each("start", start, names)
    loads, steps = _loads(load, rows.shape, names), _of_each("max_step", max_step, names)
    only = {"limits": limits, "start": start, "max_step": max_step}
    only |= {"smoothness": smoothness, "robust": robust}
    if method == "closed_form" and (strange := [k for k, v in only.items() if v is not None]):
        raise InvalidInput(
            f"{', '.join(strange)}: without effect with method 'closed_form'; leave it out"
        )
    if method == "closed_form" and any(len(models_of_joint) > 1 for models_of_joint in several):
        raise InvalidInput("models: got several of a joint, which need method 'optimal'")
    inversions = []
    for j, name in enumerate(names):
        progress(name)
        try:
            if method == "closed_form":
                made = invert_closed_form(
                    each[j], rows[:, j], cyclic=cyclic, load=loads.get(name), **options
                )
            else:
                made = invert_optimal(
                    several[j],
                    rows[:, j],
                    cyclic=cyclic,
                    limits=ranges.get(name),
                    start=starts.get(name),
                    load=loads.get(name),
                    max_step=steps.get(name),
                    smoothness=smoothness,
                    robust=robust if len(several[j]) > 1 else None,
                    **options,
                )
        except PlannerError as error:
            error.add_note(name)
            raise
        inversions.append(made)
    return Plan(names=names, inversions=tuple(inversions))


_JOINTS = "columns of desired"


def _under(plan: Inversion, torques: Array) -> Inversion:
    """The same requests under the load of a pose [N m], shape (n,)."""
    load = felt([checked_load(torques, each, len(torques)) for each in plan.models or [plan.model]])
    return replace(
        plan,
        load=load,
        load_of_pose=load is not None,
        nominal=plan.nominal and _under(plan.nominal, torques),
    )


def _columns(arrays: Sequence[Array]) -> Array:
    columns = np.column_stack(arrays)
    columns.setflags(write=False)
    return columns


def _names(names: Sequence[str] | None, models: object, count: int) -> tuple[str, ...]:
    """The names of the joints, as many as there are columns, all different."""
    if names is not None:
        given = tuple(names) if isinstance(names, list | tuple) else ()
        are_texts = all(isinstance(name, str) for name in given)
        if not are_texts or len(given) != count or len(set(given)) != count:
            raise InvalidInput(
                f"names: got {shown(names)}, expected {count} different names, one for each of the "
                f"{_JOINTS}"
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


def _of_joints(
    models: Models, names: Sequence[str], robust: Robust | None
) -> list[tuple[JointModel, ...]]:
    """The models that each joint may have, in the order of the joints."""
    if isinstance(models, Mapping):
        if missing := [name for name in names if name not in models and "" not in models]:
            raise InvalidInput(
                f"models: none for joint '{missing[0]}'; got "
                f"{', '.join(map(str, models)) or 'none'}"
            )
        models = [models[name] if name in models else models[""] for name in names]
    return models_of_joints(models, len(names), robust, joints=_JOINTS)


def _ranges(limits: Limits | None, names: Sequence[str]) -> Mapping[str, tuple[float, float]]:
    """Smallest and largest request by joint [rad], of those that have limits."""
    if limits is None:
        return {}
    if isinstance(limits, Mapping):
        return _known("limits", limits, names)
    lower, upper = range_of_each(limits, len(names), joints=_JOINTS)
    return dict(zip(names, zip(lower.tolist(), upper.tolist(), strict=True), strict=True))


def _of_each(
    what: str, given: npt.ArrayLike | Mapping[str, float] | None, names: Sequence[str]
) -> Mapping[str, float]:
    """An angle of each joint, by joint [rad], of those that have one."""
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return _known(what, given, names)
    try:
        angles = np.broadcast_to(as_reals(given), len(names))
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"{what}: got {shown(given)}, expected a number [rad] or one for each of the {_JOINTS}"
        ) from error
    return dict(zip(names, angles.tolist(), strict=True))


def _loads(
    load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None,
    shape: tuple[int, ...],
    names: Sequence[str],
) -> Mapping[str, npt.ArrayLike]:
    """Torque by joint [N m], of those that have one, each a number or of shape (n,)."""
    if load is None:
        return {}
    if isinstance(load, Mapping):
        return _known("load", load, names)
    try:
        torques = as_reals(load)
        if torques.ndim == 1 and shape[1] == 1:
            torques = torques[:, np.newaxis]
        columns = np.broadcast_to(torques, shape).T
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: got {shown(load)}, expected torques [N m] of shape {shape} or ({shape[1]},), "
            "or a number"
        ) from error
    return dict(zip(names, columns, strict=True))


def _known(what: str, values: Mapping[str, Value], names: Sequence[str]) -> Mapping[str, Value]:
    """Values by joint, all of joints that are planned."""
    if strange := [name for name in values if name not in names]:
        raise InvalidInput(f"{what}: no joint {shown(strange[0])}; joints: {', '.join(names)}")
    return values
