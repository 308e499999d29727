"""Position servos as their makers build them: a PID loop, a motor with friction, a load.

The law of :mod:`planner.model` is not used here. In each millisecond, with the
error e between the goal, as the profile lets it through, and the counted angle::

    duty     = clip(kp e + ki ∫e - kd w, -limit, limit), in steps of the PWM, 0 inside its dead band
    current  = clip((duty U - k w) / R, -I, I)
    J dw/dt  = k current - gravity sin(angle) - viscous w - friction
    friction = dry + load |k current - gravity sin(angle)| + rest exp(-|w| / w_s)

Dry friction is implicit: it stops the joint, and never drives it. Its form is the model M4 of BAM
(Duclusaud, Passault and others, Rhoban/bam), whose parts that rest adds to that of the load are
left out.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from planner.arrays import Array
from planner.compilation import compiled

STEP = 1e-3  # period of the loop and of the integration [s]
MOST_DELAY = 64  # steps by which a goal may be late
AMBIENT = 25.0  # temperature of the surroundings [°C]
STATE = (
    "angle",
    "speed",
    "through",  # goal that the profile lets through
    "pace",  # its speed
    "integral",
    "counted",  # angle by the sensor
    "felt",  # its speed
    "duty",  # share of the voltage that is switched, -1 to 1
    "current",
    "heat",  # temperature [°C]
    "pushing",  # for how long it has pushed at nearly full duty without moving [s]
)
"""State of a servo, in SI but for the temperature."""


@dataclass(frozen=True, kw_only=True)
class Motor:
    """The constants of a servo and of its load.

    The defaults are a Feetech STS3215 at 7.4 V: resistance, torque constant, armature and viscous
    friction as BAM identified them, at the joint; dry friction as the elbow of an SO-101 shows it.
    """

    voltage: float = 7.4  # of the supply [V]
    resistance: float = 2.676  # of the winding [ohm]
    torque_constant: float = 1.2116  # at the joint [N m/A]
    inertia: float = 0.0284  # at the joint, the load's included [kg m²]
    dry_friction: float = 0.12  # coulomb friction [N m]
    load_friction: float = 0.0  # share of the torque in the gear that friction takes
    rest_friction: float = 0.0  # friction that rest adds (Stribeck) [N m]
    rest_speed: float = 1.0  # speed at which it has fallen to a third [rad/s]
    viscous_friction: float = 0.059  # [N m s/rad]
    gravity: float = 0.0  # torque that holds the load level [N m]; it hangs at 0
    current_limit: float = 2.7  # [A]
    duty_steps: float = 1000.0  # steps of the PWM either way
    duty_dead_band: float = 0.0  # duty below which nothing is switched
    proportional: float = 0.166  # duty per rad and unit of the P gain
    integral: float = 0.1  # duty per rad s and unit of the I gain
    derivative: float = 0.00375  # duty per rad/s and unit of the D gain
    delay: float = 0.008  # time until a goal takes effect [s]
    counts: float = 4096.0  # counts of the sensor in a turn
    heat_capacity: float = 20.0  # of the winding and case [J/K]
    cooling_time: float = 300.0  # time constant of cooling [s]


def arm_of(motor: Motor, count: int) -> list[Motor]:
    """Such servos as the joints of an arm: each has another friction, the second and third lift."""
    lifts = {1: 0.5, 2: 0.3}
    largest = motor.torque_constant * min(motor.current_limit, motor.voltage / motor.resistance)
    return [
        replace(
            motor,
            dry_friction=motor.dry_friction * (1.0 + 0.2 * (k % 3)),
            inertia=motor.inertia * (1.0 + 0.3 * lifts.get(k % 6, 0.0)),
            gravity=lifts.get(k % 6, 0.0) * largest / 2.7,
        )
        for k in range(count)
    ]


class Motors:
    """Servos in motion; arrays have one entry per servo, and callers may write them."""

    def __init__(self, motors: list[Motor], angles: Array) -> None:
        """Servos at rest at these angles [rad], without torque."""
        count = len(motors)
        types = [(each.name, np.float64) for each in fields(Motor)]
        self._constants = np.array([astuple(motor) for motor in motors], dtype=types)
        self.goals = np.array(angles, dtype=float)  # [rad]
        self.powered, self.jammed = np.zeros((2, count))  # 1 where torque is on, where it is held
        self.gains = np.zeros((count, 3))  # P, I and D
        self.profiles = np.zeros((count, 2))  # top speed and acceleration of the goal, 0 for none
        self.limits = np.ones(count)  # largest duty, 0 to 1
        self._states = np.zeros(count, dtype=[(name, np.float64) for name in STATE])
        for name in ("angle", "through", "counted"):
            self._states[name] = self.goals
        self._states["heat"] = AMBIENT
        # views: angles [rad] and speeds [rad/s] as they are counted, the share of the voltage that
        # is switched, -1 to 1, temperatures [°C], which a caller may write, and for how long each
        # has pushed at nearly full duty without moving [s]
        self.angles, self.speeds, self.duties, self.temperatures, self.overload_times = (
            self._states[name] for name in ("counted", "felt", "duty", "heat", "pushing")
        )
        self._delayed = np.tile(self.goals[:, None], MOST_DELAY)
        self._done = 0

    @property
    def time(self) -> float:
        """How long they have been running [s]."""
        return self._done * STEP

    def run(self, until: float) -> None:
        """Let them run until a time since the beginning [s]."""
        steps = math.floor(until / STEP + 1e-6) - self._done
        if steps > 0:
            inputs = (self.goals, self.powered, self.gains, self.profiles, self.limits, self.jammed)
            _run(self._done, steps, self._constants, self._states, self._delayed, *inputs)
            self._done += steps


@compiled
def _run(  # type: ignore[no-untyped-def]
    first, steps, constants, states, delayed, goals, powered, gains, profiles, limits, jammed
):
    for i in range(len(goals)):
        motor, state = constants[i], states[i]
        late = min(MOST_DELAY - 1, round(motor.delay / STEP))
        quantum = 2.0 * math.pi / motor.counts
        top, acceleration = profiles[i]
        for step in range(first, first + steps):
            delayed[i, step % MOST_DELAY] = goals[i]
            goal = delayed[i, (step - late) % MOST_DELAY]
            error = goal - state.through
            if top == 0.0 and acceleration == 0.0:
                state.through, state.pace = goal, 0.0
            else:
                aim = abs(error) / STEP
                if top > 0.0:
                    aim = min(aim, top)
                if acceleration > 0.0:
                    aim = min(aim, math.sqrt(2.0 * acceleration * abs(error)))
                    change = math.copysign(aim, error) - state.pace
                    most = acceleration * STEP
                    state.pace += min(most, max(-most, change))
                else:
                    state.pace = math.copysign(aim, error)
                if abs(state.pace) * STEP >= abs(error) and state.pace * error >= 0.0:
                    state.through, state.pace = goal, 0.0
                else:
                    state.through += state.pace * STEP
            sensed = round(state.angle / quantum) * quantum
            state.felt += STEP / (STEP + 0.004) * ((sensed - state.counted) / STEP - state.felt)
            state.counted = sensed
            if powered[i] > 0.0:
                e = state.through - sensed
                p, ki, d = gains[i]
                summed = state.integral + motor.integral * ki * e * STEP
                state.integral = min(0.3, max(-0.3, summed))
                duty = motor.proportional * p * e + state.integral
                duty = round((duty - motor.derivative * d * state.felt) * motor.duty_steps)
                duty = duty / motor.duty_steps
                if abs(duty) <= motor.duty_dead_band:
                    duty = 0.0
                state.duty = min(limits[i], max(-limits[i], duty))
                induced = motor.torque_constant * state.speed
                current = (state.duty * motor.voltage - induced) / motor.resistance
                state.current = min(motor.current_limit, max(-motor.current_limit, current))
            else:
                state.through, state.pace, state.integral = sensed, 0.0, 0.0
                state.duty, state.current = 0.0, 0.0
            torque = motor.torque_constant * state.current - motor.gravity * math.sin(state.angle)
            speed = state.speed
            free = speed + STEP * (torque - motor.viscous_friction * speed) / motor.inertia
            friction = motor.dry_friction + motor.load_friction * abs(torque)
            friction += motor.rest_friction * math.exp(-abs(speed) / motor.rest_speed)
            slowed = abs(free) - STEP * friction / motor.inertia
            state.speed = 0.0 if jammed[i] > 0.0 else math.copysign(max(slowed, 0.0), free)
            state.angle += STEP * state.speed
            pushing = abs(state.duty) > 0.8 and abs(state.speed) < 0.05
            state.pushing = state.pushing + STEP if pushing else 0.0
            power = state.current * state.current * motor.resistance
            lost = (state.heat - AMBIENT) / motor.cooling_time
            state.heat += STEP * (power / motor.heat_capacity - lost)
