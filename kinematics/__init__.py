"""Leg kinematics over Pinocchio: forward and inverse kinematics of the foot."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinematics.chain import Limits as Limits
    from kinematics.exceptions import InvalidInput as InvalidInput
    from kinematics.exceptions import KinematicsError as KinematicsError
    from kinematics.exceptions import UnreachableFoot as UnreachableFoot
    from kinematics.exceptions import UnsupportedLeg as UnsupportedLeg
    from kinematics.inverse import InverseSolution as InverseSolution
    from kinematics.leg import Leg as Leg
    from kinematics.leg import foot_function as foot_function
    from kinematics.robot import urdf_path as urdf_path

_HOMES = {
    "InvalidInput": "exceptions",
    "InverseSolution": "inverse",
    "KinematicsError": "exceptions",
    "Leg": "leg",
    "Limits": "chain",
    "UnreachableFoot": "exceptions",
    "UnsupportedLeg": "exceptions",
    "foot_function": "leg",
    "urdf_path": "robot",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    """Import a public name on first access (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'kinematics' has no attribute {name!r}")
    return getattr(import_module(f"kinematics.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
