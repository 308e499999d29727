"""Every setting of a plan and its outputs: type, unit, range, default and meaning, in one place."""

import math
from dataclasses import field
from typing import Annotated, Any, Literal

from planner.run.kinds import (
    Count,
    Expected,
    FromList,
    NotNegative,
    Positive,
    Range,
    Source,
    Span,
    Text,
    Written,
    WrittenOrNone,
)
from planner.run.schema import About, Settings

FROM_LOG = "from-log"
"""The models that `replay` identifies from the recordings themselves."""

SHIPPED_MODEL = "ers210a"
"""The model that needs no file: Table 1 of the paper."""

FROM_URDF = "urdf"
"""The models of servos of which no more than the top speed is known, from the leg's description."""

Frame = Annotated[Text, Expected("the name of a frame")]
Angles = Annotated[dict[str, float], Expected("a table of angles by joint")]
JointNames = Annotated[tuple[Text, ...], FromList(), Expected("a list of names of joints")]
Weights = Annotated[
    tuple[NotNegative, NotNegative, NotNegative],
    FromList(),
    Expected("a list of three numbers, 0 or more"),
]
Tick = Annotated[int, Range(ge=1 - 10**9, le=10**9 - 1)]
TicksPerTurn = Annotated[int, Range(ge=2, le=10**9 - 1)]
Samples = Annotated[int, Range(ge=4, le=10**6)]

ShippedLeg = Literal["reference", "front-left", "front-right", "hind-left", "hind-right"]
Unreachable = Literal["raise", "nearest", "clamp"]
Method = Literal["shift", "closed-form", "optimal", "foot-optimal"]
Norm = Literal["rms", "max"]
Solver = Literal["gauss-newton", "ipopt"]
Rule = Literal["paper", "exact"]
Robust = Literal["mean", "worst"]
Load = Literal["urdf", "urdf-dynamics", "column"]
Level = Literal["slope", "envelope", "exact"]
Format = Literal["csv", "yaml", "bag", "mcap", "lerobot"]
Track = Literal["state", "action"]
Retime = Literal["constant", "varying"]
ReplayFormat = Literal["csv", "joints", "lerobot", "yaml", "bag", "mcap"]


class Leg(Settings):
    """The leg that follows a foot path; with a path of joints it gives their limits."""

    name: Annotated[
        ShippedLeg | None,
        About(
            help="A shipped leg: paths are in the body's frame, for 'reference' in the hip's.",
            example="front-left",
            set_to="reference",
        ),
    ] = None
    urdf: Annotated[
        Source | None,
        About(help="The description of your own robot, in place of name.", example="robot.urdf"),
    ] = None
    base: Annotated[
        Frame | None,
        About(help="With a URDF: the frame of the foot positions.", example="base_link"),
    ] = None
    foot: Annotated[
        Frame | None, About(help="With a URDF: the frame of the foot.", example="lf_foot")
    ] = None
    lock: Annotated[
        Angles | None,
        About(
            help="With a URDF: joints to hold, and where [deg], so that three remain.",
            example={"wrist": -90.0},
        ),
    ] = None
    lock_m: Annotated[
        dict[str, float] | None,
        Expected("a table of positions by joint"),
        About(help="With a URDF: the same for joints that slide [m].", example={"slide": 0.1}),
    ] = None
    near: Annotated[
        Angles | None,
        About(
            help="A pose near which to start [deg], of several that reach the first point.",
            example={"knee": 30.0},
        ),
    ] = None
    unreachable: Annotated[
        Unreachable,
        About(
            help="Positions out of reach: stop and list them, take the nearest, or clamp each "
            "joint as the reference walk does.",
            set_to="clamp",
        ),
    ] = "raise"


TopSpeed = Annotated[float, About(help="Top speed [rad/s].", example=5.4542)]
FullSpeedError = Annotated[
    float, About(help="Error from which on the joint moves at top speed [rad].", example=0.1222)
]
Lag = Annotated[float, About(help="Time before a request has any effect [s].", example=0.032)]
AccelerationTime = Annotated[
    float, About(help="Time over which a request takes effect [s].", example=0.048)
]
TickTime = Annotated[float, About(help="Time step of the model [s].", example=0.008)]
Hold = Annotated[Count, About(help="Ticks for which a request is held.", example=1)]
Offset = Annotated[float, About(help="Static sag [rad].", example=0.0)]
DeadBand = Annotated[
    float, About(help="Error that dry friction holds, without any motion [rad].", example=0.0)
]
SpeedOffset = Annotated[
    float,
    About(help="Top speed upwards less v_max, and v_max less downwards [rad/s].", example=0.0),
]
Compliance = Annotated[float, About(help="Sag by a torque on the joint [rad/(N m)].", example=0.0)]
SpeedPerTorque = Annotated[
    float, About(help="Change of the top speeds by that torque [rad/(s N m)].", example=0.0)
]
TimeConstant = Annotated[
    float, About(help="Time constant of the speed, a motor's inertia [s].", example=0.0)
]
MaxAcceleration = Annotated[
    float, About(help="Largest acceleration [rad/s^2]; inf where there is no limit.", example=300.0)
]

SagBySine = Annotated[
    float,
    About(
        help="Sag by the sine of the joint's angle [rad]: gravity where no torque is known.",
        example=0.0,
    ),
]
SagByCosine = Annotated[
    float, About(help="Sag by the cosine of the joint's angle [rad].", example=0.0)
]


class Parameters(Settings):
    """In place of model.file: the parameters of all joints."""

    v_max: TopSpeed
    theta_0: FullSpeedError
    lag: Lag
    acceleration_time: AccelerationTime
    tick: TickTime = 0.008
    hold: Hold = 1
    offset: Offset = 0.0
    dead_band: DeadBand = 0.0
    v_offset: SpeedOffset = 0.0
    compliance: Compliance = 0.0
    speed_per_torque: SpeedPerTorque = 0.0
    time_constant: TimeConstant = 0.0
    max_acceleration: MaxAcceleration = math.inf
    sag_sin: SagBySine = 0.0
    sag_cos: SagByCosine = 0.0


class OfJoint(Settings):
    """A joint that is unlike the others: its own file, or the parameters that differ."""

    file: Annotated[
        Source | None,
        About(
            help="A model file for this joint alone, in place of parameters.", example="knee.toml"
        ),
    ] = None
    v_max: TopSpeed | None = None
    theta_0: FullSpeedError | None = None
    lag: Lag | None = None
    acceleration_time: AccelerationTime | None = None
    tick: TickTime | None = None
    hold: Hold | None = None
    offset: Offset | None = None
    dead_band: DeadBand | None = None
    v_offset: SpeedOffset | None = None
    compliance: Compliance | None = None
    speed_per_torque: SpeedPerTorque | None = None
    time_constant: TimeConstant | None = None
    max_acceleration: MaxAcceleration | None = None
    sag_sin: SagBySine | None = None
    sag_cos: SagByCosine | None = None


class Model(Settings):
    """How the joints answer."""

    file: Annotated[
        Source,
        Expected(f"a model file, {SHIPPED_MODEL} or {FROM_URDF}"),
        About(
            help=f"A model file as identify writes it; '{SHIPPED_MODEL}' is Table 1 of the paper, "
            f"'{FROM_URDF}' assumes the same servos with the top speeds of the leg's description.",
        ),
    ] = SHIPPED_MODEL
    parameters: Parameters | None = None
    joints: dict[str, OfJoint] = field(default_factory=dict)


class HalfEllipse(Settings):
    """The foot path of a walk in the hip's frame, for which [path] has no file."""

    samples: Annotated[Samples, About(help="Samples in a cycle.")] = 88
    length: Annotated[Positive, About(help="Half of the stroke [m].")] = 0.04893
    height: Annotated[NotNegative, About(help="How high the foot swings [m].")] = 0.042
    forward: Annotated[float, About(help="Middle before the hip [m].")] = 0.049
    sideways: Annotated[float, About(help="Outward of the hip [m].")] = 0.028
    hip_height: Annotated[float, About(help="Hip above ground [m].")] = 0.077
    ground_fraction: Annotated[
        float, Range(gt=0.0, lt=1.0), About(help="Part of the cycle on the ground.")
    ] = 0.5
    heading_deg: Annotated[
        float,
        About(help="Direction of the walk, from x towards y [deg]: 90 along y, 180 backward."),
    ] = 0.0
    for_leg: Annotated[
        bool,
        About(
            help="Whether to size and place it for the leg, in the frame of its base, as gait "
            "--leg does: lengths that are not set here are then the leg's own."
        ),
    ] = False

    def arguments(self, *, given_only: bool = False) -> dict[str, Any]:
        """The arguments of :func:`planner.half_ellipse`, with or without the defaults."""
        values = self.values()
        names = (self.keys_set if given_only else values.keys()) - {"heading_deg", "for_leg"}
        arguments = {name: value for name, value in values.items() if name in names}
        return {**arguments, "heading": math.radians(self.heading_deg)}


class Path(Settings):
    """The path of the joints or of the foot: a file, or else a half ellipse."""

    file: Annotated[
        Source | None,
        About(
            help="A CSV of joints (<joint>_deg, _rad) or of a foot (x_m, y_m, z_m; _cm, _mm).",
            example="path.csv",
        ),
    ] = None
    joints: Annotated[
        JointNames,
        About(help="With a file of joints: those to use, in this order; [] is every column."),
    ] = ()
    rate_hz: Annotated[
        Positive | None,
        About(
            help="Requests per second: a file with t_s is resampled to it, and the models take it.",
            example=50.0,
            otherwise="the models' own",
        ),
    ] = None
    speed: Annotated[
        Positive | None,
        About(
            help="How many times as fast to follow the path: with fewer samples, on its straight "
            "lines, or more.",
            otherwise="as it is",
            example=1.5,
        ),
    ] = None
    half_ellipse: Annotated[HalfEllipse | None, About(set_to=HalfEllipse())] = None


class Plan(Settings):
    """How the requests are planned."""

    method: Annotated[
        Method,
        About(
            help="The desired angles, the best time early; the paper's inversion; or requests "
            "optimised joint by joint, or all at once for the foot.",
            set_to="foot-optimal",
        ),
    ] = "optimal"
    cyclic: Annotated[
        bool | None,
        About(
            help="Whether the path repeats for ever, or starts from rest.",
            otherwise="yes, unless its ends are far apart",
            example=True,
        ),
    ] = None
    load: Annotated[
        Load | None,
        About(
            help="Torque on the joints: gravity by the masses of the leg's URDF, all of its "
            "dynamics, or columns <joint>_load_Nm of the path.",
            otherwise="none",
            example="urdf",
        ),
    ] = None
    norm: Annotated[
        Norm | None,
        About(
            help="Methods optimal and foot-optimal: the error to make small.",
            otherwise='"rms"',
            example="rms",
        ),
    ] = None
    solver: Annotated[
        Solver | None,
        About(
            help="Method optimal: our own solver, or IPOPT with the same problem.",
            otherwise='"gauss-newton"',
            example="gauss-newton",
        ),
    ] = None
    max_step_deg: Annotated[
        Positive | None,
        About(
            help="Methods optimal and foot-optimal: largest change from one request to the next "
            "[deg].",
            otherwise="none",
            example=5.0,
        ),
    ] = None
    max_request_speed_deg_s: Annotated[
        Positive | None,
        About(
            help="The same as a speed: largest change of the requests [deg/s].",
            otherwise="none",
            example=600.0,
        ),
    ] = None
    smoothness: Annotated[
        NotNegative | None,
        About(
            help="Methods optimal and foot-optimal: share by which smoother requests may raise the "
            "error that the robot would show, of plan and model together (an encoder's step of "
            "0.088 degrees at least); 0 for none.",
            otherwise="0.005",
            example=0.005,
        ),
    ] = None
    robust: Annotated[
        Robust | None,
        About(
            help="Methods optimal and foot-optimal: plan for models drawn from the intervals of "
            "the model file, too, and make the mean or the worst of their errors small.",
            otherwise="the model alone",
            example="worst",
        ),
    ] = None
    weights: Annotated[
        Weights | None,
        About(
            help="Method foot-optimal: how much each axis counts, x, y, z.",
            otherwise="[1.0, 1.0, 1.0]",
            example=[1.0, 1.0, 1.0],
        ),
    ] = None
    segments: Annotated[
        Count | None,
        About(
            help="Method closed-form: lines of the approximation.",
            otherwise="as many as reduce the error",
            example=6,
        ),
    ] = None
    rule: Annotated[
        Rule | None,
        About(
            help="Method closed-form: how a line is inverted.", otherwise='"paper"', example="paper"
        ),
    ] = None


class Limits(Settings):
    """Ranges of the requests; those of the leg hold where there are none."""

    deg: Annotated[
        Span | None,
        About(
            help="Smallest and largest request of every joint [deg].",
            otherwise="those of the leg, if there is one",
            example=[-120.0, 150.0],
        ),
    ] = None
    joints: Annotated[
        dict[str, Span],
        About(
            help="The same for single joints [deg], which overrule it.",
            example=[-27.0, 147.0],
        ),
    ] = field(default_factory=dict)


class Start(Settings):
    """With plan.cyclic = false and method optimal: where the joints rest before."""

    deg: Annotated[
        float | None,
        About(
            help="Angle of every joint [deg], from the same zero as the path.",
            otherwise="where the path begins",
            example=0.0,
        ),
    ] = None
    joints: Annotated[
        dict[str, float],
        About(help="The same for single joints [deg], which overrule it.", example=30.0),
    ] = field(default_factory=dict)


class Tolerance(Settings):
    """Errors to accept; a plan that misses them is written, and the exit status is 1."""

    deg: Annotated[
        Positive | None,
        About(
            help="Error of any joint to accept [deg], in the plan's norm; not with method "
            "foot-optimal.",
            example=10.0,
        ),
    ] = None
    cm: Annotated[
        Positive | None,
        About(
            help="Error of the foot to accept [cm], in the plan's norm.", example=1.0, set_to=1.0
        ),
    ] = None


class Output(Settings):
    """Files beside results.json, inside the folder; "" leaves a file out."""

    requests: Annotated[WrittenOrNone, About(help="The requests.")] = "requests.csv"
    angles: Annotated[WrittenOrNone, About(help="The angles that the models predict.")] = (
        "angles.csv"
    )
    desired: Annotated[WrittenOrNone, About(help="The desired angles.")] = "desired.csv"
    foot: Annotated[
        WrittenOrNone, About(help="The positions of the foot at the predicted angles.")
    ] = "foot.csv"
    report: Annotated[
        WrittenOrNone,
        About(
            help="A page about the plan, with pictures, such as report.html.",
            set_to="report.html",
        ),
    ] = ""
    comparison: Annotated[
        bool,
        About(
            help="Whether to compare both inversions, as compare does: "
            "comparison.json, .svg and .png."
        ),
    ] = False
    level: Annotated[
        Level | None,
        About(
            help="With comparison: the sharpest bound to compute; exact takes seconds to a minute.",
            otherwise='"envelope"',
            example="envelope",
        ),
    ] = None
    scene: Annotated[
        WrittenOrNone,
        About(help="A page with the robot moving, such as scene.html (extra 'meshcat')."),
    ] = ""


class Export(Settings):
    """Requests for robots, as request-planner export writes them; a table for each file."""

    format: Annotated[
        Format,
        About(
            help="What to write; yaml, bag, mcap and lerobot need their extras.",
            example="csv",
            set_to="csv",
        ),
    ]
    file: Annotated[
        Written,
        About(
            help="Where, inside the folder; bag, mcap and lerobot are folders themselves.",
            example="controller.csv",
            set_to="controller.csv",
        ),
    ]
    cycles: Annotated[Count, About(help="How often to go through the requests.")] = 1
    rate_hz: Annotated[
        Positive | None,
        About(help="Rows per second.", otherwise="one row per request", example=125.0),
    ] = None
    between: Annotated[
        Literal["hold", "linear"] | None,
        About(
            help="With rate_hz: hold each request, or go to the next in a straight line.",
            otherwise='"hold"',
            example="hold",
        ),
    ] = None
    joint_names: Annotated[
        JointNames | None,
        About(
            help="The joints' names on the robot, in the order of the columns.",
            otherwise="those of the path",
            example=["lf_1", "lf_2", "lf_3"],
        ),
    ] = None
    unit: Annotated[
        Literal["rad", "deg", "ticks"] | None,
        About(help="csv: unit of the columns.", otherwise='"rad"', example="rad"),
    ] = None
    ticks_per_turn: Annotated[
        TicksPerTurn | None,
        About(help="csv in ticks: ticks of a turn.", otherwise="4096", example=4096),
    ] = None
    zero_tick: Annotated[
        Tick | None,
        About(help="csv in ticks: the tick at angle 0.", otherwise="2048", example=2048),
    ] = None
    zero_ticks: Annotated[
        dict[str, Tick] | None,
        Expected("a table of ticks by joint"),
        About(help="csv in ticks: the same for single joints.", example={"knee": 2048}),
    ] = None
    lead_s: Annotated[
        NotNegative | None,
        About(
            help="yaml, bag, mcap: time in which the controller leads the joints to the first.",
            otherwise="0.0",
            example=2.0,
        ),
    ] = None
    velocities: Annotated[
        bool | None,
        About(
            help="yaml, bag, mcap: whether points carry velocities, and become splines.",
            otherwise="false",
            example=False,
        ),
    ] = None
    topic: Annotated[
        Text | None,
        Expected("the name of a topic"),
        About(
            help="bag, mcap: the topic.",
            otherwise='"/joint_trajectory_controller/joint_trajectory"',
            example="/joint_trajectory_controller/joint_trajectory",
        ),
    ] = None
    task: Annotated[
        Text | None,
        About(
            help="lerobot: what the episode shows, in words.",
            otherwise='"follow the planned requests"',
            example="follow the planned requests",
        ),
    ] = None


class Replay(Settings):
    """How a recording is replayed; the command `replay` alone has these settings."""

    track: Annotated[
        Track,
        About(help="What to follow: the recorded angles (state), or the recorded requests."),
    ] = "state"
    speed: Annotated[Positive, About(help="How many times faster than it was recorded.")] = 1.0
    joints: Annotated[
        JointNames,
        About(
            help="The joints to plan; the others get their recorded requests.",
            otherwise="all that have a model, but no grippers",
        ),
    ] = ()
    begin_s: Annotated[
        NotNegative | None,
        About(help="Where to begin [s since the first row].", otherwise="the first row"),
    ] = None
    end_s: Annotated[
        NotNegative | None,
        About(help="Where to end [s since the first row].", otherwise="the last row"),
    ] = None
    rate_hz: Annotated[
        Positive | None,
        About(help="Requests per second.", otherwise="that of the recording", example=50.0),
    ] = None
    fastest: Annotated[
        bool,
        About(
            help="Find the largest speed at which the plan keeps the tolerance of [tolerance].",
        ),
    ] = False
    retime: Annotated[
        Retime,
        About(
            help="With fastest: one factor for the whole recording, or one that varies along it, "
            "slower where errors are large."
        ),
    ] = "constant"
    urdf_joints: Annotated[
        dict[str, Text],
        Expected("a table of names by joint"),
        About(
            help="Names of joints in the URDF, where they are others than in the recording.",
            example={"Rotation": "shoulder_pan"},
        ),
    ] = field(default_factory=dict)
    write_as: Annotated[
        ReplayFormat,
        About(
            help="What to write: csv has the columns and units of the recording, joints those of "
            "`plan`; lerobot, bag and mcap are folders."
        ),
    ] = "csv"


class Run(Settings):
    """Where the results go."""

    out: Annotated[
        Text | None,
        Expected("the name of a folder"),
        About(
            help="Folder of the results; --out overrules it.",
            otherwise="the name of this file without its ending",
            example="results",
        ),
    ] = None
    leg: Leg = Leg()
    model: Model = Model()
    path: Path = Path()
    plan: Plan = Plan()
    limits: Limits = Limits()
    start: Start = Start()
    tolerance: Tolerance = Tolerance()
    output: Output = Output()
    export: Annotated[tuple[Export, ...], FromList()] = ()
