"""All settings of a plan, its outputs and a sweep: type, unit, range, default and meaning."""

import math
from typing import Annotated, Any, Literal

from planner.cli.declared import (
    Count,
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
)
from planner.files.text import Expected, Kind, within

FROM_LOG, FROM_URDF, SHIPPED_MODEL = "from-log", "urdf", "ers210a"
"""Models without a file: those that `replay` identifies from the recordings themselves, those with
the top speeds of the leg's description and assumed other parameters, and Table 1 of the paper."""

Frame = Annotated[Text, Expected("the name of a frame")]
Angles = Annotated[dict[str, float], Expected("a table of angles by joint")]
JointNames = Annotated[tuple[Text, ...], Expected("a list of names of joints")]
Weights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], Expected("a list of three numbers, 0 or more")
]
Tick = Annotated[int, within(ge=1 - 10**9, le=10**9 - 1)]
Length = Annotated[float, within(gt=0.0, le=2.0, words="a number above 0, up to 2, in metres")]
Height = Annotated[float, within(ge=0.0, le=2.0, words="a number from 0 to 2, in metres")]
Period = Annotated[float, within(gt=0.0, le=1e3, words="a number above 0, up to 1000")]
Fraction = Annotated[float, within(gt=0.0, lt=1.0)]
Share = Annotated[float, within(ge=0.0, le=1.0, words="a number from 0 to 1, 0.05 for 5 %")]
Seed = Annotated[int, within(ge=0, le=10**9)]
Samples = Annotated[int, within(ge=4, le=10**6)]

LEG_NAMES = ("reference", "front-left", "front-right", "hind-left", "hind-right")
"""The legs that need no description."""


def _is_leg(name: str) -> str:
    if not (name in LEG_NAMES or name.lower().endswith((".urdf", ".xml")) or "/" in name):
        raise ValueError
    return name


LegName = Annotated[
    Text, Expected(f"one of {', '.join(LEG_NAMES)}, or a .urdf file", _is_leg, LEG_NAMES)
]


def _is_topic(name: str) -> str:
    if not name.strip("/") or any(map(str.isspace, name)):
        raise ValueError(", such as /joint_trajectory")
    return name


Method = Literal["shift", "closed-form", "optimal", "foot-optimal"]
Load = Literal["urdf", "urdf-dynamics", "column"]
ReplayFormat = Literal["csv", "joints", "lerobot", "yaml", "bag", "mcap"]


class Leg(Settings):
    """The leg that follows a foot path; with a path of joints it gives their limits.

    Attributes:
        name: A shipped leg, or the URDF of your own robot, with base and foot. Positions are in the
            base's frame: of a shipped leg the body's, and for 'reference' the hip's.
        base: With a URDF: the frame of the foot positions.
        foot: With a URDF: the frame of the foot.
        lock: With a URDF: joints to hold, and where [deg], so that three remain.
        lock_m: With a URDF: the same for joints that slide [m].
        near: Initial pose [deg]: the nearest solution of the inverse kinematics is taken.
        unreachable: Positions out of reach: stop and list them, take the nearest, or clamp each
            joint as the reference walk does.
    """

    name: LegName | None = setting(
        example="front-left", set_to="reference", option="--leg", form="NAME|URDF"
    )
    base: Frame | None = option(example="base_link", form="FRAME")
    foot: Frame | None = option(example="lf_foot", form="FRAME")
    lock: Angles | None = option(example={"wrist": -90.0})
    lock_m: Annotated[dict[str, float] | None, Expected("a table of positions by joint")] = option(
        example={"slide": 0.1}, form="JOINT=M"
    )
    near: Angles | None = option(example={"wrist": -90.0})
    unreachable: Literal["raise", "nearest", "clamp"] = option(default="raise", set_to="clamp")


class Model(Settings):
    """How the joints answer.

    Attributes:
        file: A model file as identify writes it; 'ers210a' is Table 1 of the paper, 'urdf' assumes
            the same servos with the top speeds of the leg's description.
    """

    file: Annotated[Source, Expected(f"a model file, {SHIPPED_MODEL} or {FROM_URDF}")] = setting(
        default=SHIPPED_MODEL, option="--model"
    )


class HalfEllipse(Settings):
    """The foot path of a walk in the hip's frame, for which [path] has no file.

    Attributes:
        samples: Samples in a cycle.
        length: Half of the stroke [m].
        height: How high the foot swings [m].
        forward: Middle before the hip [m].
        sideways: Outward of the hip [m].
        hip_height: Hip above ground [m].
        ground_fraction: Part of the cycle on the ground.
        heading_deg: Direction of the walk, from x towards y [deg]: 90 along y, 180 backward.
        for_leg: Whether to size and place it for the leg, in the frame of its base, as gait --leg
            does: lengths that are not set here are then the leg's own.
    """

    samples: Samples = option(default=88)
    length: Length = setting(default=0.04893, option="--half-stroke")
    height: Height = option(default=0.042)
    forward: float = option(default=0.049)
    sideways: float = option(default=0.028)
    hip_height: float = option(default=0.077)
    ground_fraction: Fraction = option(default=0.5)
    heading_deg: float = option(default=0.0)
    for_leg: bool = setting(default=False)

    def arguments(self, *, given_only: bool = False) -> dict[str, Any]:
        """The arguments of :func:`planner.half_ellipse`, with or without the defaults."""
        names = (self.keys_set if given_only else self.keys.keys()) - {"heading_deg", "for_leg"}
        return {
            "heading": math.radians(self.heading_deg),
            **{name: getattr(self, name) for name in names},
        }


class Path(Settings):
    """The path of the joints or of the foot: a file, or else a half ellipse.

    Attributes:
        file: A CSV of joints (<joint>_deg, _rad) or of a foot (x_m, y_m, z_m; _cm, _mm).
        joints: With a file of joints: those to use, in this order.
        rate_hz: Requests per second: a file with t_s is resampled to it, and the models take it.
        speed: How many times as fast to follow the path: with fewer samples, on its straight lines,
            or more.
    """

    file: Source | None = setting(example="path.csv")
    joints: JointNames = setting(default=(), otherwise="every column", option="--joint")
    rate_hz: Positive | None = option(otherwise="the models' own", example=50.0)
    speed: Positive | None = option(otherwise="as it is", example=1.5, form="FACTOR")
    half_ellipse: HalfEllipse | None = setting(set_to=HalfEllipse())


OPTIMISED = ("optimal", "foot-optimal")  # methods that optimise


class Plan(Settings):
    """How the requests are planned.

    Attributes:
        method: The desired angles, the best time early; the paper's inversion; or requests
            optimised joint by joint, or all at once for the foot.
        cyclic: Whether the path repeats for ever, or starts from rest.
        load: Torque on the joints: gravity by the masses of the leg's URDF, all of its dynamics, or
            columns <joint>_load_Nm of the path.
        norm: The error to make small.
        solver: Our own solver, or IPOPT with the same problem.
        max_step_deg: Largest change from one request to the next
            [deg, or percent of the range].
        max_request_speed_deg_s: The same as a speed, the largest change of the requests [deg/s].
        smoothness: Share by which smoother requests may raise the
            error that the robot would show, of plan and model together (an encoder's step of 0.088
            degrees at least); 0 for none.
        robust: Plan for models drawn from the intervals of the
            model file, too, and make the mean or the worst of their errors small.
        weights: How much each axis counts, x, y, z.
        segments: Lines of the approximation.
        rule: How a line is inverted.
    """

    method: Method = option(default="optimal", set_to="foot-optimal")
    cyclic: bool | None = setting(
        otherwise="yes, unless its ends are far apart", example=True, option="--cyclic/--no-cyclic"
    )
    load: Load | None = option(otherwise="none", example="urdf")
    norm: Literal["rms", "max"] = option(only=("shift", *OPTIMISED), default="rms")
    solver: Literal["gauss-newton", "ipopt"] = option(only=("optimal",), default="gauss-newton")
    max_step_deg: Positive | None = option(only=OPTIMISED, otherwise="none", example=5.0)
    max_request_speed_deg_s: Positive | None = option(
        only=OPTIMISED, otherwise="none", example=600.0, form="DEG/S"
    )
    smoothness: Share = option(only=OPTIMISED, default=0.005, form="SHARE")
    robust: Literal["mean", "worst"] | None = option(
        only=OPTIMISED, otherwise="the model alone", example="worst"
    )
    weights: Weights = option(only=("foot-optimal",), default=(1.0, 1.0, 1.0), form="X Y Z")
    segments: Count | None = option(
        only=("closed-form",), otherwise="as many as reduce the error", example=6
    )
    rule: Literal["paper", "exact"] = option(only=("closed-form",), default="paper")


SEARCH = ("norm", "smoothness", "robust")
"""The keys of :class:`Plan` that are arguments of :func:`planner.plan`, too."""

SMOOTHING = "max_step_deg max_request_speed_deg_s smoothness"
"""The keys of :class:`Plan` that say how smooth the requests are."""


class Limits(Settings):
    """Ranges of the requests; those of the leg hold where there are none.

    Attributes:
        deg: Smallest and largest request [deg, or percent of the range] of every joint, or of one.
        joints: The same for single joints [deg], which overrule it.
    """

    deg: Span | None = setting(
        otherwise="those of the leg, if there is one",
        example=[-120.0, 150.0],
        option="--limits-deg",
        by_joint="joints",
    )
    joints: dict[str, Span] = setting(example=[-27.0, 147.0])


class Start(Settings):
    """With plan.cyclic = false and method optimal: where the joints rest before.

    Attributes:
        deg: Angle at which every joint rests before a path that does not repeat, from the same zero
            as the path [deg, or percent of the range].
        joints: The same for single joints [deg], which overrule it.
    """

    deg: float | None = setting(
        otherwise="where the path begins", example=0, option="--start-deg", by_joint="joints"
    )
    joints: dict[str, float] = setting(example=30.0)


class Tolerance(Settings):
    """Errors to accept.

    Attributes:
        deg: Error of any joint to accept [deg, or percent of the range], in the plan's norm; where
            the plan misses it, its requests are written all the same, and the exit status is 1.
        cm: Error of the foot [cm] to accept, in the plan's norm; where the plan misses it, its
            requests are written all the same, and the exit status is 1.
    """

    deg: Positive | None = setting(example=10.0, option="--tolerance-deg")
    cm: Positive | None = setting(example=1.0, set_to=1.0, option="--tolerance-cm")


class Output(Settings):
    """Files beside results.json, inside the folder; "" leaves a file out.

    Attributes:
        requests: The requests.
        angles: The angles that the models predict.
        desired: The desired angles.
        foot: The positions of the foot at the predicted angles.
        report: A page about the plan, with pictures, such as report.html.
    """

    requests: WrittenOrNone = setting(default="requests.csv")
    angles: WrittenOrNone = setting(default="angles.csv")
    desired: WrittenOrNone = setting(default="desired.csv")
    foot: WrittenOrNone = setting(default="foot.csv")
    report: WrittenOrNone = setting(default="", set_to="report.html")


ROS = ("yaml", "bag", "mcap")  # formats that hold a JointTrajectory


class Export(Settings):
    """Requests for robots, as request-planner export writes them; a table for each file.

    Attributes:
        format: What to write; yaml, bag, mcap and lerobot need their extras.
        file: Where, inside the folder; bag, mcap and lerobot are folders themselves.
        cycles: How often to go through the requests.
        rate_hz: Rows per second; each request is held until the next.
        joint_names: The joints' names on the robot, in the order of the columns.
        unit: Unit of the columns; us are the pulses of hobby servos.
        ticks_per_turn: In ticks or us, how many a turn has.
        zero_tick: In ticks or us, the count at angle 0.
        zero_ticks: In ticks or us, the same for single joints.
        reverse: In ticks or us, joints whose servo is mounted the other way round.
        lead_s: Time in which the controller leads the joints to the first.
        topic: The topic.
        task: What the episode shows, in words.
    """

    format: Literal["csv", "yaml", "bag", "mcap", "lerobot"] = option(example="csv", set_to="csv")
    file: Written = setting(example="controller.csv", set_to="controller.csv")
    cycles: Count = option(default=1)
    rate_hz: Positive | None = option(otherwise="one row per request", example=125.0)
    joint_names: JointNames | None = option(
        otherwise="those of the path", example=["lf_1", "lf_2", "lf_3"], form="A,B,C"
    )
    unit: Literal["rad", "deg", "ticks", "us"] = option(only=("csv",), default="rad")
    ticks_per_turn: Annotated[int, within(ge=2, le=10**9 - 1)] | None = option(
        only=("csv",), otherwise="4096, or 4000 us", example=4096
    )
    zero_tick: Tick | None = option(
        only=("csv",), otherwise="2048, or 1500 us", example=2048, by_joint="zero_ticks"
    )
    zero_ticks: Annotated[dict[str, Tick] | None, Expected("a table of ticks by joint")] = setting(
        only=("csv",), example={"knee": 2048}
    )
    reverse: JointNames | None = option(only=("csv",), otherwise="none", example=["knee"])
    lead_s: NotNegative = option(only=ROS, default=0.0, example=2.0)
    topic: Annotated[Text, Expected("the name of a topic", _is_topic)] = option(
        only=("bag", "mcap"), default="/joint_trajectory_controller/joint_trajectory"
    )
    task: Text = option(only=("lerobot",), default="follow the planned requests")


class Replay(Settings):
    """How a recording is replayed, beside its speed, joints and rate in [path].

    Attributes:
        track: What to follow: the recorded angles (state), or the recorded requests.
        begin_s: Where to begin [s since the first row].
        end_s: Where to end [s since the first row].
        fastest: Find the largest speed at which the largest error keeps --tolerance-deg or -cm,
            whatever --norm is.
        retime: With fastest: one factor for the whole recording, or one that varies along it,
            slower where errors are large.
        urdf_joints: With a URDF: what a joint of the recording is called there.
        write_as: What to write: csv has the columns and units of the recording, joints those of
            `plan`; lerobot, bag and mcap are folders.
    """

    track: Literal["state", "action"] = option(default="state")
    begin_s: NotNegative | None = option(otherwise="the first row")
    end_s: NotNegative | None = option(otherwise="the last row")
    fastest: bool = option(default=False)
    retime: Literal["constant", "varying"] = option(default="constant")
    urdf_joints: Annotated[dict[str, Text], Expected("a table of names by joint")] = setting(
        example={"Rotation": "shoulder_pan"}, option="--urdf-joint"
    )
    write_as: ReplayFormat = setting(default="csv", option="--as")


class Run(Settings):
    """Where the results go.

    Attributes:
        out: Folder of the results; --out overrules it.
    """

    out: Annotated[Text | None, Expected("the name of a folder")] = setting(
        otherwise="the name of this file without its ending", example="results"
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


def _each(annotation: Any) -> Expected:
    """Rising values, each of the kind of an annotation."""
    kind = Kind(annotation)
    words = f"a list of rising numbers, each {kind.expected}"
    return Expected(words, lambda values: tuple(map(kind.fitted, values)))


def _tried(*values: float, active: bool = False) -> Any:
    """A parameter, with example values, which a template sets if ``active``."""
    return setting(example=list(values), set_to=values if active else None)


class SweptParameters(Settings):
    """Values of the parameters to try, rising; cma tries any from the first to the last.

    Attributes:
        length: Gait: half of the stroke [m].
        height: Gait: how high the foot swings [m].
        forward: Gait: middle before the hip [m].
        sideways: Gait: outward of the hip [m].
        hip_height: Gait: hip above ground [m].
        ground_fraction: Gait: part of the cycle on the ground.
        heading_deg: Gait: direction, from x towards y [deg].
        period_s: Gait: duration of a cycle [s], rounded to whole requests.
        speed: A path of a file: how many times as fast to follow it.
        smoothness: Any path: `smoothness` of [plan].
    """

    length: Annotated[Values, _each(Length)] | None = _tried(0.03, 0.04, 0.05, active=True)
    height: Annotated[Values, _each(Height)] | None = _tried(0.02, 0.04)
    forward: Values | None = _tried(0.03, 0.05)
    sideways: Values | None = _tried(0.02, 0.03)
    hip_height: Values | None = _tried(0.07, 0.09)
    ground_fraction: Annotated[Values, _each(Fraction)] | None = _tried(0.5, 0.6, 0.75)
    heading_deg: Values | None = _tried(0.0, 90.0)
    period_s: Annotated[Values, _each(Period)] | None = _tried(0.5, 0.6, 0.7, 0.8, active=True)
    speed: Annotated[Values, _each(Positive)] | None = _tried(1.0, 1.5, 2.0)
    smoothness: Annotated[Values, _each(Share)] | None = _tried(0.0, 0.01, 0.1)


SWEPT = {
    **{name: f"path.half_ellipse.{name}" for name in SweptParameters.keys},
    "period_s": "path.half_ellipse.samples",
    "speed": "path.speed",
    "smoothness": "plan.smoothness",
}
"""The key of a run file that each parameter sets."""


class Search(Settings):
    """What is sought, and how: without a required error or speed, all of the Pareto front.

    Attributes:
        method: All combinations of the values, or a search by CMA-ES (extra 'sweep') for two
            parameters or more.
        evaluations: How many plans.
        seed: Of its random numbers.
        at_error_cm: Seek the fastest with at most this error of the foot [cm].
        at_error_deg: The same for a path of joints: error of the worst joint [deg, or percent of
            its range].
        at_speed_cm_s: Seek the least error of a gait of at least this speed [cm/s].
        at_speed: The same for the path of a file: times its own speed.
    """

    method: Literal["grid", "cma"] = setting(default="grid")
    evaluations: Annotated[int, within(ge=20, le=10**6)] = setting(only=("cma",), default=200)
    seed: Seed = setting(only=("cma",), default=0)
    at_error_cm: Positive | None = setting(example=1.0)
    at_error_deg: Positive | None = setting(example=2.0)
    at_speed_cm_s: Positive | None = setting(example=20.0)
    at_speed: Positive | None = setting(example=1.5)
    parameters: SweptParameters = SweptParameters()


class Sweep(Run):
    """Where the results go. All tables but [sweep] are those of a run file."""

    sweep: Search = Search()
