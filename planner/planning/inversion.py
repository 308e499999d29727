"""The public ways to plan: arguments become a task, the task a plan.

Under a load that depends on the pose a task is planned again until the load settles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, as_reals, check_choice
from planner.exceptions import InvalidInput, SolverFailed, angle_text
from planner.planning.closed_form import closed_forms
from planner.planning.line_inverse import Rule
from planner.planning.plan import FootInversion, Inversion, Method, Plan
from planner.planning.task import (
    SOLVERS,
    JointLimits,
    LoadOfPose,
    ModelOrModels,
    Models,
    Norm,
    Robust,
    Solver,
    Task,
    checked_leg,
)
from planner.planning.time_shift import shifted

if TYPE_CHECKING:
    from kinematics.leg import Leg


def invert_optimal(
    model: ModelOrModels,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[float, float] | None = None,
    norm: Norm = "rms",
    start: float | None = None,
    tolerance: float | None = None,
    solver: Solver = "gauss-newton",
    load: npt.ArrayLike | None = None,
    max_step: float | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
) -> Inversion:
    """Requests of least tracking error, by a local search over requests and angles.

    Angles and requests are the unknowns. Damped Gauss-Newton steps, each at a cost in proportion to
    the length, lower the error on a saturation whose rounded corners are sharpened stage by stage,
    from the best trajectory within ±v_max and its closed form onwards. The exact model, simulated,
    judges the last stages, and the best requests are kept, so that before smoothing they are never
    worse than that closed form. Where next to no sample can be reached below the top speeds, the
    search also starts from the answers of :func:`planner.invert_closed_form`.

    At the end requests are smoothed: their sum of squared second differences is lowered as far as
    ``smoothness`` allows (``docs/math.md``, section 6), and rest where the path does if they would
    shake there. With 0 the error was at most that of :func:`planner.invert_closed_form` for 695 of
    698 random joints, and within 0.6 % for all; joints with dry friction take the better of the
    two. By default it may exceed that by the allowed rise, in two of the 698 by 0.9 %.

    From rest the joint rests at ``start`` until the plan begins: the first request holds it there.

    Args:
        model: The joint. Or a sequence of candidate models, nominal first, or the answer of
            :func:`planner.identify`, from whose intervals eight are drawn beside its own, always
            the same ones: the requests are then good for all of them. A sequence of one is one
            model, without draws.
        desired: Desired angles [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the trajectory repeats for ever.
        limits: Smallest and largest request allowed [rad]; -inf and inf where there is none.
        norm: "rms" to minimise the root mean square of the errors, "max" the largest one.
        start: From rest: where the joint rests before [rad]; by default at the first desired angle.
        tolerance: Error that the plan should keep [rad]: see ``within_tolerance`` of the plan.
        solver: "gauss-newton", the search above; "ipopt" for the same problem as a nonlinear
            programme, through CasADi (``docs/math.md``, section 6), judged as exactly.
        load: Torque on the joint in the direction of positive angles [N m], a number or shape (n,);
            at the samples; see :func:`planner.simulate`.
        max_step: Largest change from one request to the next [rad], in a cycle also from the last
            to the first, from rest also from the request that holds the start. Each is kept
            exactly.
        smoothness: Relative rise of the error that smoother requests may cost; by default 0.005, 0
            for none. It is the error that a robot would show, to which the error of the model adds
            in quadrature: that known of an identified one, and at least an encoder's step of 0.088
            degrees. With dry friction, and where requests would change direction more than eight
            times a second more often than the path, an error up to that step is always allowed.
        robust: "mean" to minimise the root mean square of the errors of several models, the default
            for them, "worst" for the largest of them. For a single model eight others are drawn
            from the intervals in its file.

    Returns:
        The plan, with a lower bound on the error of any plan, and the gap. The bound ignores
        ``limits`` and ``max_step``; it stays valid, and part of the gap may be due to them.
        Error, bound and gap are those of the nominal model, ``errors_of_models`` has all errors,
        ``nominal`` the plan for the nominal model alone.

    Raises:
        InvalidTrajectory: ``desired`` is not a finite array of shape (n,) with n >= 3.
        InvalidInput: The norm or the solver is unknown, the limits are not two numbers, a cycle has
            a ``start``, the load does not fit the samples or the joint, ``max_step`` is not above
            0, ``smoothness`` is below 0, or ``robust`` has a model without intervals or a sequence
            of one.
        Infeasible: The limits exclude each other, the start or a desired angle.
        SolverFailed: No requests were found that lead to a steady cycle, or IPOPT stopped without
            an answer.

    Example:
        >>> import numpy as np
        >>> from planner import JointModel
        >>> desired = 1.2 * np.sin(2 * np.pi * np.arange(88) / 88) ** 3  # [rad], every 8 ms
        >>> plan = invert_optimal(JointModel.ers210a(), desired, limits=(-1.5, 1.5))
        >>> f"{np.degrees(plan.rms):.1f} deg rms, {np.degrees(plan.lower_bound):.1f} at best"
        '10.4 deg rms, 10.2 at best'
    """
    task = Task.of(
        [model],
        desired,
        names=("",),
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        max_step=max_step,
        start=start,
        smoothness=smoothness,
        robust=robust,
        tolerance=tolerance,
        load=load,
    )
    return Inversion(planned(task, solver=solver))


def invert_foot(
    models: ModelOrModels | Sequence[ModelOrModels],
    leg: Leg,
    foot: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    norm: Norm = "rms",
    weights: npt.ArrayLike = (1.0, 1.0, 1.0),
    unreachable: Literal["nearest", "raise"] = "nearest",
    load: npt.ArrayLike | LoadOfPose | None = None,
    disturbance: npt.ArrayLike | None = None,
    max_step: npt.ArrayLike | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
) -> FootInversion:
    """Requests to all joints of a leg that keep its foot as close to a path as the search can.

    The error of one joint can compensate for that of another. The search is the one of
    :func:`planner.invert_optimal` with the joints stacked, from their own plans. From rest the
    joints rest at the first point, or nearest to it.

    Args:
        models: One joint model for all joints of the leg, or one for each. Instead of one model:
            several candidates or an identification, as there. The requests are good for the first,
            the second ... candidates of all joints together; candidates of different joints are
            drawn independently, joints with the same model have the same ones.
        leg: A leg of up to three joints.
        foot: Desired positions in the leg's base frame [m], shape (n, 3), one every model's period.
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest requests [rad], numbers or shape (k,); by default the leg's.
        norm: "rms" to minimise the root mean square distance, "max" the largest one.
        weights: How much each axis of the base frame counts, shape (3,).
        unreachable: Points out of reach are followed as closely as the leg can ("nearest"; the
            ``task.reachable`` of the plan says which), or are an error that lists them ("raise").
        load: Torque on the joints in the direction of positive angles [N m], a number, shape (k,)
            for each joint's, or (n, k), at the samples; see :func:`planner.simulate`. Or
            a function of the angles (n, k) [rad]: see :func:`planner.plan`.
        disturbance: Measured minus modelled angles [rad], shape (n, k), which the models' angles
            are taken to miss under other requests too: see :func:`planner.refine`.
        max_step: Largest change from one request of a joint to the next [rad], a number or shape
            (k,): see :func:`planner.invert_optimal`.
        smoothness: Relative rise of the foot's error that smoother requests may cost, as there: the
            error that a robot would show, from the joints' errors by the leg's Jacobian.
        robust: "mean" or "worst" of the foot's errors over several models, as there.

    Returns:
        The plan. Error, bound and gap are those of the nominal models; ``errors_of_models`` has all
        errors, ``nominal`` the plan for the nominal models alone.

    Raises:
        InvalidInput: The models do not fit the leg or each other, or the weights are not three
            numbers, 0 or more and not all 0, or load or disturbance do not fit the points, or
            ``max_step`` is not above 0 or ``smoothness`` is below 0, or ``robust`` has a model
            without intervals or only sequences of one.
        Infeasible: The limits exclude each other, or no joint moves the foot where it counts.
        InvalidTrajectory: The path is not an array (n, 3).
        UnsupportedLeg: The leg has no inverse.
        SolverFailed: No requests were found that lead to a steady cycle of every joint.

    Example:
        >>> from planner import JointModel, reference_walk
        >>> walk = reference_walk()
        >>> plan = invert_foot(JointModel.ers210a(), walk.leg, walk.desired_foot)
        >>> f"{100 * plan.rms:.2f} cm rms"
        '0.62 cm rms'
    """
    task = Task.of(
        models,
        foot,
        leg=checked_leg(leg),
        weights=weights,
        unreachable=unreachable,
        cyclic=cyclic,
        norm=norm,
        limits=limits,
        max_step=max_step,
        smoothness=smoothness,
        robust=robust,
        load=None if callable(load) else load,
        disturbance=disturbance,
    )
    return FootInversion(planned(task, load=load))


def plan(
    models: Models,
    desired: npt.ArrayLike,
    *,
    cyclic: bool = True,
    limits: JointLimits | None = None,
    names: Sequence[str] | None = None,
    start: npt.ArrayLike | Mapping[str, float] | None = None,
    load: npt.ArrayLike | Mapping[str, npt.ArrayLike] | LoadOfPose | None = None,
    max_step: npt.ArrayLike | Mapping[str, float] | None = None,
    smoothness: float | None = None,
    robust: Robust | None = None,
    method: Method = "optimal",
    progress: Callable[[str], None] = lambda _: None,
    norm: Norm | None = None,
    tolerance: float | None = None,
    solver: Solver | None = None,
    segments: int | None = None,
    rule: Rule | None = None,
    refine: bool | None = None,
) -> Plan:
    """Requests that make several joints follow desired angles, each joint planned by itself.

    If the position of a foot counts and not the angles, :func:`planner.invert_foot` plans all
    joints of a leg at once.

    Args:
        models: One model for all joints, one for each, or a dict by joint, as
            :func:`planner.read_models` returns it; its key "" holds the default model. Instead of
            one model, only with method "optimal": several candidates or an identification, see
            :func:`planner.invert_optimal`. For one joint a flat sequence of more than one is such a
            sequence.
        desired: Desired angles [rad], shape (n, k), or (n,) for one joint; a row every period of
            the models, which must have the same one.
        cyclic: Whether the path repeats for ever.
        limits: Smallest and largest request [rad], each a number or an array of shape (k,); or a
            dict of such pairs by joint. Not with method "closed_form".
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
        robust: "mean" or "worst" of the errors over several models, as there; only with method
            "optimal".
        method: "optimal" for :func:`planner.invert_optimal`, "closed_form" for
            :func:`planner.invert_closed_form`, "shift" for :func:`planner.invert_shift`.
        progress: Called with the name of each joint before it is planned.
        norm: "rms" or "max"; not with method "closed_form", as tolerance.
        tolerance: Error that each joint's plan should keep [rad].
        solver: "gauss-newton" or "ipopt", see :func:`planner.invert_optimal`; only with method
            "optimal".
        segments: Number of lines; only with method "closed_form", as rule and refine.
        rule: "paper" or "exact", see :func:`planner.invert_closed_form`.
        refine: Whether to move the knots, as there.

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
        >>> from planner import JointModel
        >>> phase = 2 * np.pi * np.arange(100) / 100
        >>> desired = np.column_stack([0.3 * np.sin(phase), 0.2 * np.cos(phase)])
        >>> result = plan(JointModel.ers210a(), desired, names=["hip", "knee"], limits=(-0.6, 0.6))
        >>> result.requests.shape
        (100, 2)
        >>> bool(np.max(np.degrees(result.rms)) < 0.01)
        True
    """
    check_choice("method", method, METHODS)
    goal: dict[str, Any] = {"limits": limits, "start": start, "norm": norm, "tolerance": tolerance}
    search: dict[str, Any] = {"max_step": max_step, "smoothness": smoothness}
    search |= {"robust": robust, "solver": solver}
    lines: dict[str, Any] = {"segments": segments, "rule": rule, "refine": refine}
    without_effect = {"closed_form": goal | search, "shift": search | lines}.get(method, lines)
    if strange := [name for name, value in without_effect.items() if value is not None]:
        raise InvalidInput(
            f"{', '.join(strange)}: without effect with method '{method}'; leave it out"
        )
    given = {name: each for name, each in (goal | search).items() if each is not None}
    solver = given.pop("solver", "gauss-newton")
    given["load"] = None if callable(load) else load
    task = Task.of(models, desired, names=names, cyclic=cyclic, **given)
    return planned(
        task,
        load=load,
        method=method,
        solver=solver,
        lines={name: value for name, value in lines.items() if value is not None},
        progress=progress,
    )


METHODS: tuple[Method, ...] = ("optimal", "closed_form", "shift")
"""How joints are planned."""


@np.errstate(under="ignore")  # too small to matter, whatever the caller's setting
def planned(
    task: Task,
    *,
    # a load of the pose, under which the plan is repeated until it settles; any other load is in
    # the task
    load: object = None,
    method: Method = "optimal",  # how joints are planned; a foot is optimised
    solver: Solver = "gauss-newton",  # solver of an optimised joint
    lines: Mapping[str, Any] | None = None,  # options of the closed form: segments, rule and refine
    # executed requests [rad], (n, k), near which optimised ones stay where they can
    executed: Array | None = None,
    # called with the name of each joint before it is planned
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """The plan for a task."""
    check_choice("solver", solver, SOLVERS)
    if method != "optimal" and len(task.scenarios) > 1:
        raise InvalidInput("models: got several of a joint, which need method 'optimal'")
    options: dict[str, Any] = {"method": method, "solver": solver, "lines": lines}
    options |= {"executed": executed, "progress": progress}
    if callable(load):
        return settled(lambda torques: planned(task.under(torques), **options), load, task.desired)
    if method == "closed_form":
        return closed_forms(task, progress=progress, **(lines or {}))
    if method == "shift":
        return shifted(task)

    from planner.planning.search import solve  # compiled: Numba takes a quarter of a second

    requests, nominal = solve(task, solver=solver, executed=executed, progress=progress)
    of_foot = task.goal == "foot"
    return Plan(
        task=task,
        requests=requests,
        method="foot_optimal" if of_foot else "optimal",
        solver=None if of_foot else solver,
        nominal_requests=nominal,
    )


def settled(plan_under: Callable[[Array], Plan], load: LoadOfPose, desired: Array) -> Plan:
    """A plan whose load is the load at its predicted angles.

    With the load tau(q) of a pose, round i plans under tau(q_{i-1}), q_0 = D, and simulates the
    requests under the load at the simulated angles,

    ``q_i = M(R_i, tau(q_i))``,

    by fixed-point iteration, which converges where a change of the angles changes the sag by less:
    ``kappa |d tau / d q| < 1``. It ends when that simulation agrees with the plan's prediction.
    Torques and angles have shape (n, k).
    """
    torques, moved = _torques(load, desired), np.inf
    for _ in range(50):
        plan = plan_under(torques)
        expected = plan.predicted
        plan, torques = _at_simulated_angles(plan, load)
        moved = float(np.max(np.abs(plan.predicted - expected)))
        # Where joints cannot follow, another round brings little.
        far = 0.01 * float(np.max(np.abs(plan.predicted - desired)))
        if moved <= max(1e-4, far):  # a fifteenth of a step of an encoder with 12 bits
            return plan
    raise _unsettled(moved, "plans")


def _at_simulated_angles(plan: Plan, load: LoadOfPose) -> tuple[Plan, Array]:
    """The plan under the load at its own simulated angles, and that load [N m], shape (n, k)."""
    angles, moved, share = plan.predicted, np.inf, 1.0
    for _ in range(50):
        torques = _torques(load, angles)
        plan = plan.under(torques)
        before, moved = moved, float(np.max(np.abs(plan.predicted - angles)))
        if moved <= 1e-9:  # rounding [rad]
            return plan, torques
        # On a fast path a pose that swings too far leads to a load that makes it swing too far the
        # other way.
        if moved > 0.7 * before:
            share = max(share / 2.0, 0.125)
        angles = angles + share * (plan.predicted - angles)
    raise _unsettled(moved, "simulations")


def _unsettled(moved: float, rounds: str) -> SolverFailed:
    """The error of a load that does not settle; two rounds suffice where joints can follow."""
    words = f"the prediction still moves by {angle_text(moved)} after 50 {rounds}"
    return SolverFailed("a load that depends on the pose", words)


def _torques(load: LoadOfPose, angles: Array) -> Array:
    """The torques of a load of the pose [N m], shape (n, k), checked."""
    answer = load(angles)
    try:
        torques = np.broadcast_to(as_reals(answer), angles.shape)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"load: the function answered {np.shape(answer)}, expected torques [N m] of shape "
            f"{angles.shape}, that of the angles"
        ) from error
    if not np.all(np.isfinite(torques)):
        raise InvalidInput("load: the function answered torques that are not finite")
    return torques
