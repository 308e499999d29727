"""All joints of a leg at once, against joint by joint and the closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

import planner
from benchmark.instances import Array
from benchmark.machine import median_time, timed
from benchmark.parts import Options
from benchmark.table import Table
from kinematics import Leg, urdf_path
from planner.arrays import rms

JOINT = planner.JointModel.ers210a()

HIND = {"height": 0.056, "sideways": 0.0, "forward": -0.028, "hip_height": 0.112}
"""The hind legs' half ellipse in the walk of the front legs' one [m]."""


class Task(NamedTuple):
    """A leg, where its foot should be, and the nearest joint angles."""

    name: str
    leg: Leg
    desired: Array  # (n, 3) [m]
    nearest: Array  # (n, joints) [rad]


def measure(options: Options) -> list[Table]:
    """One row for each leg and method, and for each leg and norm."""
    followed = Table(
        "The foot",
        "leg and method | rms, cm | largest, cm | first solve, ms | second, ms",
        note="Distance of the foot from where it should be, every request within the leg's limits. "
        "Where a point is out of the leg's reach, that is the nearest one.",
    )
    bounds = Table(
        "The foot's bound",
        "leg and norm | plan, cm | lower bound, cm | gap, % | time of the bound, s",
        note="The error in the plan's norm, and its proved bound for all requests within limits.",
    )
    for task in tasks(options.samples):
        for name, method in METHODS.items():
            requests, first = timed(partial(method, task))
            angles = np.transpose([planner.simulate(JOINT, column) for column in requests.T])
            distances = np.linalg.norm(task.leg.foot_positions(angles) - task.desired, axis=1)
            again = median_time(partial(method, task), options.repeats)
            errors = 100.0 * rms(distances), 100.0 * np.max(distances)
            followed.add(f"{task.name}: {name}", *errors, 1e3 * first, 1e3 * again)
        for norm in ("rms", "max"):
            plan = planner.invert_foot(JOINT, task.leg, task.desired, norm=norm)
            bound, seconds = timed(lambda plan=plan: plan.lower_bound)
            row = 100.0 * plan.error, 100.0 * bound, 100.0 * plan.gap, seconds
            bounds.add(f"{task.name}, {norm}", *row)
    return [followed, bounds]


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
    about_rotator, about_abductor = (
        leg.foot_positions(np.outer([0.0, np.pi], np.eye(3)[joint])).mean(axis=0)
        for joint in (0, 1)
    )
    return np.array([about_rotator[0], about_abductor[1], about_rotator[2]])


def closed_form(task: Task) -> Array:
    """The paper's inversion of each joint, brought within the limits."""
    plans = [planner.invert_closed_form(JOINT, column) for column in task.nearest.T]
    return np.clip(np.transpose([plan.requests for plan in plans]), *task.leg.limits)


def joint_by_joint(task: Task) -> Array:
    """The optimised inversion of each joint."""
    columns = zip(task.nearest.T, *task.leg.limits, strict=True)
    plans = [
        planner.invert_optimal(JOINT, column, limits=(lower, upper))
        for column, lower, upper in columns
    ]
    return np.transpose([plan.requests for plan in plans])


def stacked(norm: str, task: Task) -> Array:
    """All joints at once."""
    return planner.invert_foot(JOINT, task.leg, task.desired, norm=norm).requests


METHODS: dict[str, Callable[[Task], Array]] = {
    "closed form": closed_form,
    "joint by joint": joint_by_joint,
    "invert_foot, rms": partial(stacked, "rms"),
    "invert_foot, max": partial(stacked, "max"),
}
