"""SciPy's least_squares over the requests, angles and derivatives by simulation in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

import planner

from .problem import DEGREE, RADII, REGULARISATION, Array, Limits, Solve, best_of

MOST_EVALUATIONS = 60  # simulations in one stage
CYCLES = 20  # most rounds of Newton's method for the angle at a cycle's boundary


class Simulation:
    """The cycle of a joint with rounded corners, and its derivatives [degrees]."""

    def __init__(self, model: planner.JointModel, samples: int) -> None:
        self.v_max, self.theta_0 = model.v_max_per_tick / DEGREE, model.theta_0 / DEGREE
        self.offset = model.offset / DEGREE
        self.weights = model.window.weights
        ages = np.arange(model.window.first, model.window.last + 1)
        self.acting = (np.arange(samples)[:, np.newaxis] - ages) % samples

    def run(self, requests: Array, radius: float, boundary: float) -> tuple[Array, Array, Array]:
        """Angles, their derivatives by the angle before and by the requests that act."""
        windows = requests[self.acting] + self.offset
        angles, by_angle = np.empty((2, len(windows)))
        by_request = np.empty(windows.shape)
        gain, rounded = self.v_max / (2.0 * self.theta_0), radius**2
        angle = boundary
        for tick, window in enumerate(windows):
            above, below = window - (angle - self.theta_0), window - (angle + self.theta_0)
            to_above, to_below = np.sqrt(above**2 + rounded), np.sqrt(below**2 + rounded)
            slopes = self.weights * (gain * (above / to_above - below / to_below))
            angle += gain * float(self.weights @ (to_above - to_below))
            angles[tick], by_angle[tick], by_request[tick] = angle, 1.0 - slopes.sum(), slopes
        return angles, by_angle, by_request

    def cycle(self, requests: Array, radius: float, boundary: float) -> tuple[Array, Array, Array]:
        """The run that ends where it began."""
        for _ in range(CYCLES):
            run = self.run(requests, radius, boundary)
            mismatch = run[0][-1] - boundary
            if abs(mismatch) < 1e-9:
                break
            contraction = float(np.prod(run[1]))
            boundary += mismatch / max(1.0 - contraction, 1e-3)
        return run

    def jacobian(self, by_angle: Array, by_request: Array) -> Array:
        """Derivatives of the cycle's angles by the requests, (n, n)."""
        samples = len(by_angle)
        rows = np.zeros((samples, samples))
        np.add.at(rows, (np.arange(samples)[:, np.newaxis], self.acting), by_request)
        last = np.zeros(samples)
        for row, kept in zip(rows, by_angle, strict=True):
            row += kept * last
            last = row
        kept = np.cumprod(by_angle)
        return rows + np.outer(kept, rows[-1] / max(1.0 - kept[-1], 1e-9))


def build(model: planner.JointModel, samples: int) -> Solve:
    """Stages of the trust-region reflective method, the last one nearly exact."""
    simulation = Simulation(model, samples)
    weight = REGULARISATION**0.5

    def solve(trajectory: Array, limits: Limits, start: Array) -> Array:
        desired = trajectory / DEGREE
        resting = desired - simulation.offset
        lower, upper = limits[0] / DEGREE, limits[1] / DEGREE
        inside = 1e-9 * max(1.0, min(upper - lower, 1e3))
        boundary = desired[-1]
        requests, candidates = start / DEGREE, [start]
        for share in RADII:
            radius, last = share * simulation.theta_0, {}

            def cycle(requests: Array, radius: float = radius, last: dict = last) -> tuple:
                key = requests.tobytes()
                if key not in last:
                    last.clear()
                    last[key] = simulation.cycle(requests, radius, boundary)
                return last[key]

            def residuals(requests: Array, cycle: Any = cycle) -> Array:
                return np.append(cycle(requests)[0] - desired, weight * (requests - resting))

            def slopes(requests: Array, cycle: Any = cycle) -> Array:
                exact = simulation.jacobian(*cycle(requests)[1:])
                return np.vstack([exact, weight * np.eye(samples)])

            begin = np.clip(requests, lower + inside, upper - inside)
            options = {"bounds": (lower, upper), "max_nfev": MOST_EVALUATIONS, "x_scale": 1.0}
            requests = least_squares(residuals, begin, jac=slopes, **options).x
            candidates.append(requests * DEGREE)
        return best_of(model, trajectory, limits, candidates)

    return solve
