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
from functools import cached_property, lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy import sparse

from planner.model.sensitivity import Response
from planner.planning.arguments import Norm
from planner.planning.clarabel import Cones, ConicSolution, ConicSolver
from planner.planning.kkt_step import Damping, Iterate, Step, cost_of
from planner.planning.tracking_problem import TrackingProblem, Windows
from planner.trajectory import Array, Indices, Mask

TOLERANCE = 1e-8
"""Clarabel's gap [rad^2] and residuals [rad]: steps are judged by simulation, and requests are
brought within their limits exactly. Motions of less than a thousandth of a radian with ``max_step``
would need less."""


def qp_step(
    problem: TrackingProblem,
    current: Iterate,
    damping: Damping,
) -> Step:
    """The step of the module's problem.

    Limits are conditions of the programme only where its solution without them would make a change
    larger than ``max_step``, or where it is not soon clear which requests stay at limits of their
    own: a step with such conditions takes about six times as long as one without.

    Args:
        problem: Which requests may move, within which limits and by how much at a time.
        current: Where the search is, its requests within the limits.
        damping: The Levenberg-Marquardt terms.

    Returns:
        The change of requests and of angles, and the cost that the linearisation predicts.

    Raises:
        numpy.linalg.LinAlgError: The solver found no step.
    """
    response, cost, regularisation = current.response, current.cost, current.regularisation
    programme = _programme_of(problem, regularisation.second_differences)
    weight, away, free = regularisation.weight, regularisation.away, programme.free
    gradient: Array = weight * np.asarray(programme.transposed @ away)  # half that of the term
    terms = _Terms(
        2.0 * np.concatenate([gradient[free], cost.gradient.ravel()]),
        programme.curvature(weight, cost.curvature, damping),
        programme.dynamics(response),
        current.defects.ravel(),
    )
    answer = programme.solve(terms, current.requests)
    changes, angles = np.zeros(free.shape), answer.unknowns[programme.count :]
    changes[free] = answer.unknowns[: programme.count]
    angles = angles.reshape(current.angles.shape)
    multipliers = answer.multipliers[: angles.size].reshape(angles.shape) / 2.0
    moved = regularisation._replace(away=away + programme.operator @ changes)
    predicted = cost.value + 2.0 * float(np.vdot(cost.gradient, angles)) + cost_of(moved)
    predicted += float(np.einsum("ki,kij,kj->", angles, cost.curvature, angles))
    forces = problem.over_driven(response.by_request * multipliers)
    reduced_gradient = gradient - problem.windows.gathered(forces)
    return Step(changes, angles, multipliers, reduced_gradient, predicted)


ACTIVE_SET_ROUNDS = 8
"""Solutions after which the limits become conditions, which takes as long as six of them."""


class _Terms(NamedTuple):
    """Minimise ``linear @ z + z @ curvature @ z / 2`` where ``dynamics @ z == right``.

    Of the matrices, of curvature the upper triangle, the stored entries, column by column.
    """

    linear: Array
    curvature: Array
    dynamics: Array
    right: Array


class _Pattern:
    """Where the entries of a sparse matrix are; entries at one place are added."""

    def __init__(
        self, rows: Sequence[Indices], columns: Sequence[Indices], shape: tuple[int, int]
    ) -> None:
        every = [np.concatenate([each.ravel() for each in parts]) for parts in (rows, columns)]
        key = every[1].astype(np.int64) * shape[0] + every[0]
        places, self._place = np.unique(key, return_inverse=True)
        self.rows = places % max(shape[0], 1)
        self.columns = places // max(shape[0], 1)
        self.diagonal = self.rows == self.columns
        self._ends = np.searchsorted(places, np.arange(shape[1] + 1) * shape[0])
        self._shape = shape

    def stored(self, entries: Sequence[Array]) -> Array:
        """The matrix's entries, column by column."""
        every = np.concatenate([each.ravel() for each in entries])
        return _sums(self._place, every, len(self.rows))

    def times(self, stored: Array, vector: Array) -> Array:
        """The matrix times a vector."""
        return _sums(self.rows, stored * vector[self.columns], self._shape[0])

    def transposed_times(self, stored: Array, vector: Array) -> Array:
        """The transposed matrix times a vector."""
        return _sums(self.columns, stored * vector[self.rows], self._shape[1])

    def matrix(self, stored: Array) -> sparse.csc_array:
        """The matrix with these stored entries."""
        return sparse.csc_array((stored, self.rows, self._ends), shape=self._shape)


def _sums(places: Indices, entries: Array, count: int) -> Array:
    """At each place the sum of its entries."""
    return np.asarray(np.bincount(places, entries, count), dtype=np.float64)


class _Conditions:
    """Conditions of steps at fixed places, with a solver that is set up at the first step."""

    def __init__(self, pattern: _Pattern, curvature: _Pattern, cones: Cones) -> None:
        self.pattern = pattern
        self._curvature = curvature
        self._cones = cones
        self._solver: ConicSolver | None = None

    def solve(self, terms: _Terms) -> ConicSolution:
        """The solution; a solver whose scaling no longer suits the entries is set up anew."""
        if self._solver is not None:
            self._solver.update(
                terms.linear,
                entries=terms.dynamics,
                limits=terms.right,
                curvature_entries=terms.curvature,
            )
            answer = self._solver.solve()
            if answer.solved:
                return answer
        self._solver = ConicSolver(
            terms.linear,
            self.pattern.matrix(terms.dynamics),
            terms.right,
            self._cones,
            curvature=self._curvature.matrix(terms.curvature),
            tolerance=TOLERANCE,
        )
        return self._solver.solve()


class _Programme:
    """The matrices of the steps of one problem; unknowns are its free requests, then the angles.

    Attributes:
        free: Requests that may change, shape (n, joints).
        count: How many.
        operator: The matrix S.
        transposed: The matrix S'.
    """

    def __init__(self, problem: TrackingProblem, *, second_differences: bool) -> None:
        self._lower, self._upper = problem.lower, problem.upper
        self.free = problem.movable & (problem.lower < problem.upper)
        samples = len(self.free)
        states = len(problem.models) * (2 if problem.has_speeds else 1)
        self._joints = len(problem.models)
        self.count = int(self.free.sum())
        self._column = np.full(self.free.shape, -1)
        self._column[self.free] = np.arange(self.count)
        self._angle = self.count + np.arange(samples * states).reshape(samples, states)
        self._size = self.count + samples * states
        self.operator, self.transposed, self._squares = smoothing_matrices(
            samples,
            cyclic=problem.cyclic,
            centring=problem.centring,
            second_differences=second_differences,
        )
        self._set_up_curvature(problem.norm)
        self._set_up_dynamics(problem.windows)
        self._set_up_limits(problem.max_step, cyclic=problem.cyclic)

    def _set_up_dynamics(self, windows: Windows) -> None:
        """``dM[k] - by_own[k] dM[k-1] - sum_j by_request[j, k] dR[acting[j, k]] = defects``."""
        angle = self._angle
        row = np.arange(angle.size).reshape(angle.shape)
        acts = windows.acting[:, :, np.newaxis] >= 0
        column = np.where(acts, self._column[np.maximum(windows.acting, 0)], -1)
        column = np.tile(column, angle.shape[1] // column.shape[-1])  # one request, many models
        self._moved = column >= 0
        moved_row: Indices = np.broadcast_to(row, column.shape)[self._moved]
        rows: list[Indices] = [row, row, moved_row]
        columns: list[Indices] = [angle, angle[windows.before], column[self._moved]]
        if angle.shape[1] > self._joints:  # of each angle the speed, and of each speed the angle
            rows.append(row)
            columns.append(np.roll(angle, self._joints, axis=1)[windows.before])
        shape = angle.size, self._size
        self._dynamics = _Conditions(
            _Pattern(rows, columns, shape), self._curvature, Cones(angle.size, 0)
        )

    def dynamics(self, response: Response) -> Array:
        """The stored entries of the matrix of the dynamics."""
        by_request = response.by_request[self._moved]
        entries = [np.ones(self._angle.shape), -response.by_own, -by_request]
        if response.by_other is not None:
            entries.append(-response.by_other)
        return self._dynamics.pattern.stored(entries)

    @cached_property
    def _within_limits(self) -> _Conditions:
        """The dynamics, then the limits."""
        dynamics, limits = self._dynamics.pattern, self._limits.tocoo()
        equations = self._angle.size
        pattern = _Pattern(
            [dynamics.rows, equations + limits.row.astype(np.intp)],
            [dynamics.columns, limits.col.astype(np.intp)],
            (equations + limits.shape[0], self._size),
        )
        return _Conditions(pattern, self._curvature, Cones(equations, limits.shape[0]))

    def _set_up_curvature(self, norm: Norm) -> None:
        squared = self._squares
        one, other = self._column[squared.row], self._column[squared.col]
        upper = (one >= 0) & (one <= other)
        self._squared = np.broadcast_to(squared.data[:, np.newaxis], upper.shape)[upper]
        i, j = np.triu_indices(self._angle.shape[1])
        if norm == "rms":  # a sum over sets of models: none couples the angles of two
            own = i // self.free.shape[1] == j // self.free.shape[1]
            own &= (i == j) | (j < self._joints)  # speeds have no cost
            i, j = i[own], j[own]
        self._triangle = i, j
        diagonal = np.arange(self.count)
        self._curvature = _Pattern(
            [one[upper], diagonal, self._angle[:, i]],
            [other[upper], diagonal, self._angle[:, j]],
            (self._size, self._size),
        )

    def curvature(self, weight: float, curvature: Array, damping: Damping) -> Array:
        """The stored entries of twice the matrix of the quadratic terms, its upper triangle."""
        i, j = self._triangle
        of_angles = curvature[:, i, j] + np.where(i == j, damping.angles[:, i], 0.0)
        of_requests = damping.requests[self.free]
        return 2.0 * self._curvature.stored([weight * self._squared, of_requests, of_angles])

    def solve(self, terms: _Terms, requests: Array) -> ConicSolution:
        """The unknowns and the multipliers of the dynamics, within the limits."""
        answer = self._held_at_limits(terms, requests)
        if answer is None or self._step_too_large(answer, requests):
            within = self._within_limits
            entries = within.pattern.stored([terms.dynamics, self._limits.data])
            right = np.concatenate([terms.right, self.room(requests)])
            answer = within.solve(terms._replace(dynamics=entries, right=right))
        if not answer.solved:
            raise np.linalg.LinAlgError(f"no step was found: {answer.status}")
        return answer

    def _held_at_limits(self, terms: _Terms, requests: Array) -> ConicSolution | None:
        """The solution with requests held at limits of their own; None where that does not end.

        Held are those that would pass them, until the force on them turns inward: the primal-dual
        active set strategy (M. Hintermüller, K. Ito, M. Kunisch, *The primal-dual active set
        strategy as a semismooth Newton method*, SIAM J. Optim. 13, 2002).
        """
        if not (self._above_lower.any() or self._below_upper.any()):
            answer = self._dynamics.solve(terms)
            return answer if answer.solved else None
        low, high = ((limit - requests)[self.free] for limit in (self._lower, self._upper))
        at_low, at_high = low > -TOLERANCE, high < TOLERANCE
        for _ in range(ACTIVE_SET_ROUNDS):
            held, place = np.zeros(self._size, dtype=np.bool_), np.zeros(self._size)
            held[: self.count] = at_low | at_high
            place[: self.count] = np.where(at_low, low, np.where(at_high, high, 0.0))
            answer = self._dynamics.solve(self._fixed(terms, held, place))
            if not answer.solved:
                return None
            changes = answer.unknowns[: self.count]
            gradient = self._gradient(terms, answer)[: self.count]
            before = at_low, at_high
            at_low = np.where(at_low, gradient > 0.0, changes < low - TOLERANCE)
            at_high = np.where(at_high, gradient < 0.0, changes > high + TOLERANCE)
            if np.array_equal(before, (at_low, at_high)):
                return answer
        return None

    def _step_too_large(self, answer: ConicSolution, requests: Array) -> bool:
        """Whether a change from one request to the next is larger than allowed."""
        if not self._step.size:
            return False
        return bool(np.any(self._limits @ answer.unknowns > self.room(requests) + TOLERANCE))

    def _fixed(self, terms: _Terms, held: Mask, place: Array) -> _Terms:
        """The same with some unknowns at given places; ``place`` is 0 for all others."""
        if not held.any():
            return terms
        curvature, dynamics = self._curvature, self._dynamics.pattern
        linear = terms.linear + self._curvature_times(terms, place)
        linear[held] = -place[held]
        row_held, column_held = held[curvature.rows], held[curvature.columns]
        entries = np.where(row_held | column_held, 0.0, terms.curvature)
        entries[row_held & curvature.diagonal] = 1.0
        conditions = np.where(held[dynamics.columns], 0.0, terms.dynamics)
        right = terms.right - dynamics.times(terms.dynamics, place)
        return _Terms(linear, entries, conditions, right)

    def _gradient(self, terms: _Terms, answer: ConicSolution) -> Array:
        """The derivative of the Lagrangian by the unknowns."""
        forces = self._dynamics.pattern.transposed_times(terms.dynamics, answer.multipliers)
        return np.asarray(terms.linear + self._curvature_times(terms, answer.unknowns) + forces)

    def _curvature_times(self, terms: _Terms, vector: Array) -> Array:
        """The curvature, of which the upper triangle is stored, times a vector."""
        pattern, entries = self._curvature, terms.curvature
        below = np.where(pattern.diagonal, 0.0, entries)
        return pattern.times(entries, vector) + pattern.transposed_times(below, vector)

    def _set_up_limits(self, max_step: Array, *, cyclic: bool) -> None:
        """``limits @ unknowns <= room``."""
        column, free = self._column, self.free
        self._below_upper = free & np.isfinite(self._upper)
        self._above_lower = free & np.isfinite(self._lower)
        self._from = np.arange(len(free) if cyclic else len(free) - 1)
        self._to = (self._from + 1) % len(free)
        self._limited = np.isfinite(max_step) & (free[self._from] | free[self._to])
        self._step = np.broadcast_to(max_step, self._limited.shape)[self._limited]
        here, there = column[self._from][self._limited], column[self._to][self._limited]
        rows, columns, signs, last = [], [], [], 0
        for numbers, sign in (
            ((column[self._below_upper],), 1.0),
            ((column[self._above_lower],), -1.0),
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
        places = np.concatenate(rows), np.concatenate(columns)
        self._limits = sparse.csr_array((np.concatenate(signs), places), shape=(last, self._size))

    def room(self, requests: Array) -> Array:
        """How far each limit is from the requests [rad]."""
        changes = (requests[self._to] - requests[self._from])[self._limited]
        above = (self._upper - requests)[self._below_upper]
        below = (requests - self._lower)[self._above_lower]
        room = [above, below, self._step - changes, self._step + changes]
        return np.concatenate(room)


_programmes: WeakKeyDictionary[TrackingProblem, dict[bool, _Programme]] = WeakKeyDictionary()
"""Programmes of the problems in use, without and with second differences: a solver's last digits
depend on what it solved before, so that no two problems share one."""


def _programme_of(problem: TrackingProblem, second_differences: bool) -> _Programme:
    """The programme of a problem: worked out at the first call, then kept as long as it."""
    kept = _programmes.setdefault(problem, {})
    if second_differences not in kept:
        kept[second_differences] = _Programme(problem, second_differences=second_differences)
    return kept[second_differences]


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


@lru_cache(maxsize=8)
def smoothing_matrices(
    samples: int, *, cyclic: bool, centring: float, second_differences: bool
) -> tuple[sparse.csr_array, sparse.csr_array, sparse.coo_array]:
    """The matrix S, its transpose and S'S.

    S takes the terms of :meth:`TrackingProblem.roughness_terms`, up to what these take from a
    centre; without second differences it is the identity.
    """
    identity = sparse.eye_array(samples, format="csr")
    if not second_differences:
        matrix = identity
    else:
        matrix = second_difference_matrix(samples, cyclic=cyclic)
        if centring:
            matrix = sparse.vstack([matrix, centring * identity], format="csr")
    transposed = matrix.T.tocsr()
    return matrix, transposed, (transposed @ matrix).tocoo()
