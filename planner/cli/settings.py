"""All settings of a plan, its outputs and a sweep: type, unit, range, default and meaning."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from planner.cli.declared import (
    Count,
    Expected,
    NotNegative,
    Positive,
    Settings,
    Source,
    Span,
    Text,
    Values,
    Written,
    WrittenOrNone,
    option,
    setting,
    within,
)
from planner.exceptions import nearest

FROM_LOG, FROM_URDF, SHIPPED_MODEL = "from-log", "urdf", "ers210a"
"""Models without a file: those that `replay` identifies from the recordings themselves, those with
the top speeds of the leg's description and assumed other parameters, and Table 1 of the paper."""

Frame = Annotated[Text, Expected("the name of a frame", form="FRAME")]
Angles = Annotated[dict[str, float], Expected("a table of angles by joint")]
JointNames = Annotated[tuple[Text, ...], Expected("a list of names of joints", form="NAME")]
Weights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], Expected("a list of three numbers, 0 or more")
]
Tick = Annotated[int, within(ge=1 - 10**9, le=10**9 - 1)]
Length = Annotated[float, within(gt=0.0, le=2.0, words="a number above 0, up to 2, in metres")]
Share = Annotated[float, within(ge=0.0, le=1.0, words="a number from 0 to 1, 0.05 for 5 %")]
Samples = Annotated[int, within(ge=4, le=10**6)]

LEG_NAMES = ("reference", "front-left", "front-right", "hind-left", "hind-right")
"""The legs that need no description."""


def _is_leg(name: str) -> str:
    if not (name in LEG_NAMES or name.lower().endswith((".urdf", ".xml")) or "/" in name):
        raise ValueError(nearest(name, LEG_NAMES))
    return name


LegName = Annotated[Text, Expected(f"one of {', '.join(LEG_NAMES)}, or a .urdf file", _is_leg)]
Method = Literal["shift", "closed-form", "optimal", "foot-optimal"]
Load = Literal["urdf", "urdf-dynamics", "column"]
ReplayFormat = Literal["csv", "joints", "lerobot", "yaml", "bag", "mcap"]


class Leg(Settings):
    """The leg that follows a foot path; with a path of joints it gives their limits."""

    name: LegName | None = setting(
        "A shipped leg, or the URDF of your own robot, with base and foot. Positions are in the "
        "base's frame: of a shipped leg the body's, and for 'reference' the hip's.",
        example="front-left",
        set_to="reference",
        option="--leg",
    )
    urdf: Source | None = option(
        "The URDF of your own robot, where name is not set.", example="robot.urdf"
    )
    base: Frame | None = option(
        "With a URDF: the frame of the foot positions.", example="base_link"
    )
    foot: Frame | None = option("With a URDF: the frame of the foot.", example="lf_foot")
    lock: Angles | None = option(
        "With a URDF: joints to hold, and where [deg], so that three remain; with --lock "
        "slide=0.1m is one that slides.",
        example={"wrist": -90.0},
    )
    lock_m: Annotated[dict[str, float] | None, Expected("a table of positions by joint")] = setting(
        "With a URDF: the same for joints that slide [m].", example={"slide": 0.1}
    )
    near: Angles | None = option(
        "Initial pose [deg]: the nearest solution of the inverse kinematics is taken.",
        example={"knee": 30.0},
    )
    unreachable: Literal["raise", "nearest", "clamp"] = option(
        "Positions out of reach: stop and list them, take the nearest, or clamp each "
        "joint as the reference walk does.",
        default="raise",
        set_to="clamp",
    )

    @property
    def description(self) -> str | None:
        """The URDF of your own robot; None of a shipped leg."""
        return self.urdf or (None if self.name in LEG_NAMES else self.name)


class Model(Settings):
    """How the joints answer."""

    file: Annotated[Source, Expected(f"a model file, {SHIPPED_MODEL} or {FROM_URDF}")] = setting(
        f"A model file as identify writes it; '{SHIPPED_MODEL}' is Table 1 of the paper, "
        f"'{FROM_URDF}' assumes the same servos with the top speeds of the leg's description.",
        default=SHIPPED_MODEL,
        option="--model",
    )


class HalfEllipse(Settings):
    """The foot path of a walk in the hip's frame, for which [path] has no file."""

    samples: Samples = option("Samples in a cycle.", default=88)
    length: Length = setting("Half of the stroke [m].", default=0.04893, option="--half-stroke")
    height: Annotated[float, within(ge=0.0, le=2.0, words="a number from 0 to 2, in metres")] = (
        option("How high the foot swings [m].", default=0.042)
    )
    forward: float = option("Middle before the hip [m].", default=0.049)
    sideways: float = option("Outward of the hip [m].", default=0.028)
    hip_height: float = option("Hip above ground [m].", default=0.077)
    ground_fraction: Annotated[float, within(gt=0.0, lt=1.0)] = option(
        "Part of the cycle on the ground.", default=0.5
    )
    heading_deg: float = option(
        "Direction of the walk, from x towards y [deg]: 90 along y, 180 backward.", default=0.0
    )
    for_leg: bool = setting(
        "Whether to size and place it for the leg, in the frame of its base, as gait "
        "--leg does: lengths that are not set here are then the leg's own.",
        default=False,
    )

    def arguments(self, *, given_only: bool = False) -> dict[str, Any]:
        """The arguments of :func:`planner.half_ellipse`, with or without the defaults."""
        names = (self.keys_set if given_only else self.keys.keys()) - {"heading_deg", "for_leg"}
        return {
            "heading": math.radians(self.heading_deg),
            **{name: getattr(self, name) for name in names},
        }


class Path(Settings):
    """The path of the joints or of the foot: a file, or else a half ellipse."""

    file: Source | None = setting(
        "A CSV of joints (<joint>_deg, _rad) or of a foot (x_m, y_m, z_m; _cm, _mm).",
        example="path.csv",
    )
    joints: JointNames = setting(
        "With a file of joints: those to use, in this order.",
        default=(),
        otherwise="every column",
        option="--joint",
    )
    rate_hz: Positive | None = option(
        "Requests per second: a file with t_s is resampled to it, and the models take it.",
        otherwise="the models' own",
        example=50.0,
    )
    speed: Positive | None = option(
        "How many times as fast to follow the path: with fewer samples, on its straight "
        "lines, or more.",
        otherwise="as it is",
        example=1.5,
        metavar="FACTOR",
    )
    half_ellipse: HalfEllipse | None = setting(set_to=HalfEllipse())


OPTIMISED = ("optimal", "foot-optimal")
"""Methods that optimise."""


class Plan(Settings):
    """How the requests are planned."""

    method: Method = option(
        "The desired angles, the best time early; the paper's inversion; or requests "
        "optimised joint by joint, or all at once for the foot.",
        default="optimal",
        set_to="foot-optimal",
    )
    cyclic: bool | None = setting(
        "Whether the path repeats for ever, or starts from rest.",
        otherwise="yes, unless its ends are far apart",
        example=True,
        option="--cyclic/--no-cyclic",
    )
    load: Load | None = option(
        "Torque on the joints: gravity by the masses of the leg's URDF, all of its "
        "dynamics, or columns <joint>_load_Nm of the path.",
        otherwise="none",
        example="urdf",
    )
    norm: Literal["rms", "max"] | None = option(
        "Methods shift, optimal and foot-optimal: the error to make small.",
        only=("shift", *OPTIMISED),
        implied="rms",
    )
    solver: Literal["gauss-newton", "ipopt"] | None = option(
        "Method optimal: our own solver, or IPOPT with the same problem.",
        only=("optimal",),
        implied="gauss-newton",
    )
    max_step_deg: Positive | None = option(
        "Methods optimal and foot-optimal: largest change from one request to the next [deg, or "
        "percent of the range].",
        only=OPTIMISED,
        otherwise="none",
        example=5.0,
    )
    max_request_speed_deg_s: Positive | None = option(
        "The same as a speed: largest change of the requests [deg/s].",
        only=OPTIMISED,
        otherwise="none",
        example=600.0,
        metavar="DEG/S",
    )
    smoothness: Share | None = option(
        "Methods optimal and foot-optimal: share by which smoother requests may raise the "
        "error that the robot would show, of plan and model together (an encoder's step of "
        "0.088 degrees at least); 0 for none.",
        only=OPTIMISED,
        implied=0.005,
        metavar="SHARE",
    )
    robust: Literal["mean", "worst"] | None = option(
        "Methods optimal and foot-optimal: plan for models drawn from the intervals of "
        "the model file, too, and make the mean or the worst of their errors small.",
        only=OPTIMISED,
        otherwise="the model alone",
        example="worst",
    )
    weights: Weights | None = option(
        "Method foot-optimal: how much each axis counts, x, y, z.",
        only=("foot-optimal",),
        implied=[1.0, 1.0, 1.0],
        nargs=3,
        metavar="X Y Z",
    )
    segments: Count | None = option(
        "Method closed-form: lines of the approximation.",
        only=("closed-form",),
        otherwise="as many as reduce the error",
        example=6,
    )
    rule: Literal["paper", "exact"] | None = option(
        "Method closed-form: how a line is inverted.", only=("closed-form",), implied="paper"
    )

    def arguments(self, period: float, units: Mapping[str, float] | None = None) -> dict[str, Any]:
        """The arguments of :func:`planner.plan` that set its search, for a period [s].

        ``units``: by joint, how many of the settings' degrees are one of the joint's unit; by
        default all are angles [rad].
        """
        rate = self.max_request_speed_deg_s
        step = min(self.max_step_deg or math.inf, math.inf if rate is None else rate * period)
        return {
            "norm": self.norm or "rms",
            "max_step": {name: step / each for name, each in units.items()}
            if units
            else math.radians(step),
            "smoothness": self.smoothness,
            "robust": self.robust,
        }


SMOOTHING = "max_step_deg max_request_speed_deg_s smoothness"
"""The keys of :class:`Plan` that say how smooth the requests are."""


class Limits(Settings):
    """Ranges of the requests; those of the leg hold where there are none."""

    deg: Span | None = setting(
        "Smallest and largest request of every joint [deg], or of one.",
        otherwise="those of the leg, if there is one",
        example=[-120.0, 150.0],
        option="--limits-deg",
        by_joint="joints",
    )
    joints: dict[str, Span] = setting(
        "The same for single joints [deg], which overrule it.", example=[-27.0, 147.0]
    )


class Start(Settings):
    """With plan.cyclic = false and method optimal: where the joints rest before."""

    deg: float | None = setting(
        "Angle at which every joint rests before a path that does not repeat, from the same zero "
        "as the path [deg, or percent of the range].",
        otherwise="where the path begins",
        example=0.0,
        option="--start-deg",
        by_joint="joints",
    )
    joints: dict[str, float] = setting(
        "The same for single joints [deg], which overrule it.", example=30.0
    )


TOLERANCE = (
    "Error of {} to accept, in {}; where the plan misses it, its requests are written all the "
    "same, and the exit status is 1."
)


class Tolerance(Settings):
    """Errors to accept."""

    deg: Positive | None = setting(
        TOLERANCE.format("any joint [deg]", "the plan's norm"),
        example=10.0,
        option="--tolerance-deg",
    )
    cm: Positive | None = setting(
        TOLERANCE.format("the foot [cm]", "the plan's norm"),
        example=1.0,
        set_to=1.0,
        option="--tolerance-cm",
    )


class Output(Settings):
    """Files beside results.json, inside the folder; "" leaves a file out."""

    requests: WrittenOrNone = setting("The requests.", default="requests.csv")
    angles: WrittenOrNone = setting("The angles that the models predict.", default="angles.csv")
    desired: WrittenOrNone = setting("The desired angles.", default="desired.csv")
    foot: WrittenOrNone = setting(
        "The positions of the foot at the predicted angles.", default="foot.csv"
    )
    report: WrittenOrNone = setting(
        "A page about the plan, with pictures, such as report.html.",
        default="",
        set_to="report.html",
    )


ROS = ("yaml", "bag", "mcap")
"""Formats that hold a JointTrajectory."""


class Export(Settings):
    """Requests for robots, as request-planner export writes them; a table for each file."""

    format: Literal["csv", "yaml", "bag", "mcap", "lerobot"] = option(
        "What to write; yaml, bag, mcap and lerobot need their extras.", example="csv", set_to="csv"
    )
    file: Written = setting(
        "Where, inside the folder; bag, mcap and lerobot are folders themselves.",
        example="controller.csv",
        set_to="controller.csv",
    )
    cycles: Count = option("How often to go through the requests.", default=1)
    rate_hz: Positive | None = option(
        "Rows per second.", otherwise="one row per request", example=125.0
    )
    between: Literal["hold", "linear"] | None = option(
        "Where rate_hz adds rows: hold each request, or go to the next in a straight line.",
        implied="hold",
    )
    joint_names: JointNames | None = option(
        "The joints' names on the robot, in the order of the columns.",
        otherwise="those of the path",
        example=["lf_1", "lf_2", "lf_3"],
    )
    unit: Literal["rad", "deg", "ticks", "us"] | None = option(
        "csv: unit of the columns; us are the pulses of hobby servos.", only=("csv",), implied="rad"
    )
    ticks_per_turn: Annotated[int, within(ge=2, le=10**9 - 1)] | None = option(
        "csv in ticks or us: how many a turn has.",
        only=("csv",),
        otherwise="4096, or 4000 us",
        example=4096,
    )
    zero_tick: Tick | None = option(
        "csv in ticks or us: the count at angle 0.",
        only=("csv",),
        otherwise="2048, or 1500 us",
        example=2048,
        by_joint="zero_ticks",
    )
    zero_ticks: Annotated[dict[str, Tick] | None, Expected("a table of ticks by joint")] = setting(
        "csv in ticks or us: the same for single joints.", only=("csv",), example={"knee": 2048}
    )
    reverse: JointNames | None = option(
        "csv in ticks or us: joints whose servo is mounted the other way round.",
        only=("csv",),
        otherwise="none",
        example=["knee"],
    )
    lead_s: NotNegative | None = option(
        "yaml, bag, mcap: time in which the controller leads the joints to the first.",
        only=ROS,
        otherwise="0.0",
        example=2.0,
    )
    velocities: bool | None = option(
        "yaml, bag, mcap: whether points carry velocities, and become splines.",
        only=ROS,
        implied=False,
    )
    topic: Annotated[Text | None, Expected("the name of a topic")] = option(
        "bag, mcap: the topic.",
        only=("bag", "mcap"),
        implied="/joint_trajectory_controller/joint_trajectory",
    )
    task: Text | None = option(
        "lerobot: what the episode shows, in words.",
        only=("lerobot",),
        implied="follow the planned requests",
    )


class Replay(Settings):
    """How a recording is replayed, beside its speed, joints and rate in [path]."""

    track: Literal["state", "action"] = option(
        "What to follow: the recorded angles (state), or the recorded requests.", default="state"
    )
    begin_s: NotNegative | None = option(
        "Where to begin [s since the first row].", otherwise="the first row"
    )
    end_s: NotNegative | None = option(
        "Where to end [s since the first row].", otherwise="the last row"
    )
    fastest: bool = option(
        "Find the largest speed at which the largest error keeps --tolerance-deg or -cm, whatever "
        "--norm is.",
        default=False,
    )
    retime: Literal["constant", "varying"] = option(
        "With fastest: one factor for the whole recording, or one that varies along it, "
        "slower where errors are large.",
        default="constant",
    )
    urdf_joints: Annotated[dict[str, Text], Expected("a table of names by joint")] = setting(
        "With --urdf: what a joint of the recording is called there.",
        example={"Rotation": "shoulder_pan"},
        option="--urdf-joint",
    )
    write_as: ReplayFormat = setting(
        "What to write: csv has the columns and units of the recording, joints those of "
        "`plan`; lerobot, bag and mcap are folders.",
        default="csv",
        option="--as",
    )


class Run(Settings):
    """Where the results go."""

    out: Annotated[Text | None, Expected("the name of a folder")] = setting(
        "Folder of the results; --out overrules it.",
        otherwise="the name of this file without its ending",
        example="results",
    )
    leg: Leg = Leg()
    model: Model = Model()
    path: Path = Path()
    plan: Plan = Plan()
    limits: Limits = Limits()
    start: Start = Start()
    tolerance: Tolerance = Tolerance()
    output: Output = Output()
    export: tuple[Export, ...] = ()


class ReplayRun(Run):
    """A run of the command `replay`."""

    replay: Replay = Replay()


def _tried(about: str, *values: float, active: bool = False) -> Any:
    """A parameter, with example values, which a template sets if ``active``."""
    return setting(about, example=list(values), set_to=values if active else None)


class SweptParameters(Settings):
    """Values of the parameters to try, rising; cma tries any from the first to the last."""

    length: Values | None = _tried("Gait: half of the stroke [m].", 0.03, 0.04, 0.05, active=True)
    height: Values | None = _tried("Gait: how high the foot swings [m].", 0.02, 0.04)
    forward: Values | None = _tried("Gait: middle before the hip [m].", 0.03, 0.05)
    sideways: Values | None = _tried("Gait: outward of the hip [m].", 0.02, 0.03)
    hip_height: Values | None = _tried("Gait: hip above ground [m].", 0.07, 0.09)
    ground_fraction: Values | None = _tried(
        "Gait: part of the cycle on the ground.", 0.5, 0.6, 0.75
    )
    heading_deg: Values | None = _tried("Gait: direction, from x towards y [deg].", 0.0, 90.0)
    period_s: Values | None = _tried(
        "Gait: duration of a cycle [s], rounded to whole requests.", 0.5, 0.6, 0.7, 0.8, active=True
    )
    speed: Values | None = _tried(
        "A path of a file: how many times as fast to follow it.", 1.0, 1.5, 2.0
    )
    smoothness: Values | None = _tried("Any path: `smoothness` of [plan].", 0.0, 0.01, 0.1)


SWEPT = {
    **{name: f"path.half_ellipse.{name}" for name in SweptParameters.keys},
    "period_s": "path.half_ellipse.samples",
    "speed": "path.speed",
    "smoothness": "plan.smoothness",
}
"""The key of a run file that each parameter sets."""


class Search(Settings):
    """What is sought, and how: without a required error or speed, all of the Pareto front."""

    method: Literal["grid", "cma"] = setting(
        "All combinations of the values, or a search by CMA-ES (extra 'sweep') for two parameters "
        "or more.",
        default="grid",
    )
    steps: Count | None = setting(
        "Method grid: so many values of each parameter, evenly from its first to its last.",
        only=("grid",),
        otherwise="the values as they are",
        example=5,
    )
    evaluations: Annotated[int, within(ge=20, le=10**6)] | None = setting(
        "Method cma: how many plans.", only=("cma",), implied=200
    )
    seed: Annotated[int, within(ge=0, le=10**9)] | None = setting(
        "Method cma: of its random numbers.", only=("cma",), implied=0
    )
    at_error_cm: Positive | None = setting(
        "Seek the fastest with at most this error of the foot [cm].", example=1.0
    )
    at_error_deg: Positive | None = setting(
        "The same for a path of joints: error of the worst joint [deg].", example=2.0
    )
    at_speed_cm_s: Positive | None = setting(
        "Seek the least error of a gait of at least this speed [cm/s].", example=20.0
    )
    at_speed: Positive | None = setting(
        "The same for the path of a file: times its own speed.", example=1.5
    )
    parameters: SweptParameters = SweptParameters()


class Sweep(Run):
    """Where the results go. All tables but [sweep] are those of a run file."""

    sweep: Search = Search()
