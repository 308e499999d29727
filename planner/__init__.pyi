from planner._version import __version__ as __version__
from planner.approximation.curve import CurveStack as CurveStack, PiecewiseLinear as PiecewiseLinear
from planner.approximation.fit_pwl import fit_pwl as fit_pwl
from planner.evaluation.cross_check import cross_check as cross_check
from planner.exceptions import (
    BusError as BusError,
    Infeasible as Infeasible,
    InvalidFile as InvalidFile,
    InvalidInput as InvalidInput,
    InvalidModel as InvalidModel,
    InvalidTrajectory as InvalidTrajectory,
    MissingExtra as MissingExtra,
    NoSteadyCycle as NoSteadyCycle,
    OutsideEquation13 as OutsideEquation13,
    PlannerError as PlannerError,
    SolverFailed as SolverFailed,
    UnreachableFoot as UnreachableFoot,
    UnsupportedLeg as UnsupportedLeg,
)
from planner.files.joint_model import read_models as read_models
from planner.files.logs import joints_in as joints_in, read_logs as read_logs
from planner.files.logs.rows import LogOptions as LogOptions
from planner.gait.half_ellipse import half_ellipse as half_ellipse, reference_walk as reference_walk
from planner.identification.excitation import step_test as step_test
from planner.identification.identify import identify as identify
from planner.identification.log import Log as Log
from planner.identification.result import Identification as Identification
from planner.learning.trials import (
    Learning as Learning,
    SensorDelay as SensorDelay,
    Trial as Trial,
)
from planner.learning.refine import refine as refine
from planner.model.joint import JointModel as JointModel
from planner.model.response import simulate as simulate
from planner.planning.bounds.certify import (
    Certificate as Certificate,
    certify as certify,
    lower_bound as lower_bound,
)
from planner.planning.closed_form import (
    closed_form_requests as closed_form_requests,
    invert_closed_form as invert_closed_form,
)
from planner.planning.inversion import (
    invert_foot as invert_foot,
    invert_optimal as invert_optimal,
    plan as plan,
)
from planner.planning.line_inverse import line_offset as line_offset
from planner.planning.plan import (
    FootInversion as FootInversion,
    Inversion as Inversion,
    Plan as Plan,
)
from planner.planning.stream import Stream as Stream
from planner.planning.time_shift import invert_shift as invert_shift
from planner.recording.replaying import Replay as Replay, replay as replay
from planner.recording.retiming import Fastest as Fastest, fastest as fastest
from planner.robot.play import (
    Playback as Playback,
    follow as follow,
    play as play,
)
