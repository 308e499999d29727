"""All joints of a leg at once, against joint by joint and the closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

import planner
from benchmark.instances import Array
from benchmark.parts import Options
from benchmark.table import Table
from benchmark.timing import median_time, timed
from kinematics import Leg, urdf_path

HIND = {"height": 0.056, "sideways": 0.0, "forward": -0.028, "hip_height": 0.112}
"""The hind legs' half ellipse in the walk of the front legs' one [m]."""


class Task(NamedTuple):
    """A leg, where its foot should be, and the nearest joint angles."""

    name: str
    leg: Leg
    desired: Array  # (n, 3) [m]
    nearest: Array  # (n, joints) [rad]


def measure(options: Options) -> list[Table]:
    """One row for each leg and method."""
    table = Table(
        "The foot",
        ("rms, cm", "largest, cm", "first solve, ms", "second, ms"),
        note=(
            "Distance of the foot from where it should be, every request within the leg's limits. "
            "Where a point is out of the leg's reach, that is the nearest one."
        ),
        stub="leg and method",
    )
    for task in tasks(options.samples):
        for name, method in METHODS.items():
            requests, first = timed(partial(method, task))
            distances = foot_distances(task, requests)
            again = median_time(partial(method, task), options.repeats)
            table.add(
                f"{task.name}: {name}",
                100.0 * float(np.sqrt(np.mean(distances**2))),
                100.0 * float(np.max(distances)),
                1e3 * first,
                1e3 * again,
            )
    return [table, bounds(options.samples)]


def bounds(samples: int) -> Table:
    """Lower bounds on the error of any requests within the limits, a row for each leg and norm."""
    table = Table(
        "The foot's bound",
        ("plan, cm", "lower bound, cm", "gap, %", "time of the bound, s"),
        note="The error in the plan's norm, and its proved bound for all requests within limits.",
        stub="leg and norm",
    )
    for task in tasks(samples):
        for norm in ("rms", "max"):
            joint = planner.JointModel.ers210a()
            plan = planner.invert_foot(joint, task.leg, task.desired, norm=norm)
            bound, seconds = timed(lambda plan=plan: plan.lower_bound)
            table.add(
                f"{task.name}, {norm}", 100.0 * plan.error, 100.0 * bound, 100.0 * plan.gap, seconds
            )
    return table


def tasks(samples: int) -> list[Task]:
    """The reference walk and the ERS-210A's four legs on the half ellipse of their end."""
    walk = planner.reference_walk()
    legs = [Task("reference walk", walk.leg, walk.desired_foot, walk.desired)]
    for end, ellipse in (("front", {}), ("hind", HIND)):
        path = planner.half_ellipse(samples=samples, **ellipse)
        for side, outward in (("left", 1.0), ("right", -1.0)):
            leg = Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot=f"{end}_{side}_ball")
            ellipse_in_body = hip(leg) + path * (1.0, outward, 1.0)
            angles = leg.joint_angles(ellipse_in_body, unreachable="nearest")
            legs.append(Task(f"{end} {side}", leg, leg.foot_positions(angles), angles))
    return legs


def hip(leg: Leg) -> Array:
    """Where the leg's first two axes meet, from the foot's circles about them [m], shape (3,).

    Turning the rotator keeps the foot in a plane y = const about the hip's x and z; turning the
    abductor does the same about its y and z.
    """
    quarter = np.array([0.0, 0.5 * np.pi, np.pi])
    swung = np.zeros((3, 3))
    swung[:, 0] = quarter
    raised = np.zeros((3, 3))
    raised[:, 1] = quarter
    about_rotator = leg.foot_positions(swung)
    about_abductor = leg.foot_positions(raised)
    centre = (about_rotator[0] + about_rotator[2]) / 2.0
    centre[1] = (about_abductor[0, 1] + about_abductor[2, 1]) / 2.0
    return centre


def foot_distances(task: Task, requests: Array) -> Array:
    """Distances of the foot under the requests [m], (n,)."""
    joint = planner.JointModel.ers210a()
    angles = np.stack([planner.simulate(joint, column) for column in requests.T], axis=1)
    distances: Array = np.linalg.norm(task.leg.foot_positions(angles) - task.desired, axis=1)
    return distances


def closed_form(task: Task) -> Array:
    """The paper's inversion of each joint, brought within the limits."""
    joint = planner.JointModel.ers210a()
    plans = [planner.invert_closed_form(joint, column) for column in task.nearest.T]
    requests = np.stack([plan.requests for plan in plans], axis=1)
    return np.clip(requests, task.leg.limits.lower, task.leg.limits.upper)


def joint_by_joint(task: Task) -> Array:
    """The optimised inversion of each joint."""
    joint = planner.JointModel.ers210a()
    columns = zip(task.nearest.T, task.leg.limits.lower, task.leg.limits.upper, strict=True)
    plans = [
        planner.invert_optimal(joint, column, limits=(lower, upper))
        for column, lower, upper in columns
    ]
    return np.stack([plan.requests for plan in plans], axis=1)


def stacked(norm: str, task: Task) -> Array:
    """All joints at once."""
    joint = planner.JointModel.ers210a()
    return planner.invert_foot(joint, task.leg, task.desired, norm=norm).requests


METHODS: dict[str, Callable[[Task], Array]] = {
    "closed form": closed_form,
    "joint by joint": joint_by_joint,
    "invert_foot, rms": partial(stacked, "rms"),
    "invert_foot, max": partial(stacked, "max"),
}
