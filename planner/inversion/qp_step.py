"""One Gauss-Newton step as a quadratic programme, where requests are coupled to one another.

The step of ``kkt_step`` has a diagonal Hessian of the requests, and limits on each of them alone.
Two things couple a request to its neighbours: ``max_step``, the largest change from one to the
next, and the smoothing, the sum of squared second differences. With both the step solves

    minimise    2 g' dM + dM' (K + E) dM + alpha |a + S dR|^2 + dR' Delta dR
    subject to  B dM = H dR + defects
                lower <= R + dR <= upper,   |N (R + dR)| <= s

where S is the identity or takes second differences (with dry friction distances from the middle of
the dead band, too), N takes first differences, and a is what S makes of the requests, less their
centre (``docs/math.md``, section 6). Clarabel's interior-point
method solves it; the matrices are sparse and banded, so that the time is in proportion to n.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.inversion.clarabel import Cones, minimise_over_cones
from planner.inversion.kkt_step import Damping, Quadratic, Regularisation, Step, cost_of
from planner.inversion.tracking_problem import Indices, TrackingProblem
from planner.model.sensitivity import Response
from planner.trajectory import Array

TOLERANCE = 1e-8
"""Clarabel's gap and residuals [rad, and of a cost of about 1]: steps are judged by simulation, and
requests are brought within their limits exactly."""

USABLE = ("Solved", "AlmostSolved")
"""Clarabel's status of an answer that can be used."""


def qp_step(
    problem: TrackingProblem,
    requests: Array,
    response: Response,
    cost: Quadratic,
    *,
    regularisation: Regularisation,
    defects: Array,
    damping: Damping,
) -> Step:
    """The step of the module's problem.

    Most steps of a smoothing meet no limit, and a step without them costs a third: the limits are
    added where the step would pass one.

    Args:
        problem: Which requests may move, within which limits and by how much at a time.
        requests: The requests R, within the limits [rad], shape (n, joints).
        response: Derivatives at the current angles and requests.
        cost: The cost of the angles.
        regularisation: The cost of the requests.
        defects: By how much the angles fall short of where the periods lead, (n, joints).
        damping: The Levenberg-Marquardt terms.

    Returns:
        The change of requests and of angles, and the cost that the linearisation predicts.

    Raises:
        numpy.linalg.LinAlgError: The solver found no step.
    """
    programme = _programme_of(problem, regularisation.second_differences)
    weight, away, free = regularisation.weight, regularisation.away, programme.free
    slope: Array = weight * np.asarray(programme.operator.T @ away)
    linear = [2.0 * np.concatenate([slope[free], cost.gradient.ravel()])]
    curvature = programme.quadratic(weight, cost.curvature, damping)
    conditions, right = programme.dynamics(response), defects.ravel()
    cones = Cones(len(right), 0)
    (answer,) = minimise_over_cones(
        linear, conditions, right, cones, curvature=curvature, tolerance=TOLERANCE
    )
    room = programme.room(requests)
    if np.any(programme.limits @ answer.unknowns > room + TOLERANCE):
        conditions = sparse.csc_array(sparse.vstack([conditions, programme.limits]))
        right, cones = np.concatenate([right, room]), Cones(len(right), len(room))
        (answer,) = minimise_over_cones(
            linear, conditions, right, cones, curvature=curvature, tolerance=TOLERANCE
        )
    if answer.status not in USABLE:
        raise np.linalg.LinAlgError(f"no step was found: {answer.status}")
    changes, angles = np.zeros(free.shape), answer.unknowns[programme.count :]
    changes[free] = answer.unknowns[: programme.count]
    angles = angles.reshape(defects.shape)
    multipliers = answer.multipliers[: angles.size].reshape(angles.shape) / 2.0
    moved = regularisation._replace(away=away + programme.operator @ changes)
    predicted = cost.value + 2.0 * float(np.vdot(cost.gradient, angles)) + cost_of(moved)
    predicted += float(np.einsum("ki,kij,kj->", angles, cost.curvature, angles))
    forces = problem.over_driven(response.by_request * multipliers)
    gradient = slope - problem.windows.gathered(forces)
    return Step(changes, angles, multipliers, gradient, predicted)


class _Pattern:
    """Where the entries of a sparse matrix are; entries at one place are added."""

    def __init__(
        self, rows: Sequence[Indices], columns: Sequence[Indices], shape: tuple[int, int]
    ) -> None:
        every = [np.concatenate([each.ravel() for each in parts]) for parts in (rows, columns)]
        key = every[1].astype(np.int64) * shape[0] + every[0]
        places, self._place = np.unique(key, return_inverse=True)
        self._rows = places % max(shape[0], 1)
        self._ends = np.searchsorted(places, np.arange(shape[1] + 1) * shape[0])
        self._shape = shape

    def matrix(self, entries: Sequence[Array]) -> sparse.csc_array:
        every = np.concatenate([each.ravel() for each in entries])
        values = np.bincount(self._place, every, minlength=len(self._rows))
        return sparse.csc_array((values, self._rows, self._ends), shape=self._shape)


class _Programme:
    """The matrices of the steps of one problem; unknowns are its free requests, then the angles.

    Attributes:
        free: Requests that may change, shape (n, joints).
        count: How many.
        operator: The matrix S.
        limits: The limits are ``limits @ unknowns <= room(requests)``.
    """

    def __init__(self, problem: TrackingProblem, *, second_differences: bool) -> None:
        self.problem = problem
        self.free = problem.movable & (problem.lower < problem.upper)
        samples, models = len(self.free), len(problem.models)
        self.count = int(self.free.sum())
        self._column = np.full(self.free.shape, -1)
        self._column[self.free] = np.arange(self.count)
        self._angle = self.count + np.arange(samples * models).reshape(samples, models)
        self._size = self.count + samples * models
        self.operator = (
            smoothing_matrix(samples, cyclic=problem.cyclic, centring=problem.centring)
            if second_differences
            else sparse.csr_array(sparse.eye_array(samples))
        )
        self._set_up_dynamics()
        self._set_up_curvature()
        self._set_up_limits()

    def _set_up_dynamics(self) -> None:
        """``dM[k] - by_angle[k] dM[k-1] - sum_j by_request[j, k] dR[acting[j, k]] = defects``."""
        windows, angle = self.problem.windows, self._angle
        row = np.arange(angle.size).reshape(angle.shape)
        acts = windows.acting[:, :, np.newaxis] >= 0
        column = np.where(acts, self._column[np.maximum(windows.acting, 0)], -1)
        column = np.tile(column, angle.shape[1] // column.shape[-1])  # one request, many models
        self._moved = column >= 0
        self._dynamics = _Pattern(
            [row, row, np.broadcast_to(row, column.shape)[self._moved]],
            [angle, angle[windows.before], column[self._moved]],
            (angle.size, self._size),
        )

    def dynamics(self, response: Response) -> sparse.csc_array:
        """The matrix of the dynamics."""
        by_request = response.by_request[self._moved]
        return self._dynamics.matrix([np.ones(self._angle.shape), -response.by_angle, -by_request])

    def _set_up_curvature(self) -> None:
        squared = sparse.coo_array(self.operator.T @ self.operator)
        one, other = self._column[squared.row], self._column[squared.col]
        upper = (one >= 0) & (one <= other)
        self._squared = np.broadcast_to(squared.data[:, np.newaxis], upper.shape)[upper]
        i, j = np.triu_indices(self._angle.shape[1])
        if self.problem.norm == "rms":  # a sum over sets of models: none couples the angles of two
            own = i // self.free.shape[1] == j // self.free.shape[1]
            i, j = i[own], j[own]
        self._triangle = i, j
        diagonal = np.arange(self.count)
        self._curvature = _Pattern(
            [one[upper], diagonal, self._angle[:, i]],
            [other[upper], diagonal, self._angle[:, j]],
            (self._size, self._size),
        )

    def quadratic(self, weight: float, curvature: Array, damping: Damping) -> sparse.csc_array:
        """Twice the matrix of the quadratic terms, its upper triangle."""
        i, j = self._triangle
        of_angles = curvature[:, i, j] + np.where(i == j, damping.angles[:, i], 0.0)
        of_requests = damping.requests[self.free]
        return 2.0 * self._curvature.matrix([weight * self._squared, of_requests, of_angles])

    def _set_up_limits(self) -> None:
        problem, column, free = self.problem, self._column, self.free
        self._upper = free & np.isfinite(problem.upper)
        self._lower = free & np.isfinite(problem.lower)
        self._from = np.arange(len(free) if problem.cyclic else len(free) - 1)
        self._to = (self._from + 1) % len(free)
        self._limited = np.isfinite(problem.max_step) & (free[self._from] | free[self._to])
        here, there = column[self._from][self._limited], column[self._to][self._limited]
        rows, columns, signs, last = [], [], [], 0
        for numbers, sign in (
            ((column[self._upper],), 1.0),
            ((column[self._lower],), -1.0),
            ((there, here), 1.0),
            ((there, here), -1.0),
        ):
            row = last + np.arange(len(numbers[0]))
            for number, own in zip(numbers, (sign, -sign), strict=False):
                present = number >= 0
                rows.append(row[present])
                columns.append(number[present])
                signs.append(np.full(np.count_nonzero(present), own))
            last += len(row)
        self.limits = _Pattern(rows, columns, (last, self._size)).matrix(signs)

    def room(self, requests: Array) -> Array:
        """How far each limit is from the requests [rad]."""
        problem = self.problem
        changes = (requests[self._to] - requests[self._from])[self._limited]
        step = np.broadcast_to(problem.max_step, self._limited.shape)[self._limited]
        above, below = problem.upper - requests, requests - problem.lower
        room = [above[self._upper], below[self._lower], step - changes, step + changes]
        return np.concatenate(room)


@lru_cache(maxsize=4)
def _programme_of(problem: TrackingProblem, second_differences: bool) -> _Programme:
    """The programme of a problem: worked out at the first call, then kept."""
    return _Programme(problem, second_differences=second_differences)


@lru_cache(maxsize=8)
def second_difference_matrix(samples: int, *, cyclic: bool) -> sparse.csr_array:
    """The matrix that takes second differences ``R[k+1] - 2 R[k] + R[k-1]`` of requests.

    A cycle has one for every sample. From rest the request before the first one is the first, and
    there is none for the last one.
    """
    here = np.arange(samples if cyclic else samples - 1)
    before = here - 1 if cyclic else np.maximum(here - 1, 0)
    columns = np.concatenate([before % samples, here, (here + 1) % samples])
    values: npt.NDArray[np.float64] = np.repeat([1.0, -2.0, 1.0], len(here))
    return sparse.csr_array((values, (np.tile(here, 3), columns)), shape=(len(here), samples))


def smoothing_matrix(samples: int, *, cyclic: bool, centring: float) -> sparse.csr_array:
    """The matrix of :meth:`TrackingProblem.roughness_terms`, up to what it takes from a centre."""
    matrix = second_difference_matrix(samples, cyclic=cyclic)
    if not centring:
        return matrix
    return sparse.csr_array(sparse.vstack([matrix, centring * sparse.eye_array(samples)]))
