"""The virtual robot: it takes requests and returns measured angles, like a real one."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidTrajectory
from planner.trajectory import Array
from planner.virtual.constants import Constants
from planner.virtual.leg import front_leg, load_mujoco
from planner.virtual.pendulum import Pendulum
from planner.virtual.servo import Servo, Supply


@dataclass(frozen=True, eq=False)
class Recording:
    """Requests to the joints and their motion; one row per request.

    Attributes:
        times: Times of the requests [s], shape (n,).
        requests: The requests before clipping [rad], shape (n, k).
        sensed: Readings of the sensors right after each request [rad], shape (n, k).
        angles: The true angles at these times [rad], shape (n, k), unknown on a real robot.
    """

    times: Array
    requests: Array
    sensed: Array
    angles: Array


class VirtualRobot:
    """The left front leg of an ERS-210A in the air, three servos on one battery, or a pendulum.

    A request that is made at the start of a period reaches its servo after the transport delay;
    until then the servo keeps the one before. Requests beyond a joint's limits are cut to them, as
    the robot's software does. The same seed and the same requests give the same angles.
    """

    def __init__(
        self,
        start: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        constants: Constants | None = None,
        seed: int = 0,
        pendulum: Pendulum | None = None,
    ) -> None:
        """The robot at rest.

        Args:
            start: Requests that it has been holding [rad], shape (3,), or (1,) of a pendulum.
            constants: Its constants.
            seed: Of the noise of supply and sensors.
            pendulum: Load of a single joint, in place of the leg.

        Raises:
            MissingExtra: MuJoCo is not installed.
        """
        mujoco = load_mujoco()
        self.constants = Constants() if constants is None else constants
        self._model = pendulum.model(self.constants) if pendulum else front_leg(self.constants)
        self._data = mujoco.MjData(self._model)
        self._step = mujoco.mj_step
        margin = self.constants.stop_margin
        self.limits = self._model.jnt_range[:, 0] + margin, self._model.jnt_range[:, 1] - margin
        first = self._requests([np.asarray(start, dtype=np.float64)])[0]
        self._data.qpos[:] = first
        self._random = np.random.default_rng(seed)
        self._supply = Supply(self.constants, self._random)
        self._servos = [Servo(self.constants, float(angle)) for angle in first]
        constants = self.constants
        self._late = round(constants.transport_delay / constants.control_period)
        self._periods = round(constants.request_period / constants.control_period)
        self._under_way = deque([tuple(map(float, first))] * self._late)
        self._count = 0

    def play(self, requests: npt.ArrayLike) -> Recording:
        """Make one row of requests after the other; the robot goes on from where it is.

        Args:
            requests: One row per request period [rad], shape (n, k).

        Raises:
            InvalidTrajectory: Not a finite array of that shape.
        """
        rows = np.array(requests, dtype=np.float64)
        clipped = self._requests(rows)
        sensed, angles = np.empty_like(clipped), np.empty_like(clipped)
        index = np.arange(self._count, self._count + len(clipped), dtype=np.float64)
        times = self.constants.request_period * index
        for k, request in enumerate(clipped):
            angles[k], sensed[k] = self._data.qpos, self.sense()
            for _ in range(self._periods):
                self._advance(tuple(map(float, request)))
        self._count += len(clipped)
        for array in (times, rows, sensed, angles):
            array.setflags(write=False)
        return Recording(times, rows, sensed, angles)

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
        rows = np.asarray(requests, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.limits[0]) or not np.isfinite(rows).all():
            raise InvalidTrajectory(
                f"requests: got shape {rows.shape}, expected finite angles [rad] of shape "
                f"(n, {len(self.limits[0])}), one column per joint"
            )
        kept: Array = np.clip(rows, *self.limits)
        return kept

    def _advance(self, row: tuple[float, ...]) -> None:
        """One control period: sense, control, drive, move."""
        self._under_way.append(row)
        arrived = self._under_way.popleft()
        voltage = self._supply.voltage(sum(servo.drawn for servo in self._servos))
        sensed, speeds = self.sense(), self._data.qvel
        for j, servo in enumerate(self._servos):
            servo.request = arrived[j]
            servo.control(float(sensed[j]))
            self._data.qfrc_applied[j] = servo.drive(voltage, float(speeds[j]))
        self._step(self._model, self._data)
