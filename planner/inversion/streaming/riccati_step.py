"""What the plans of a stream cost, and the Gauss-Newton step that lowers it: compiled.

A plan R of one joint, with the angles M of the exact model under it, costs

    sum_k  w_k (M_k - D_k)^2 + sigma (R_k - R_{k-1})^2 + xi excess_k^2 + rho (R_k - R*_k)^2

where excess_k is what the change R_k - R_{k-1} exceeds ``max_step`` by, and R* would hold the
desired angles D. On the model with rounded corners dM_k = a_k dM_{k-1} + sum_j h_kj dR_{k-j} to
first order, so that the step solves a linear-quadratic problem whose state is an angle and the
requests that still act: by one Riccati recursion, at a cost in proportion to the length (C. V. Rao,
S. J. Wright, J. B. Rawlings, *Application of interior-point methods to model predictive control*,
J. Optim. Theory Appl. 99, 1998). Requests on a limit that the gradient would move beyond it stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from planner.model.joint import JointModel, RequestAges
from planner.model.symbolic import Call, one_period
from planner.trajectory import Indices


class Terms(NamedTuple):
    """Weights that all joints share, and the corners."""

    exceeding: float  # xi
    resting: float  # rho
    radii: tuple[float, ...]  # of the rounded corners in each period [theta_0]


class Plans:
    """The plans of several joints over one horizon: what they cost, and the steps that lower it.

    All arrays are allocated once: write to them and call :meth:`step` or :meth:`judge`.

    Attributes:
        past: Requests before each plan, at least those that still act.
        starts: Angle before the first sample [rad], shape (joints, 1).
        loads: Torque in each period [N m], shape (joints, samples).
        goal: Desired angles D [rad], shape (joints, samples).
        weights: Their weights w [-], shape (joints, samples).
        resting: Requests R* [rad], shape (joints, samples).
        settings: Weight sigma, ``max_step`` and the limits [rad], shape (joints, 4).
        damping: Levenberg-Marquardt term, and 1 where the first request stays, shape (joints, 2).
        plan: The past, then the plan [rad], shape (joints, past + samples).
        trials: The past, then other plans [rad], shape (joints, trials, past + samples).
        steps: Minus the Gauss-Newton step from the plan [rad], shape (joints, samples).
        costs: Of the plan and of the others [rad^2], shape (joints, 1 + trials).
    """

    def __init__(
        self, models: Sequence[JointModel], ages: RequestAges, terms: Terms, *, trials: int
    ) -> None:
        """Compile the functions, and lay out the arrays.

        Args:
            models: The joints.
            ages: Ages of the requests that act on any of them.
            terms: What the joints share; as many samples as it has radii.
            trials: How many other plans are judged together.
        """
        joints, samples = len(models), len(terms.radii)
        self.past = max(ages.width - 1, 1)
        self.starts = np.zeros((joints, 1))
        self.loads = np.zeros((joints, samples))
        self.goal = np.zeros((joints, samples))
        self.weights = np.ones((joints, samples))
        self.resting = np.zeros((joints, samples))
        self.settings = np.zeros((joints, 4))
        self.damping = np.zeros((joints, 2))
        self.plan = np.zeros((joints, self.past + samples))
        self.trials = np.zeros((joints, trials, self.past + samples))
        self.steps = np.zeros((joints, samples))
        self.costs = np.zeros((joints, 1 + trials))
        shared = self.starts, self.loads, self.goal, self.weights, self.resting, self.settings
        self._judge, self._step = [], []
        for joint, model in enumerate(models):
            cost, step = _compiled(model, ages, terms)
            given = [each[joint] for each in shared]
            judge = cost.map("judge", "serial", trials, list(range(len(given))), [])
            self._judge.append(Call(judge, [*given, self.trials[joint]], [self.costs[joint, 1:]]))
            arguments = [*given, self.plan[joint], self.damping[joint]]
            answers = [self.costs[joint, :1], self.steps[joint]]
            self._step.append(Call(step, arguments, answers))

    def step(self, joints: Indices) -> None:
        """Compute the steps, and the costs of the plans, of these joints."""
        for joint in joints.tolist():
            self._step[joint]()

    def judge(self, joints: Indices) -> None:
        """Compute the costs of the other plans of these joints."""
        for joint in joints.tolist():
            self._judge[joint]()


MOST_UNROLLED = 200_000
"""Samples times the square of the requests that act, up to which a step is spelled out to its last
operation, of which each takes a hundred bytes. Beyond, functions are called, which takes up to
twice as long. Half a second at 500 Hz is 140,000."""


@lru_cache(maxsize=64)
def _compiled(model: JointModel, ages: RequestAges, terms: Terms) -> tuple[Any, Any]:
    """The cost of a plan of one joint, and the step from it, as CasADi functions."""
    import casadi

    samples, past = len(terms.radii), max(ages.width - 1, 1)
    symbols: Any = casadi.SX if samples * past**2 <= MOST_UNROLLED else casadi.MX
    start, settings, damping = (
        symbols.sym(name, size) for name, size in (("start", 1), ("settings", 4), ("damping", 2))
    )
    requests = symbols.sym("requests", past + samples)
    loads, goal, weights, resting = (
        symbols.sym(name, samples) for name in ("loads", "goal", "weights", "resting")
    )
    smoothing, rate, lower, upper = casadi.vertsplit(settings)
    exact, slopes = one_period(model, ages)
    angles, by_angle, by_request = [start], [], []
    for i in range(samples):
        acting = requests[i + past - ages.width + 1 : i + past + 1][::-1]
        kept, moved = slopes(angles[-1], acting, loads[i], terms.radii[i] * model.theta_0)
        by_angle.append(kept)
        by_request.append(moved)
        angles.append(exact(angles[-1], acting, loads[i], 0.0))
    errors = casadi.vertcat(*angles[1:]) - goal
    plan = requests[past:]
    changes, away = plan - requests[past - 1 : -1], plan - resting
    excess = changes - casadi.fmin(casadi.fmax(changes, -rate), rate)
    squares = weights * errors**2 + smoothing * changes**2
    squares += terms.exceeding * excess**2 + terms.resting * away**2

    # Half the derivatives by the angles and by the requests, and the reduced gradient
    by_error = weights * errors
    by_change = smoothing * changes + terms.exceeding * excess
    own = by_change - casadi.vertcat(by_change[1:], 0.0) + terms.resting * away
    forces = [by_error[samples - 1]]
    for i in reversed(range(samples - 1)):
        forces.insert(0, by_error[i] + by_angle[i + 1] * forces[0])
    entries = casadi.vec(casadi.vertcat(*by_request) * casadi.vertcat(*forces))
    answered = np.arange(samples) + np.arange(ages.width)[:, np.newaxis]  # by age and request
    places = np.arange(ages.width)[:, np.newaxis] * samples + answered
    places[answered >= samples] = samples * ages.width  # behind the entries: zero
    each = casadi.vertcat(entries, 0.0)[places.ravel().tolist()]
    gradient = own + casadi.sum2(casadi.reshape(each, samples, ages.width))
    at_limit = casadi.logic_or(
        casadi.logic_and(plan <= lower, gradient > 0.0),
        casadi.logic_and(plan >= upper, gradient < 0.0),
    )
    free = 1.0 - at_limit
    free[0] *= 1.0 - damping[1]

    # Riccati recursion
    stage = _stage(past, slopes.sparsity_out(1))
    per_change = smoothing + terms.exceeding * (excess != 0.0)
    per_request = terms.resting + damping[0]
    matrix, vector, laws = casadi.DM.zeros(past + 1, past + 1), casadi.DM.zeros(past + 1), []
    for i in reversed(range(samples)):
        matrix, vector, feedback, constant = stage(
            matrix,
            vector,
            by_angle[i],
            by_request[i],
            weights[i],
            by_error[i],
            per_change[i],
            per_request,
            own[i],
            free[i],
        )
        laws.append((feedback, constant))
    state, steps = symbols.zeros(past + 1), []
    for i, (feedback, constant) in enumerate(reversed(laws)):
        steps.append(constant - feedback @ state)
        moved = casadi.vertcat(steps[-1], state[1:])[: ages.width]
        angle = by_angle[i] * state[0] + casadi.dot(by_request[i], moved.T)
        state = casadi.vertcat(angle, steps[-1], state[1:-1])

    given = [start, loads, goal, weights, resting, settings, requests]
    cost = casadi.sum1(squares)
    return (
        casadi.Function("cost", given, [cost]),
        casadi.Function("step", [*given, damping], [cost, casadi.vertcat(*steps)]),
    )


def _stage(past: int, acting: Any) -> Any:
    """One stage of the Riccati recursion, backward.

    With the state x = (dM_{k-1}, dR_{k-1}, ..., dR_{k-past}) it takes the cost
    ``x'Px - 2 p'x`` of what follows the period to that of what precedes it, and gives the law
    ``dR_k = constant - feedback x``.
    """
    import casadi

    SX, size = casadi.SX, past + 1
    matrix, vector = SX.sym("P", size, size), SX.sym("p", size)
    by_angle, by_request = SX.sym("a"), SX.sym("h", acting)
    weight, by_error, per_change, per_request, own, free = (
        SX.sym(name) for name in ("w", "e", "q", "r", "c", "f")
    )
    # z = (dR_k, dM_{k-1}, dR_{k-1}, ..., dR_{k-past}) and, of these, what is in the state after it
    leads = casadi.vertcat(by_request[0], by_angle, by_request[1:].T, SX.zeros(1))[: size + 1]
    kept = [0, *range(2, size)]
    half = (matrix[0, 0] + weight) / 2.0 * leads
    half[kept] += matrix[1:, 0]
    outer = leads @ half.T
    whole = outer + outer.T
    whole[kept, kept] += matrix[1:, 1:]
    whole[0, 0] += per_change + per_request
    whole[2, 2] += per_change
    whole[2, 0] -= per_change
    linear = (vector[0] + by_error) * leads
    linear[kept] += vector[1:]
    linear[0] += own
    share, coupling = free / whole[0, 0], whole[1:, 0]
    feedback, constant = share * coupling, share * linear[0]
    before = casadi.tril(whole[1:, 1:] - feedback @ coupling.T)
    given = [matrix, vector, by_angle, by_request, weight, by_error]
    return casadi.Function(
        "stage",
        [*given, per_change, per_request, own, free],
        [casadi.tril2symm(before), linear[1:] - feedback * linear[0], feedback.T, constant],
        {"cse": True},
    )
