"""A policy's chunks of actions at 30 Hz, compensated while the arm moves.

    python examples/stream_chunks.py

An artificial policy gives chunks of 50 actions and is called again after 25 of them; the new chunk
differs from the old one. The arm is a simulated servo with friction and a load.
"""

from __future__ import annotations

import numpy as np

import planner
from planner.virtual.motors import Motor, Motors

PERIOD = 0.033  # [s]
CHUNK, USED = 50, 25  # actions in a chunk, and actions used before the next one
PREVIEW = 9  # actions that the stream looks ahead: 0.3 s
ACTIONS = 300


class Arm:
    """The virtual servo, with a clock that only it advances; yours has send and measure, too."""

    def __init__(self, start: float) -> None:
        self.servo = Motors([Motor(dry_friction=0.3, gravity=0.6)], [start])
        self.servo.powered[:], self.servo.gains[:] = 1.0, (16.0, 0.0, 32.0)
        self.servo.run(1.0)  # rests on its first request
        self.time, self.angles = self.servo.time, []

    def measure(self) -> np.ndarray:
        """The measured angles [rad]."""
        return self.servo.angles.copy()

    def send(self, requests: np.ndarray) -> None:
        """One row of goal positions [rad]; the servo moves for a period."""
        self.angles.append(self.servo.angles[0])
        self.servo.goals[:] = requests
        self.servo.run(self.servo.time + PERIOD)

    def sleep(self, seconds: float) -> None:
        """Wait by the arm's clock."""
        self.time += seconds


class Policy:
    """Means a motion up and down, and each of its chunks is a little off."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(0)
        self.chunk = np.zeros((0, 1))

    def actions(self, tick: int) -> np.ndarray | None:
        """The rest of the chunk in force: the actions from this tick on [rad], (m, 1)."""
        if tick == ACTIONS:
            return None
        if tick % USED == 0:
            time = PERIOD * (tick + np.arange(CHUNK))
            desired = 0.9 - 0.6 * np.cos(2.5 * time) + 0.1 * np.sin(7.0 * time)
            self.chunk = (desired + self.random.normal(0.0, 0.02))[:, np.newaxis]
        return self.chunk[tick % USED :]


def identified() -> planner.JointModel:
    """The servo's model, from a log of 20 s."""
    triangle = np.interp(np.arange(300), (0, 75, 225, 300), (0.8, 1.7, 0.0, 0.8))
    steps = np.repeat(np.random.default_rng(1).uniform(0.0, 1.7, 25), 12)
    requests = np.concatenate([triangle, steps])
    arm, sensed = Arm(0.8), []
    for request in requests:
        sensed.append(arm.measure()[0])
        arm.send(np.array([request]))
    times = PERIOD * np.arange(len(requests))
    log = planner.Log(times=times, requests=requests, angles=np.array(sensed))
    return planner.identify(log, hold_out=False).model


def run(send_actions) -> float:
    """Error of the arm to the actions [rad, rms] where this function sends the actions."""
    policy, desired = Policy(), []

    def actions(tick: int) -> np.ndarray | None:
        chunk = policy.actions(tick)
        if chunk is not None:
            desired.append(chunk[0, 0])
        return chunk

    arm = Arm(float(Policy().actions(0)[0, 0]))
    send_actions(arm, actions)
    return float(np.sqrt(np.mean((np.array(arm.angles) - desired) ** 2)))


def main() -> None:
    """Send the actions as they are, smoothed as users do, and by a stream."""
    model = identified()

    def direct(arm, actions, share=1.0):
        sent = None
        while (chunk := actions(len(arm.angles))) is not None:
            sent = chunk[0] if sent is None else sent + share * (chunk[0] - sent)
            arm.send(sent)

    def streamed(arm, actions):
        stream = planner.Stream(
            model, preview=PREVIEW, limits=(-0.5, 2.2), max_step=np.radians(12.0)
        )
        report = planner.follow(
            stream,
            actions,
            send=arm.send,
            measure=arm.measure,
            now=lambda: arm.time,  # leave now and sleep out on hardware
            sleep=arm.sleep,
        )
        print(report)

    print(f"actions as they are: {1e3 * run(direct):.0f} mrad rms off the actions")
    smoothed = run(lambda arm, actions: direct(arm, actions, share=0.25))
    print(f"smoothed, alpha = 0.25: {1e3 * smoothed:.0f}")
    print(f"by a stream: {1e3 * run(streamed):.0f}")


if __name__ == "__main__":
    main()
