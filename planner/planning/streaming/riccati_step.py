"""What the plans of a stream cost, and the Gauss-Newton step that lowers it: compiled.

A plan R of one joint, with the angles M of the exact model under it, costs

    sum_k  w_k (M_k - D_k)^2 + sigma (R_k - R_{k-1})^2 + xi excess_k^2 + rho (R_k - R*_k)^2

where excess_k is what the change R_k - R_{k-1} exceeds ``max_step`` by, and R* would hold the
desired angles D. On the model with rounded corners angle and speed after a period are to first
order linear in those before it and in the requests that act, so that the step solves a
linear-quadratic problem whose state is angle, speed and the requests that still act: by one Riccati
recursion, at a cost in proportion to the length (C. V. Rao, S. J. Wright, J. B. Rawlings,
*Application of interior-point methods to model predictive control*, J. Optim. Theory Appl. 99,
1998). Requests on a limit that the gradient would move beyond it stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.model.joint import JointModel, RequestAges, request_ages, weights_by_tick
from planner.trajectory import Array, Indices


class Terms(NamedTuple):
    """Weights that all joints share, and the corners."""

    exceeding: float  # xi
    resting: float  # rho
    radii: tuple[float, ...]  # of the rounded corners in each period [theta_0]


class Runs:
    """Request periods of several exact joints.

    Attributes:
        models: The joints.
        ages: Ages of the requests that act on any of them.
    """

    def __init__(self, models: Sequence[JointModel], ages: RequestAges) -> None:
        """Take the joints, and ages that contain those of the requests that act on any of them."""
        self.models, self.ages = tuple(models), ages
        own = [request_ages(model) for model in models]
        # Where each joint's requests are among those that act on any: the oldest first.
        self._from = [ages.oldest - each.oldest for each in own]

    def of(self, joint: int, requests: Array) -> Array:
        """Of requests that act on any joint, the oldest first, those from where one's begin."""
        return requests[self._from[joint] :]

    def run(self, angles: Array, speeds: Array, requests: Array, loads: Array) -> Array:
        """Angles after periods [rad], shape (joints, periods).

        Args:
            angles: Angles before the first period [rad], shape (joints,).
            speeds: Speeds before it [rad/tick], shape (joints,); overwritten by those at the end.
            requests: Every request that acts, the oldest first [rad], shape (joints, width - 1 +
                periods).
            loads: Torque in each period [N m], shape (joints, periods).
        """
        from planner.model import kernel

        reached, passed = np.empty(loads.shape), np.empty(loads.shape[1])
        for joint, model in enumerate(self.models):
            _, speeds[joint] = kernel.run(
                model.law,
                weights_by_tick(model),
                self.of(joint, requests[joint]),
                model.sag(loads[joint]),
                model.faster_per_tick(loads[joint]),
                float(angles[joint]),
                float(speeds[joint]),
                0,
                reached[joint],
                passed,
            )
        return reached


class Plans:
    """The plans of several joints over one horizon: what they cost, and the steps that lower it.

    All arrays are allocated once: write to them and call :meth:`step` or :meth:`judge`.

    Attributes:
        past: Requests before each plan, at least those that still act.
        starts: Angle before the first sample [rad], shape (joints,).
        speeds: Speed before it [rad/tick], shape (joints,).
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
        """Lay out the arrays.

        Args:
            models: The joints.
            ages: Ages of the requests that act on any of them.
            terms: What the joints share; as many samples as it has radii.
            trials: How many other plans are judged together.
        """
        joints, samples = len(models), len(terms.radii)
        self._runs, self._terms = Runs(models, ages), terms
        self._radii = [np.array(terms.radii) * model.theta_0 for model in models]
        self.past = max(ages.width - 1, 1)
        self.starts, self.speeds = np.zeros(joints), np.zeros(joints)
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
        self._angles, self._passed = np.zeros(samples), np.zeros(samples)
        self._slopes = [
            np.zeros((samples, 2, 2 + weights_by_tick(model).shape[1])) for model in models
        ]
        self._unused = self.past + 1 - ages.width  # requests of the past that no longer act

    def step(self, joints: Indices) -> None:
        """Compute the steps, and the costs of the plans, of these joints."""
        from planner.model import kernel
        from planner.planning.streaming import riccati

        for joint in joints.tolist():
            model, load = self._runs.models[joint], self.loads[joint]
            kernel.linearise(
                model.law,
                weights_by_tick(model),
                self._runs.of(joint, self.plan[joint, self._unused :]),
                model.sag(load),
                model.faster_per_tick(load),
                self._radii[joint],
                float(self.starts[joint]),
                float(self.speeds[joint]),
                self._angles,
                self._slopes[joint],
            )
            self.costs[joint, 0] = self._cost(joint, self.plan[joint])
            riccati.step(
                self._angles - self.goal[joint],
                self._slopes[joint],
                request_ages(model).youngest - self._runs.ages.youngest,
                2 if model.has_inertia else 1,
                self.weights[joint],
                self.resting[joint],
                self.settings[joint],
                self.damping[joint],
                self._terms.exceeding,
                self._terms.resting,
                self.past,
                self.plan[joint],
                self.steps[joint],
            )

    def judge(self, joints: Indices) -> None:
        """Compute the costs of the other plans of these joints."""
        from planner.model import kernel

        for joint in joints.tolist():
            model, load = self._runs.models[joint], self.loads[joint]
            for number, requests in enumerate(self.trials[joint]):
                kernel.run(
                    model.law,
                    weights_by_tick(model),
                    self._runs.of(joint, requests[self._unused :]),
                    model.sag(load),
                    model.faster_per_tick(load),
                    float(self.starts[joint]),
                    float(self.speeds[joint]),
                    0,
                    self._angles,
                    self._passed,
                )
                self.costs[joint, 1 + number] = self._cost(joint, requests)

    def _cost(self, joint: int, requests: Array) -> float:
        """The cost of a plan of a joint whose angles were run last [rad^2]."""
        from planner.planning.streaming import riccati

        return riccati.cost(
            self._angles - self.goal[joint],
            self.weights[joint],
            self.resting[joint],
            self.settings[joint],
            self._terms.exceeding,
            self._terms.resting,
            requests[self.past - 1 :],
        )
