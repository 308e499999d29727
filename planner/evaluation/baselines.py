"""Baselines of Section 5: the desired angles as requests, direct or with a lead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from planner.evaluation.metrics import Distance
from planner.exceptions import InvalidTrajectory
from planner.model.joint import JointModel
from planner.model.response import simulate_joints
from planner.trajectory import Array


@dataclass(frozen=True, eq=False)
class TimeShift:
    """Requests that are the desired angles, a whole number of samples early.

    Attributes:
        samples: The lead k: R(t) = D(t + k).
        requests: The requests of all joints [rad], shape (n, k).
        angles: What the joints do [rad], shape (n, k).
        distance: The distance by which this lead is the best.
    """

    samples: int
    requests: Array
    angles: Array
    distance: Distance


def direct(models: Sequence[JointModel], desired: Array) -> Array:
    """Angles of cyclic joints when the desired angles are requested: the paper's direct method.

    Args:
        models: One model per joint.
        desired: Desired angles [rad], shape (n, joints).

    Returns:
        Angles [rad], shape (n, joints), read-only.
    """
    if desired.ndim != 2 or desired.shape[1] != len(models):
        raise InvalidTrajectory(
            f"desired: got shape {desired.shape}, expected (n, {len(models)}), one column per model"
        )
    angles = simulate_joints(models, desired, cyclic=True)
    angles.setflags(write=False)
    return angles


def best_time_shift(
    desired: Array, unshifted: Array, distance: Callable[[Array], Distance]
) -> TimeShift:
    """The lead with the least error, of all n whole-sample leads of cyclic requests.

    A joint's answer to shifted requests is its shifted answer, so one simulation serves all leads.

    Args:
        desired: Desired angles [rad], shape (n, joints).
        unshifted: Angles when they are requested, by :func:`direct` [rad], shape (n, joints).
        distance: Distance from the goal for given angles [rad], shape (n, joints); the paper judges
            in the foot's space. The lead with the least rms is taken, the smallest such lead.
    """
    best = best_lead(unshifted, distance)
    requests = np.roll(desired, -best, axis=0)
    angles = np.roll(unshifted, -best, axis=0)
    for array in (requests, angles):
        array.setflags(write=False)
    return TimeShift(best, requests, angles, distance(angles))


def best_lead(unshifted: Array, distance: Callable[[Array], Distance]) -> int:
    """By how many samples to be early: the lead with the least rms, the smallest such lead.

    Args:
        unshifted: A cycle of the joints' angles when the desired angles are requested [rad],
            shape (n, joints).
        distance: Distance from the goal for given angles [rad], shape (n, joints).
    """
    leads = range(len(unshifted))
    return min(leads, key=lambda lead: distance(np.roll(unshifted, -lead, axis=0)).rms)
