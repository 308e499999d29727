"""The numbers of a joint's law, the only joint data that compiled functions use."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

MOST_CYCLES = 200
"""Most cycles of a response that still drifts; bisection ends well before."""


REST_STEPS = 8
"""Steps of Newton's method to the angle at rest: with a sag of at most 0.9 the last one is of
1e-15 rad, begun anywhere within the sag."""


def motor_share(time_constant: float, tick: float) -> float:
    """Share of a difference of speeds that a motor makes up in a tick, k [-]; 1 without one."""
    return -math.expm1(-tick / time_constant) if time_constant > 0.0 else 1.0


def fastest_integral(gain: float, share: float, *, inside: bool, slope: float) -> float:
    """The share of an integral from which on a joint oscillates for ever, by Jury's criterion [-].

    With the gain gamma [1/tick], a motor's share k and the slope s of the sag by the angle it comes
    to rest if the share i of the integral is below k (1 - s) ``inside`` the drive, or in a speed
    loop below 1 with i gamma < k (gamma (1 - s) + i).
    """
    if inside:
        return share * (1.0 - slope)
    return 1.0 if gain <= share else min(1.0, share * (gain * (1.0 - slope)) / (gain - share))


class State(NamedTuple):
    """The state of a joint between two ticks; without inertia the angle alone counts."""

    angle: float  # [rad]
    speed: float = 0.0  # in the tick before [rad/tick]
    integral: float = 0.0  # of the loops of a servo [rad/tick]


class Law(NamedTuple):
    """The numbers of a joint's law, (1a) to (1d) of ``docs/math.md``, by ticks: for the kernel."""

    gain: float  # gamma = v_max / theta_0 [1/tick]
    top: float  # limit of the drive, v_max + gamma delta, in a speed loop v_max [rad/tick]
    friction: float  # gamma delta, delta the dead band [rad/tick]
    # of the difference between demanded speed and speed by which a motor changes its speed in a
    # tick: k = 1 - exp(-tick / time constant) [-]
    share: float = 1.0
    acceleration: float = math.inf  # largest change of the speed in a tick [rad/tick^2]
    sag_sin: float = 0.0  # sag by the sine of the angle [rad]
    sag_cos: float = 0.0  # by its cosine [rad]
    # of the difference between demanded speed and speed by which the integral of a speed loop
    # changes in a tick [-]; in a position controller of that between demanded speed and integral
    integral_share: float = 0.0
    integral_inside: float = 0.0  # 1 in a position controller: added within the drive's limits
    offset: float = 0.0  # static offset c [rad], beside the sag under a load

    @property
    def braking(self) -> float:
        """What friction takes of the speed in a tick [rad/tick]; nothing in (1b)."""
        return self.share * self.friction if self.share < 1.0 else 0.0

    @classmethod
    def of(cls, joint: Any, *, tick: float, acceleration: float) -> Self:
        """The law for ticks [s] of a model, or the parameters of a fit, with its acceleration."""
        acting = float(joint.time_constant > 0.0)  # an integral acts through it
        of_speed, of_position = joint.integral_rate, joint.position_integral_rate
        friction = joint.gain * joint.dead_band
        inside = acting * of_position > 0.0
        return cls(
            joint.gain * tick,
            (joint.v_max if acting * of_speed > 0.0 else joint.v_max + friction) * tick,
            friction * tick,
            motor_share(joint.time_constant, tick),
            acceleration * tick**2,
            float(joint.sag_sin),
            float(joint.sag_cos),
            float(acting * (of_speed + of_position) * tick),
            float(inside),
            float(joint.offset),
        )
