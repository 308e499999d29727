"""The front leg in MuJoCo, read from the same URDF as everything else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kinematics.descriptions import urdf_path
from planner.exceptions import importing
from planner.virtual.constants import Constants

if TYPE_CHECKING:
    import mujoco

JOINTS = ("front_left_rotator", "front_left_abductor", "front_left_knee")
"""The joints of the leg, from the hip."""

OTHER_BODIES = (
    "head",
    "tail",
    "front_right_shoulder",
    "hind_left_shoulder",
    "hind_right_shoulder",
)
"""Parts of the robot that hang on the body and do not move here."""


def front_leg(constants: Constants) -> mujoco.MjModel:
    """The left front leg of ``urdf/ers210a.urdf``, its body held in the air.

    Links, masses, inertias and axes are those of the URDF. The joints get
    properties that a URDF lacks: the rotor behind the gear (armature), friction, and stops beyond
    the limits of requests. Nothing collides: the leg is in the air.

    Raises:
        MissingExtra: MuJoCo is not installed.
    """
    mujoco = load_mujoco()
    spec = mujoco.MjSpec.from_file(str(urdf_path("ers210a.urdf")))
    for name in OTHER_BODIES:
        spec.delete(spec.body(name))
    # Without this MuJoCo would give the ball, which has no mass in the URDF, that of its shape.
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.timestep = constants.control_period
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for name in JOINTS:
        drive_joint(spec.joint(name), constants)
    return spec.compile()


def drive_joint(joint: Any, constants: Constants) -> None:
    """Add the properties that a URDF lacks: rotor, friction, and stops beyond its limits."""
    joint.armature = constants.armature
    joint.frictionloss = constants.coulomb_friction
    joint.damping[0] = constants.viscous_friction
    # Dry friction is a constraint that MuJoCo softens; this is as stiff as its step allows.
    joint.solref_friction = [2.0 * constants.control_period, 1.0]
    joint.range = [joint.range[0] - constants.stop_margin, joint.range[1] + constants.stop_margin]


def load_mujoco() -> Any:
    """The package, or MissingExtra."""
    with importing("the virtual robot", "mujoco"):
        import mujoco
    return mujoco
