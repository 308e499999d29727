"""A target that is chosen while the arm moves, followed at 100 Hz without a jump.

    python examples/stream_100_hz.py

Every 1.5 s the user chooses another angle. A quintic leads there; its next 0.2 s are known. The arm
is a simulated servo with friction and a load.
"""

from __future__ import annotations

import numpy as np

import planner
from planner.virtual.motors import Motor, Motors

PERIOD = 0.01  # [s]
PREVIEW = 20  # rows, 0.2 s
TICKS = 900

MODEL = planner.JointModel(  # as request-planner identify finds it from a log of this servo
    v_max=4.77,
    theta_0=0.531,
    lag=0.011,
    acceleration_time=0.002,
    time_constant=0.024,
    max_acceleration=101.0,
    tick=0.001,
    dead_band=0.034,
    v_offset=-0.32,
    sag_sin=-0.068,
).requested_every(PERIOD)


class Target:
    """Angles on the way from one chosen angle to the next."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(2)
        self.start, self.goal, self.begun = 0.6, 0.6, 0

    def stretch(self, tick: int) -> np.ndarray | None:
        """The way from this tick on [rad], (PREVIEW, 1): another one after each choice."""
        if tick == TICKS:
            return None
        if tick % 150 == 0:
            self.start, self.begun = self.at(tick), tick
            self.goal = self.random.uniform(0.2, 1.6)
        return self.at(tick + np.arange(PREVIEW))[:, np.newaxis]

    def at(self, tick):
        """A quintic of 0.5 s."""
        share = np.clip((tick - self.begun) * PERIOD / 0.5, 0.0, 1.0)
        return self.start + (self.goal - self.start) * share**3 * (10 - 15 * share + 6 * share**2)


def error(*, streamed: bool) -> float:
    """Error of the arm to the target, sent as it is or by a stream [rad, rms]."""
    servo = Motors([Motor(dry_friction=0.3, gravity=0.6)], [0.6])
    servo.powered[:], servo.gains[:] = 1.0, (16.0, 0.0, 32.0)
    servo.run(1.0)  # rests on its first request
    target, clock, desired_angles, angles = Target(), [0.0], [], []

    def desired(tick: int) -> np.ndarray | None:
        stretch = target.stretch(tick)
        if stretch is not None:
            desired_angles.append(stretch[0, 0])
        return stretch

    def send(requests: np.ndarray) -> None:
        angles.append(servo.angles[0])
        servo.goals[:] = requests
        servo.run(servo.time + PERIOD)

    def sleep(seconds: float) -> None:
        clock[0] += seconds

    if streamed:
        stream = planner.Stream(
            MODEL, preview=PREVIEW, limits=(-0.2, 2.0), max_step=np.radians(400.0) * PERIOD
        )
        report = planner.follow(
            stream,
            desired,
            send=send,
            measure=servo.angles.copy,
            now=lambda: clock[0],  # leave now and sleep out on hardware
            sleep=sleep,
        )
        print(report)
    else:
        while (stretch := desired(len(angles))) is not None:
            send(stretch[0])
    return float(np.sqrt(np.mean((np.array(angles) - desired_angles) ** 2)))


def main() -> None:
    """Follow the target directly and by a stream."""
    print(f"the target as it is: {1e3 * error(streamed=False):.0f} mrad rms off the target")
    print(f"by a stream: {1e3 * error(streamed=True):.0f}")


if __name__ == "__main__":
    main()
