"""Paths of the robot descriptions that are shipped with the package."""

from __future__ import annotations

from pathlib import Path

from kinematics.exceptions import InvalidInput, UnknownDescription

SHIPPED = ("ers210a.urdf", "reference_leg.urdf")
"""The files of the folder ``urdf``, which lies beside this package in a checkout and in a wheel."""


def urdf_path(name: str) -> Path:
    """Path of a robot description that is shipped: one of :data:`SHIPPED`.

    Args:
        name: File name, such as ``"ers210a.urdf"``.

    Returns:
        Absolute path of the file.

    Raises:
        UnknownDescription: No such file is shipped.

    Example:
        >>> urdf_path("ers210a.urdf").name
        'ers210a.urdf'
    """
    if not isinstance(name, str):
        raise InvalidInput(f"name: got {type(name).__name__}, expected one of {', '.join(SHIPPED)}")
    if name not in SHIPPED:
        raise UnknownDescription(name, SHIPPED)
    return Path(__file__).resolve().parent.parent / "urdf" / name
