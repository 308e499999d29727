"""The virtual robot: it takes requests and returns measured angles, like a real one."""

from __future__ import annotations

import math
import tomllib
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from kinematics.robot import urdf_path
from planner.arrays import Array, as_path
from planner.exceptions import importing

if TYPE_CHECKING:
    import mujoco

JOINTS = ("front_left_rotator", "front_left_abductor", "front_left_knee")
"""The joints of the leg, from the hip."""

OTHER_BODIES = (
    "head",
    "tail",
    "front_right_shoulder",
    "hind_left_shoulder",
    "hind_right_shoulder",
)
"""Parts of the robot that hang on the body and do not move here."""


_TABLES = tomllib.loads(Path(__file__).with_name("constants.toml").read_text("utf-8"))


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Constants of a virtual robot, in the units of ``constants.toml``."""

    terminal_resistance: float
    torque_constant: float
    rotor_inertia: float
    gear_ratio: float
    coulomb_friction: float
    viscous_friction: float
    battery_voltage: float
    battery_resistance: float
    supply_noise: float
    supply_correlation_time: float
    control_period: float
    request_period: float
    transport_delay: float
    proportional_gain: float
    integral_gain: float
    derivative_gain: float
    derivative_filter: float
    integral_share: float
    duty_steps: int
    sensor_bits: int
    sensor_range: float
    sensor_noise: float
    stop_margin: float

    @property
    def count(self) -> float:
        """One step of the sensor [rad]."""
        return self.sensor_range / float(2**self.sensor_bits)

    @property
    def sensor_error(self) -> float:
        """Standard deviation of the sensor's reading [rad]: its noise and its rounding."""
        return math.hypot(self.sensor_noise, self.count / math.sqrt(12.0))

    @property
    def armature(self) -> float:
        """Rotor inertia as the joint feels it [kg m^2]: times the gear ratio squared."""
        return self.rotor_inertia * self.gear_ratio**2

    @property
    def joint_torque_constant(self) -> float:
        """Torque at the joint per current [N m/A], and voltage per speed of the joint [V s/rad]."""
        return self.torque_constant * self.gear_ratio

    @property
    def stall_torque(self) -> float:
        """Torque at the joint, held still under the battery's voltage [N m], before friction."""
        return self.joint_torque_constant * self.battery_voltage / self.terminal_resistance

    @property
    def top_speed(self) -> float:
        """Speed at which torque and friction balance at the duty 1, no leg attached [rad/s]."""
        resistance = self.terminal_resistance + self.battery_resistance
        constant = self.joint_torque_constant
        driving = constant * self.battery_voltage / resistance - self.coulomb_friction
        return driving / (constant**2 / resistance + self.viscous_friction)

    def to_dict(self) -> Mapping[str, Mapping[str, Any]]:
        """Every constant with its unit and source, for reports."""
        return {name: {**each, "value": getattr(self, name)} for name, each in _TABLES.items()}


CONSTANTS = Constants(**{name: each["value"] for name, each in _TABLES.items()})
"""Those of the ERS-210A."""


class Recording(NamedTuple):
    """The motion of the joints; one row per request."""

    sensed: Array  # readings of the sensors right after each request [rad], shape (n, k)
    angles: Array  # the true angles at these times [rad], shape (n, k), unknown on a real robot


class VirtualRobot:
    """The left front leg of an ERS-210A in the air, three servos on one battery.

    A request that is made at the start of a period reaches its servo after the transport delay;
    until then the servo keeps the one before. Requests beyond a joint's limits are cut to them, as
    the robot's software does. The same seed and the same requests give the same angles.
    """

    def __init__(
        self,
        start: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        constants: Constants = CONSTANTS,
        seed: int = 0,
        model: mujoco.MjModel | None = None,
    ) -> None:
        """The robot at rest, at the requests that it has been holding [rad], (3,).

        The seed is that of the noise; the ``model`` has other joints on such servos. MissingExtra
        is raised where MuJoCo is not installed.
        """
        mujoco = load_mujoco()
        self.constants = constants
        self._model = model or front_leg(constants)
        self._data = mujoco.MjData(self._model)
        self._step = mujoco.mj_step
        margin = constants.stop_margin
        self.limits = self._model.jnt_range[:, 0] + margin, self._model.jnt_range[:, 1] - margin
        first = self._requests([np.asarray(start, dtype=np.float64)])[0]
        self._data.qpos[:] = first
        self._random = np.random.default_rng(seed)
        # each servo's sensed angle, its filtered speed, integral, duty and current
        self._sensed, zeros = first.copy(), np.zeros(len(first))
        self._speed, self._integral, self._duty, self._current = zeros, zeros, zeros, zeros
        self._noise = 0.0  # of the supply [V]
        late = round(constants.transport_delay / constants.control_period)
        self._periods = round(constants.request_period / constants.control_period)
        self._under_way = deque([first] * late)

    def play(self, requests: npt.ArrayLike) -> Recording:
        """Make one row of requests [rad], (n, k), after the other, from where the robot is."""
        clipped = self._requests(requests)
        sensed, angles = np.empty_like(clipped), np.empty_like(clipped)
        for k, request in enumerate(clipped):
            angles[k], sensed[k] = self._data.qpos, self.sense()
            for _ in range(self._periods):
                self._advance(request)
        for array in (sensed, angles):
            array.setflags(write=False)
        return Recording(sensed, angles)

    def sense(self) -> Array:
        """The angles now, in whole counts of the sensor and with its noise [rad], shape (k,)."""
        count = self.constants.count
        noise = self.constants.sensor_noise * self._random.standard_normal(self._model.nq)
        sensed: Array = count * np.round((self._data.qpos + noise) / count)
        return sensed

    def rest(self, seconds: float, angles: npt.ArrayLike) -> None:
        """Hold requests [rad], shape (k,), for so long [s]."""
        rows = round(seconds / self.constants.request_period)
        self.play(np.tile(np.asarray(angles, dtype=np.float64), (rows, 1)))

    def _requests(self, requests: npt.ArrayLike) -> Array:
        rows = as_path(requests, name="requests", columns=len(self.limits[0]), unit="rad")
        kept: Array = np.clip(rows, *self.limits)
        return kept

    def _advance(self, requests: Array) -> None:
        """One control period: supply, sense, control, drive, move.

        With the error e between the request that has arrived and the sensed angle, and the filtered
        speed of the latter w::

            duty    = clip(kp e + ki ∫e - kd w, -1, 1), in steps of the PWM
            current = (duty U - k speed) / R
            torque  = k current

        k is the motor's constant times the gear ratio. The integral is constant while the duty is
        at its limit, and is clipped to its largest share of the duty. The voltage U of the battery
        falls with the current that is drawn, and has slow noise.
        """
        constants, period = self.constants, self.constants.control_period
        keep = math.exp(-period / constants.supply_correlation_time)
        fresh = constants.supply_noise * math.sqrt(1.0 - keep**2)
        self._noise = keep * self._noise + fresh * self._random.standard_normal()
        drawn = float(np.sum(self._duty * self._current))
        voltage = constants.battery_voltage + self._noise - constants.battery_resistance * drawn
        self._under_way.append(requests)
        sensed, before = self.sense(), self._sensed
        share = period / (constants.derivative_filter + period)
        self._speed = self._speed + share * ((sensed - before) / period - self._speed)
        self._sensed = sensed
        errors = self._under_way.popleft() - sensed
        duty = (
            constants.proportional_gain * errors
            + self._integral
            - constants.derivative_gain * self._speed
        )
        summed = self._integral + constants.integral_gain * errors * period
        summed = np.clip(summed, -constants.integral_share, constants.integral_share)
        self._integral = np.where(np.abs(duty) < 1.0, summed, self._integral)
        self._duty = np.rint(constants.duty_steps * np.clip(duty, -1.0, 1.0)) / constants.duty_steps
        induced = constants.joint_torque_constant * self._data.qvel
        self._current = (self._duty * voltage - induced) / constants.terminal_resistance
        self._data.qfrc_applied[:] = constants.joint_torque_constant * self._current
        self._step(self._model, self._data)


def front_leg(constants: Constants) -> mujoco.MjModel:
    """The left front leg of ``urdf/ers210a.urdf``, its body held in the air: nothing collides."""
    mujoco = load_mujoco()
    spec = mujoco.MjSpec.from_file(str(urdf_path("ers210a.urdf")))
    for name in OTHER_BODIES:
        spec.delete(spec.body(name))
    # Without this MuJoCo would give the ball, which has no mass in the URDF, that of its shape.
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.timestep = constants.control_period
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for name in JOINTS:
        drive_joint(spec.joint(name), constants)
    return spec.compile()


def drive_joint(joint: Any, constants: Constants) -> None:
    """Add the properties that a URDF lacks: rotor, friction, and stops beyond its limits."""
    joint.armature = constants.armature
    joint.frictionloss = constants.coulomb_friction
    joint.damping[0] = constants.viscous_friction
    # Dry friction is a constraint that MuJoCo softens; this is as stiff as its step allows.
    joint.solref_friction = [2.0 * constants.control_period, 1.0]
    joint.range = [joint.range[0] - constants.stop_margin, joint.range[1] + constants.stop_margin]


def load_mujoco() -> Any:
    """The package, or MissingExtra."""
    with importing("the virtual robot", "mujoco"):
        import mujoco
    return mujoco
