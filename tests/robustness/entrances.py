"""Every public function that takes something, with arguments that it accepts.

Left out are the errors, and the answers that only the functions here make: ``ANSWERS``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import kinematics
import planner
from kinematics import Leg

ANSWERS = {
    *("Certificate", "FootInversion", "Identification", "Inversion", "Plan"),
    *("Playback", "Replay", "Fastest", "TimedRequest", "InverseSolution", "Limits"),
    *("Learning", "SensorDelay", "Trial"),
}

MODEL = planner.JointModel(v_max=4.0, theta_0=0.2, lag=0.02, acceleration_time=0.04, tick=0.01)
ANGLES = 0.3 * np.sin(2.0 * np.pi * np.arange(20) / 20)
PLACE: Mapping[str, Any] = {
    "path": kinematics.urdf_path("ers210a.urdf"),
    "base": "body",
    "foot": "front_left_ball",
}
MISSING = Path("no such folder") / "log.csv"
JOINT = {"model": MODEL, "cyclic": True}
CURVE = {
    "knots": np.array([0.0, 5.0, 12.0]),
    "values": np.array([0.0, 0.1, -0.1]),
    "samples": 20,
    "tick": 0.01,
    "cyclic": True,
}
LOG = {"times": 0.01 * np.arange(20), "requests": ANGLES, "angles": ANGLES}


@cache
def leg() -> Leg:
    """A front leg of the ERS-210A."""
    return Leg.from_urdf(**PLACE)


@cache
def poses() -> Any:
    """A path of its joints."""
    return np.radians([10.0, 20.0, 40.0]) + 0.1 * np.outer(ANGLES, [1.0, 0.5, 2.0])


@cache
def curve() -> planner.PiecewiseLinear:
    """A cycle of three lines."""
    return planner.PiecewiseLinear(**CURVE)


def _follow(**given: Any) -> planner.Playback:
    """Follow on a clock of its own, for no longer than a few ticks."""
    clock = [0.0]

    def sleep(seconds: float) -> None:
        clock[0] += seconds
        if clock[0] > 1.0:
            raise KeyboardInterrupt

    if callable(given["desired"]):
        raise planner.InvalidInput("what the caller's own function does is the caller's affair")
    return planner.follow(now=lambda: clock[0], sleep=sleep, **given)


def _step(**given: Any) -> Any:
    stream = planner.Stream(MODEL, preview=7, on_bad="raise")
    stream.step(ANGLES[:7])
    return stream.step(**given)


@cache
def closed_form() -> planner.Inversion:
    """A plan for the path."""
    return planner.invert_closed_form(MODEL, ANGLES, segments=3, rule="exact")


def _play(**given: Any) -> planner.Playback:
    """Play on a clock of its own, for no longer than a few requests."""
    clock = [0.0]

    def sleep(seconds: float) -> None:
        clock[0] += seconds
        if clock[0] > 1e4:
            raise KeyboardInterrupt

    sent = []

    def send(row: Any) -> None:
        sent.append(row)
        if len(sent) > 100:
            raise KeyboardInterrupt

    return planner.play(**{"send": send, "now": lambda: clock[0], "sleep": sleep, **given})


def _timed(**given: Any) -> list[planner.TimedRequest]:
    """The first few."""
    return [each for each, _ in zip(planner.timed_requests(**given), range(50), strict=False)]


ENTRANCES: Mapping[str, tuple[Callable[..., Any], Callable[[], dict[str, Any]]]] = {
    "JointModel": (
        planner.JointModel,
        lambda: {
            "v_max": 4.0,
            "theta_0": 0.2,
            "lag": 0.02,
            "acceleration_time": 0.04,
            "tick": 0.01,
            "hold": 2,
            "offset": 0.1,
            "dead_band": 0.01,
            "v_offset": 0.1,
            "compliance": 0.1,
            "speed_per_torque": 0.1,
            "time_constant": 0.01,
            "max_acceleration": 500.0,
            "sag_sin": 0.01,
            "sag_cos": 0.01,
        },
    ),
    "PiecewiseLinear": (planner.PiecewiseLinear, lambda: dict(CURVE)),
    "PiecewiseLinear.from_dict": (
        planner.PiecewiseLinear.from_dict,
        lambda: {"data": curve().to_dict()},
    ),
    "PiecewiseLinear.slope_at": (lambda index: curve().slope_at(index), lambda: {"index": 3}),
    "CurveStack": (planner.CurveStack, lambda: CURVE | {"values": np.array([CURVE["values"]] * 2)}),
    "CurveStack.of": (planner.CurveStack.of, lambda: {"curves": [curve()]}),
    "Log": (
        planner.Log,
        lambda: {**LOG, "torque_on": None, "name": "a", "joint": "b", "unit": "rad", "notes": ()},
    ),
    "LogOptions": (
        planner.LogOptions,
        lambda: {
            "joint": "knee",
            "time": "t",
            "requested": "r",
            "actual": "a",
            "torque": "q",
            "unit": "deg",
            "ticks_per_turn": 4096,
            "topic": "/a",
            "command_topic": "/b",
            "episodes": "0-2",
        },
    ),
    "certify": (
        planner.certify,
        lambda: {
            **JOINT,
            "desired": ANGLES,
            "norm": "rms",
            "level": "envelope",
            "start": None,
            "time_limit": 1.0,
        },
    ),
    "lower_bound": (
        planner.lower_bound,
        lambda: {
            **JOINT,
            "desired": ANGLES,
            "norm": "max",
            "level": "slope",
            "start": None,
            "time_limit": 1.0,
        },
    ),
    "closed_form_requests": (
        planner.closed_form_requests,
        lambda: {"model": MODEL, "curves": [curve()], "rule": "exact"},
    ),
    "cross_check": (
        planner.cross_check,
        lambda: {
            **JOINT,
            "desired": ANGLES,
            "limits": (-1.0, 1.0),
            "segments": 3,
            "leg": None,
            "norm": "rms",
            "level": "envelope",
            "names": ("knee",),
            "progress": lambda _: None,
        },
    ),
    "fit_pwl": (
        planner.fit_pwl,
        lambda: {
            "desired": ANGLES,
            "v_max": 4.0,
            "tick": 0.01,
            "cyclic": True,
            "segments": 3,
            "max_error": None,
            "max_rms": None,
            "knots": None,
            "required": (),
            "exact": False,
        },
    ),
    "half_ellipse": (
        planner.half_ellipse,
        lambda: {
            "samples": 20,
            "length": 0.05,
            "height": 0.04,
            "forward": 0.05,
            "sideways": 0.03,
            "hip_height": 0.08,
            "ground_fraction": 0.5,
            "heading": 0.3,
        },
    ),
    "identify": (
        planner.identify,
        lambda: {"logs": LOG, "tick": 0.01, "hold": 1, "hold_out": False},
    ),
    "invert_closed_form": (
        planner.invert_closed_form,
        lambda: {**JOINT, "desired": ANGLES, "segments": 3, "rule": "exact", "refine": False},
    ),
    "invert_shift": (
        planner.invert_shift,
        lambda: {**JOINT, "desired": ANGLES, "norm": "rms", "start": None},
    ),
    "invert_foot": (
        planner.invert_foot,
        lambda: {
            "models": MODEL,
            "leg": leg(),
            "foot": leg().foot_positions(poses()),
            "cyclic": True,
            "limits": None,
            "norm": "rms",
            "weights": (1.0, 1.0, 1.0),
            "max_step": 1.0,
            "unreachable": "nearest",
        },
    ),
    "invert_optimal": (
        planner.invert_optimal,
        lambda: {
            **JOINT,
            "desired": ANGLES,
            "limits": (-1.0, 1.0),
            "solver": "gauss-newton",
            "norm": "rms",
            "start": None,
            "tolerance": 0.5,
            "load": None,
            "max_step": 1.0,
            "smoothness": 0.005,
            "robust": None,
        },
    ),
    "plan": (
        planner.plan,
        lambda: {
            "models": MODEL,
            "desired": ANGLES[:, None],
            "names": ("knee",),
            "method": "closed_form",
            "segments": 3,
            "rule": "exact",
        },
    ),
    "read_models": (planner.read_models, lambda: {"path": MISSING}),
    "refine": (
        planner.refine,
        lambda: {
            "plan": closed_form(),
            "measured": closed_form().predicted + 0.01,
            "sensor_delay": 0.0,
            "reidentify": False,
        },
    ),
    "replay": (
        planner.replay,
        lambda: {
            "recording": planner.Log(**LOG),
            "models": MODEL,
            "speed": 2.0,
            "track": "action",
            "joints": (),
            "begin": 0.02,
            "end": 0.12,
            "limits": (-1.0, 1.0),
        },
    ),
    "fastest": (
        planner.fastest,
        lambda: {
            "recording": planner.Log(**LOG),
            "models": MODEL,
            "tolerance": 0.2,
            "retime": "constant",
        },
    ),
    "joints_in": (planner.joints_in, lambda: {"path": MISSING, "options": planner.LogOptions()}),
    "read_logs": (planner.read_logs, lambda: {"paths": MISSING, "options": planner.LogOptions()}),
    "line_offset": (planner.line_offset, lambda: {"model": MODEL, "slope": 1.0, "rule": "exact"}),
    "play": (
        _play,
        lambda: {
            "requests": ANGLES,
            "period": 0.01,
            "cycles": 2,
            "current": [0.1],
            "speed": 1.0,
            "on_stop": None,
            "report": None,
        },
    ),
    "follow": (
        _follow,
        lambda: {
            "desired": ANGLES[:7, np.newaxis],
            "stream": planner.Stream(MODEL, preview=7),
            "send": lambda _: None,
            "measure": None,
        },
    ),
    "Stream": (
        planner.Stream,
        lambda: {
            "models": MODEL,
            "preview": 7,
            "limits": (-1.0, 1.0),
            "cycle": 20,
            "max_step": 1.0,
            "on_bad": "hold",
        },
    ),
    "Stream.step": (
        _step,
        lambda: {"desired": ANGLES[:7], "measured": ANGLES[:1], "load": 0.0, "missed": 0},
    ),
    "timed_requests": (_timed, lambda: {"requests": ANGLES, "period": 0.01, "cycles": 2}),
    "sensitivities": (planner.sensitivities, lambda: {**JOINT, "requests": ANGLES, "start": None}),
    "simulate": (
        planner.simulate,
        lambda: {**JOINT, "requests": ANGLES, "start": None, "load": None},
    ),
    "step_test": (planner.step_test, lambda: {"amplitude": 0.5, "samples": 20}),
    "Leg.from_urdf": (Leg.from_urdf, lambda: {**PLACE, "locked": {}, "near": {}}),
    "Leg.foot_positions": (
        lambda angles: leg().foot_positions(angles),
        lambda: {"angles": poses()},
    ),
    "Leg.joint_positions": (
        lambda angles: leg().joint_positions(angles),
        lambda: {"angles": poses()},
    ),
    "Leg.jacobians": (lambda angles: leg().jacobians(angles), lambda: {"angles": poses()}),
    "Leg.jumps": (lambda angles: leg().jumps(angles), lambda: {"angles": poses()}),
    "Leg.joint_angles": (
        lambda **given: leg().joint_angles(**given),
        lambda: {"foot": leg().foot_positions(poses()), "unreachable": "nearest"},
    ),
    "Leg.inverse": (
        lambda **given: leg().inverse(**given),
        lambda: {"foot": leg().foot_positions(poses()), "unreachable": "clamp"},
    ),
    "foot_function": (kinematics.foot_function, lambda: {"leg": leg()}),
    "urdf_path": (kinematics.urdf_path, lambda: {"name": "ers210a.urdf"}),
}
"""Name to function and a maker of arguments, each of which is replaced in turn."""
