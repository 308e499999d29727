"""Leg kinematics over Pinocchio."""
