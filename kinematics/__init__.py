"""Leg kinematics over Pinocchio: forward and inverse kinematics of the foot."""

from kinematics.chain import Limits
from kinematics.inverse import InverseSolution
from kinematics.leg import Leg, foot_function
from kinematics.robot import urdf_path
from planner.exceptions import InvalidInput, UnreachableFoot, UnsupportedLeg
from planner.exceptions import PlannerError as KinematicsError

__all__ = [
    "InvalidInput",
    "InverseSolution",
    "KinematicsError",
    "Leg",
    "Limits",
    "UnreachableFoot",
    "UnsupportedLeg",
    "foot_function",
    "urdf_path",
]
