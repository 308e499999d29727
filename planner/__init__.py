"""Requests that make a lagging, saturating joint follow the path you want."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner._version import __version__
    from planner.approximation.curve import CurveStack, PiecewiseLinear
    from planner.approximation.fit import fit_pwl
    from planner.evaluation.cross_check import cross_check
    from planner.exceptions import (
        BusError,
        Infeasible,
        InvalidFile,
        InvalidInput,
        InvalidModel,
        InvalidTrajectory,
        MissingExtra,
        NoSteadyCycle,
        OutsideEquation13,
        PlannerError,
        SolverFailed,
        UnreachableFoot,
        UnsupportedLeg,
    )
    from planner.files.joint_model import read_models
    from planner.files.logs import joints_in, read_logs
    from planner.files.logs.rows import LogOptions
    from planner.gait.half_ellipse import half_ellipse, reference_walk
    from planner.identification.excitation import step_test
    from planner.identification.identify import identify
    from planner.identification.log import Log
    from planner.identification.result import Identification
    from planner.learning.refine import refine
    from planner.model.joint import JointModel
    from planner.model.response import simulate
    from planner.planning.bounds.certify import Certificate, certify, lower_bound
    from planner.planning.closed_form import closed_form_requests, invert_closed_form
    from planner.planning.inversion import invert_foot, invert_optimal, plan
    from planner.planning.line_inverse import line_offset
    from planner.planning.plan import Plan
    from planner.planning.result import FootInversion, Inversion, Learning, SensorDelay, Trial
    from planner.planning.stream import Stream
    from planner.planning.time_shift import invert_shift
    from planner.recording.replaying import Replay, replay
    from planner.recording.retiming import Fastest, fastest
    from planner.robot.play import Playback, TimedRequest, follow, play, timed_requests

__all__ = [
    "BusError",
    "Certificate",
    "CurveStack",
    "Fastest",
    "FootInversion",
    "Identification",
    "Infeasible",
    "InvalidFile",
    "InvalidInput",
    "InvalidModel",
    "InvalidTrajectory",
    "Inversion",
    "JointModel",
    "Learning",
    "Log",
    "LogOptions",
    "MissingExtra",
    "NoSteadyCycle",
    "OutsideEquation13",
    "PiecewiseLinear",
    "Plan",
    "PlannerError",
    "Playback",
    "Replay",
    "SensorDelay",
    "SolverFailed",
    "Stream",
    "TimedRequest",
    "Trial",
    "UnreachableFoot",
    "UnsupportedLeg",
    "__version__",
    "certify",
    "closed_form_requests",
    "cross_check",
    "fastest",
    "fit_pwl",
    "follow",
    "half_ellipse",
    "identify",
    "invert_closed_form",
    "invert_foot",
    "invert_optimal",
    "invert_shift",
    "joints_in",
    "line_offset",
    "lower_bound",
    "plan",
    "play",
    "read_logs",
    "read_models",
    "reference_walk",
    "refine",
    "replay",
    "simulate",
    "step_test",
    "timed_requests",
]

_HOMES = {
    "planner._version": ("__version__",),
    "planner.approximation.curve": ("CurveStack", "PiecewiseLinear"),
    "planner.approximation.fit": ("fit_pwl",),
    "planner.evaluation.cross_check": ("cross_check",),
    "planner.exceptions": (
        "BusError",
        "Infeasible",
        "InvalidFile",
        "InvalidInput",
        "InvalidModel",
        "InvalidTrajectory",
        "MissingExtra",
        "NoSteadyCycle",
        "OutsideEquation13",
        "PlannerError",
        "SolverFailed",
        "UnreachableFoot",
        "UnsupportedLeg",
    ),
    "planner.files.joint_model": ("read_models",),
    "planner.files.logs.rows": ("LogOptions",),
    "planner.files.logs": ("joints_in", "read_logs"),
    "planner.gait.half_ellipse": ("half_ellipse", "reference_walk"),
    "planner.identification.excitation": ("step_test",),
    "planner.identification.result": ("Identification",),
    "planner.identification.identify": ("identify",),
    "planner.identification.log": ("Log",),
    "planner.planning.bounds.certify": ("Certificate", "certify", "lower_bound"),
    "planner.planning.closed_form": ("closed_form_requests", "invert_closed_form"),
    "planner.planning.inversion": ("invert_foot", "invert_optimal", "plan"),
    "planner.planning.line_inverse": ("line_offset",),
    "planner.planning.plan": ("Plan",),
    "planner.planning.result": (
        "FootInversion",
        "Inversion",
        "Learning",
        "SensorDelay",
        "Trial",
    ),
    "planner.planning.stream": ("Stream",),
    "planner.planning.time_shift": ("invert_shift",),
    "planner.learning.refine": ("refine",),
    "planner.model.joint": ("JointModel",),
    "planner.model.response": ("simulate",),
    "planner.recording.replaying": ("Replay", "replay"),
    "planner.recording.retiming": ("Fastest", "fastest"),
    "planner.robot.play": ("Playback", "TimedRequest", "follow", "play", "timed_requests"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562), so that ``import planner`` is light."""
    if name not in _HOME:
        raise AttributeError(f"module 'planner' has no attribute '{name}'")
    value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
