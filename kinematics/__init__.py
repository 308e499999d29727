"""Leg kinematics over Pinocchio: forward and inverse kinematics of the foot."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinematics.chain import Limits as Limits
    from kinematics.inverse import InverseSolution as InverseSolution
    from kinematics.leg import Leg as Leg
    from kinematics.leg import foot_function as foot_function
    from kinematics.robot import urdf_path as urdf_path
    from planner.exceptions import InvalidInput as InvalidInput
    from planner.exceptions import PlannerError
    from planner.exceptions import UnreachableFoot as UnreachableFoot
    from planner.exceptions import UnsupportedLeg as UnsupportedLeg

    KinematicsError = PlannerError

_HOMES = {
    "InvalidInput": "planner.exceptions.InvalidInput",
    "InverseSolution": "kinematics.inverse.InverseSolution",
    "KinematicsError": "planner.exceptions.PlannerError",
    "Leg": "kinematics.leg.Leg",
    "Limits": "kinematics.chain.Limits",
    "UnreachableFoot": "planner.exceptions.UnreachableFoot",
    "UnsupportedLeg": "planner.exceptions.UnsupportedLeg",
    "foot_function": "kinematics.leg.foot_function",
    "urdf_path": "kinematics.robot.urdf_path",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Import a public name on first access (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'kinematics' has no attribute {name!r}")
    module, _, attribute = _HOMES[name].rpartition(".")
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
