"""Play planned requests on hardware: fill in `Servos`, and the rest stays as it is.

python examples/play_requests.py
"""

from __future__ import annotations

import numpy as np

import planner


class Servos:
    """Yours; this one only keeps the requests."""

    def __init__(self) -> None:
        self.sent: list[np.ndarray] = []

    def send(self, requests: np.ndarray) -> None:
        """One row of requests, one for each joint [rad]."""
        self.sent.append(requests)

    def angles(self) -> list[float]:
        """Where the joints are [rad]."""
        return [0.0, 0.2, 1.0]

    def relax(self) -> None:
        """Called once at the end, whatever ended it."""


def main() -> None:
    """Plan the reference walk joint by joint, lead the joints to its start, and walk two steps."""
    joint, walk, servos = planner.JointModel.ers210a(), planner.reference_walk(), Servos()
    plans = [planner.invert_optimal(joint, desired) for desired in walk.desired.T]
    report = planner.play(
        np.column_stack([plan.requests for plan in plans]),
        period=joint.period,
        cycles=2,
        send=servos.send,
        current=servos.angles(),
        speed=2.0,
        on_stop=servos.relax,
    )
    print(report)
    print(f"{len(servos.sent)} rows of requests were sent")


if __name__ == "__main__":
    main()
