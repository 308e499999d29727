"""Keys of a run file about the leg, how its joints answer, and the path that they should follow."""

from __future__ import annotations

from dataclasses import fields

from planner.cli.legs import SHIPPED
from planner.cli.models import FROM_URDF
from planner.cli.models import SHIPPED as SHIPPED_MODEL
from planner.files.kinds import by_name, choice, flag, number, several, source, text, whole
from planner.files.schema import Key, Table
from planner.model.joint import JointModel

ABOUT_PARAMETERS = {
    "v_max": "Top speed [rad/s].",
    "theta_0": "Error from which on the joint moves at top speed [rad].",
    "lag": "Time until it answers [s].",
    "acceleration_time": "Time until it answers fully [s].",
    "tick": "Time step of the model [s].",
    "hold": "Ticks for which a request is held.",
    "offset": "Static sag [rad].",
}


def parameters(otherwise: str) -> tuple[Key, ...]:
    """The parameters of a joint, of which some may be left out.

    Args:
        otherwise: What holds for one that is; "" is the joint model's own default.
    """
    return tuple(
        Key(
            name=field.name,
            kind=whole(least=1, most=10**6) if field.name == "hold" else number(),
            about=ABOUT_PARAMETERS[field.name],
            otherwise=otherwise or _default(field.default),
            example=round(getattr(JointModel.ers210a(), field.name), 4),
        )
        for field in fields(JointModel)
    )


def _default(value: object) -> str:
    return f"{value:g}" if isinstance(value, int | float) else "must be there"


LEG = Table(
    name=("leg",),
    about="The leg that follows a foot path; with a path of joints it gives their limits.",
    keys=(
        Key(
            name="name",
            kind=choice(*SHIPPED),
            about="A shipped leg: paths are in the body's frame, for 'reference' in the hip's.",
            example="front-left",
            set_to="reference",
        ),
        Key(
            name="urdf",
            kind=source(),
            about="The description of your own robot, in place of name.",
            example="robot.urdf",
        ),
        Key(
            name="base",
            kind=text("the name of a frame"),
            about="With urdf: the frame that positions of the foot are in.",
            example="base_link",
        ),
        Key(
            name="foot",
            kind=text("the name of a frame"),
            about="With urdf: the frame of the foot.",
            example="lf_foot",
        ),
        Key(
            name="lock",
            kind=by_name(number(), "angles by joint"),
            about="With urdf: joints to hold, and where [deg], so that three remain.",
            example={"wrist": -90.0},
        ),
        Key(
            name="lock_m",
            kind=by_name(number(), "positions by joint"),
            about="With urdf: the same of joints that slide [m].",
            example={"slide": 0.1},
        ),
        Key(
            name="near",
            kind=by_name(number(), "angles by joint"),
            about="A pose near which to start [deg], of several that reach the first point.",
            example={"knee": 30.0},
        ),
        Key(
            name="unreachable",
            kind=choice("raise", "nearest", "clamp"),
            about="Positions out of reach: stop and list them, take the nearest, or clamp joints.",
            default="raise",
            set_to="clamp",
        ),
    ),
)

MODELS = (
    Table(
        name=("model",),
        about="How the joints answer.",
        keys=(
            Key(
                name="file",
                kind=source(f"a model file, {SHIPPED_MODEL} or {FROM_URDF}"),
                about=f"A model file as identify writes it; '{SHIPPED_MODEL}' is Table 1 of the "
                f"paper, '{FROM_URDF}' stands in with the top speeds of the leg's description.",
                default=SHIPPED_MODEL,
            ),
        ),
    ),
    Table(
        name=("model", "parameters"),
        about="In place of model.file: the parameters of all joints.",
        keys=parameters(""),
        wanted=False,
    ),
    Table(
        name=("model", "joints"),
        about="A table for a joint that is unlike the others: its own file, or some parameters.",
        keys=(
            Key(
                name="file",
                kind=source(),
                about="A model file for this joint alone, in place of parameters.",
                example="knee.toml",
            ),
            *parameters("that of all joints"),
        ),
        named=True,
        wanted=False,
    ),
)

PATHS = (
    Table(
        name=("path",),
        about="What the joints or the foot should do: a file, or else a half ellipse.",
        keys=(
            Key(
                name="file",
                kind=source(),
                about="A CSV of joints (<joint>_deg, _rad) or of a foot (x_m, y_m, z_m; _cm, _mm).",
                example="path.csv",
            ),
            Key(
                name="joints",
                kind=several(text(), "names of joints"),
                about="With a file of joints: those to use, in this order; [] is every column.",
                default=[],
            ),
        ),
    ),
    Table(
        name=("path", "half_ellipse"),
        about="The foot path of a walk in the hip's frame, for which [path] has no file.",
        keys=(
            Key(
                name="samples",
                kind=whole(least=4, most=10**6),
                about="Samples in a cycle.",
                default=88,
            ),
            Key(
                name="length",
                kind=number(above=0.0),
                about="Half of the stroke [m].",
                default=0.04893,
            ),
            Key(
                name="height",
                kind=number(least=0.0),
                about="How high the foot swings [m].",
                default=0.042,
            ),
            Key(name="forward", kind=number(), about="Middle before the hip [m].", default=0.049),
            Key(name="sideways", kind=number(), about="Outward of the hip [m].", default=0.028),
            Key(name="hip_height", kind=number(), about="Hip above ground [m].", default=0.077),
            Key(
                name="ground_fraction",
                kind=number(above=0.0, below=1.0),
                about="Part of the cycle on the ground.",
                default=0.5,
            ),
            Key(
                name="heading_deg",
                kind=number(),
                about="Where the walk goes, from x towards y [deg]: 90 along y, 180 backward.",
                default=0.0,
            ),
            Key(
                name="for_leg",
                kind=flag(),
                about="Whether to size and place it for the leg, in the frame of its base, as "
                "gait --leg does: lengths that are not set here are then the leg's own.",
                default=False,
            ),
        ),
    ),
)
