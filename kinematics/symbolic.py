"""The leg in CasADi: the same constants as :class:`kinematics.Leg`, for optimal control."""

from __future__ import annotations

from typing import Any

from kinematics.exceptions import InvalidInput
from kinematics.leg import Leg


def foot_function(leg: Leg) -> Any:
    """The foot's position and its derivatives as a CasADi function.

    The chain's constants come from Pinocchio (:mod:`kinematics.leg`); CasADi computes the
    derivatives itself, an independent check of :meth:`Leg.jacobians`.

    Args:
        leg: Any leg.

    Returns:
        ``casadi.Function``: angles (k,) [rad] to foot (3,) [m] and Jacobian (3, k) [m/rad], both in
        the base frame. Its ``map(n)`` takes a whole path, shape (k, n).

    Example:
        >>> from kinematics import Leg, urdf_path
        >>> leg = Leg.from_urdf(urdf_path("reference_leg.urdf"), base="hip", foot="foot")
        >>> foot, jacobian = foot_function(leg)([0.0, 0.2, 1.0])
        >>> foot.shape, jacobian.shape
        ((3, 1), (3, 3))
    """
    import casadi

    if not isinstance(leg, Leg):
        raise InvalidInput(f"leg: got {type(leg).__name__}, expected a kinematics.Leg")
    angles = casadi.SX.sym("angles", len(leg.joint_names))
    each = casadi.vertsplit(angles)
    cosines = [casadi.cos(angle) for angle in each]
    sines = [casadi.sin(angle) for angle in each]
    foot = leg.chain.foot(cosines, sines)
    return casadi.Function(
        "foot", [angles], [foot, casadi.jacobian(foot, angles)], ["angles"], ["foot", "jacobian"]
    )
