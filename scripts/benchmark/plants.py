"""Joints of the planner's law, but not its model: other parameters, gravity, and a sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

import planner
from planner.arrays import Array


@dataclass
class MadeJoint:
    """A :class:`planner.JointModel` with gravity, whose sensor has noise and steps."""

    model: planner.JointModel
    gravity: float = 0.0  # torque at 90 degrees [N m], as of a pendulum that hangs at 0
    noise: float = 0.0  # standard deviation of the sensor's noise [rad]
    count: float = 0.0  # step of the sensor [rad]; 0 for none
    cyclic: bool = True  # whether requests repeat for ever
    late: int = 0  # samples by which the sensor is late
    seed: int = 0  # of the noise

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    def angles(self, requests: Array) -> Array:
        """True angles [rad], (n,): the load is that of these angles."""
        answer, load = None, np.zeros(len(requests))
        for _ in range(30 if self.gravity and self.model.feels_load else 1):
            before = answer
            answer = planner.simulate(self.model, requests, cyclic=self.cyclic, load=load)
            load = -self.gravity * np.sin(answer)
            if before is not None and np.max(np.abs(answer - before)) < 1e-7:
                break
        return answer

    def play(self, requests: Array, cycles: int = 1) -> tuple[Array, Array]:
        """True angles (n,) and the sensor's readings of several cycles (cycles, n) [rad]."""
        true = self.angles(requests)
        before = np.arange(len(true)) - self.late
        late = true[before if self.cyclic else np.maximum(before, 0)]
        seen = late + self.noise * self._random.standard_normal((cycles, len(true)))
        return true, self.count * np.round(seen / self.count) if self.count else seen


def random_joint(seed: int, *, spread: float = 0.3) -> MadeJoint:
    """A joint with parameters within a spread of the ERS-210A's, and effects that its model lacks.

    Top speed, threshold, lag and acceleration time are scaled by up to ``spread`` either way; dry
    friction up to 1 degree, top speeds that differ by up to a tenth, a sag of up to 2 degrees, up
    to 1 more by gravity, noise of up to 0.2 degrees, steps of 0, 0.09 or 0.3 degrees.
    """
    random = np.random.default_rng(seed)
    base = planner.JointModel.ers210a()
    scale = 1.0 + spread * random.uniform(-1.0, 1.0, 4)
    names = ("v_max", "theta_0", "lag", "acceleration_time")
    model = replace(
        base,
        **{name: getattr(base, name) * share for name, share in zip(names, scale, strict=True)},
        dead_band=math.radians(random.uniform(0.0, 1.0)),
        v_offset=0.1 * base.v_max * random.uniform(-1.0, 1.0),
        offset=math.radians(random.uniform(-2.0, 2.0)),
        compliance=math.radians(1.0),
    )
    return MadeJoint(
        model,
        gravity=float(random.uniform(0.0, 1.0)),
        noise=math.radians(random.uniform(0.0, 0.2)),
        count=math.radians(float(random.choice([0.0, 0.09, 0.3]))),
        seed=seed,
    )


def random_path(seed: int, samples: int, *, span: float, fastest: float) -> Array:
    """A cycle of some harmonics [rad], (n,), within a span [rad], steps of at most ``fastest``."""
    random = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.arange(samples) / samples
    path = sum(
        random.uniform(0.3, 1.0) / order * np.sin(order * phase + random.uniform(0.0, 6.28))
        for order in range(1, 5)
    )
    path = path - (path.max() + path.min()) / 2.0
    size = min(span / np.ptp(path), fastest / np.max(np.abs(np.diff(path))))
    return np.asarray(size * path)
