"""Every public function that takes something, with arguments that it accepts.

Left out are the errors, and the answers that only the functions here make: ``ANSWERS``.
"""

from collections.abc import Callable, Mapping
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

import kinematics
import planner
from kinematics import Leg

ANSWERS = {
    *("Certificate", "FootInversion", "Identification", "Inversion", "Plan"),
    *("Playback", "Replay", "Fastest", "InverseSolution", "Limits"),
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
JOINT = {"model": MODEL, "desired": ANGLES}
CURVE = {
    "knots": np.array([0.0, 5.0, 12.0]),
    "values": np.array([0.0, 0.1, -0.1]),
    "samples": 20,
    "tick": 0.01,
    "cyclic": True,
}
PLANNED = {"models": MODEL, "desired": ANGLES[:, None], "method": "closed_form"}
LOG = {"times": 0.01 * np.arange(20), "requests": ANGLES, "angles": ANGLES}


@cache
def leg() -> Leg:
    """A front leg of the ERS-210A."""
    return Leg.from_urdf(**PLACE)


@cache
def poses() -> Any:
    return np.radians([10.0, 20.0, 40.0]) + 0.1 * np.outer(ANGLES, [1.0, 0.5, 2.0])


@cache
def curve() -> planner.PiecewiseLinear:
    return planner.PiecewiseLinear(**CURVE)


def _clock(most: float) -> dict[str, Callable[..., Any]]:
    """A clock that only sleeping advances, up to some time [s]."""
    time = [0.0]

    def sleep(seconds: float) -> None:
        time[0] += seconds
        if time[0] > most:
            raise KeyboardInterrupt

    return {"now": lambda: time[0], "sleep": sleep}


def _follow(**given: Any) -> planner.Playback:
    """Follow for no longer than a few ticks."""
    if callable(given["desired"]):
        raise planner.InvalidInput("what the caller's own function does is the caller's affair")
    return planner.follow(**_clock(1.0), **given)


def _step(**given: Any) -> Any:
    stream = planner.Stream(MODEL, preview=7, on_bad="raise")
    stream.step(ANGLES[:7])
    return stream.step(**given)


@cache
def closed_form() -> planner.Inversion:
    return planner.invert_closed_form(MODEL, ANGLES, segments=3, rule="exact")


def _play(**given: Any) -> planner.Playback:
    """Play for no longer than a few requests."""
    sent = []

    def send(row: Any) -> None:
        sent.append(row)
        if len(sent) > 100:
            raise KeyboardInterrupt

    return planner.play(**{"send": send, **_clock(1e4), **given})


def _of_leg(method: str) -> Callable[..., Any]:
    """A method of the leg, which is made when it is called."""
    return lambda **given: getattr(leg(), method)(**given)


OWN: Mapping[str, Callable[..., Any]] = {
    "PiecewiseLinear.slope_at": lambda index: curve().slope_at(index),
    "play": _play,
    "follow": _follow,
    "Stream.step": _step,
} | {
    f"Leg.{name}": _of_leg(name)
    for name in (
        "foot_positions",
        "joint_positions",
        "jacobians",
        "jumps",
        "joint_angles",
        "inverse",
    )
}


def function(name: str) -> Callable[..., Any]:
    package = kinematics if name.partition(".")[0] in kinematics.__all__ else planner
    return OWN[name] if name in OWN else attrgetter(name)(package)


def _poses() -> dict[str, Any]:
    return {"angles": poses()}


def _feet() -> dict[str, Any]:
    return {"foot": leg().foot_positions(poses())}


def _executed() -> dict[str, Any]:
    return {"plan": closed_form(), "measured": closed_form().predicted + 0.01}


def _recorded() -> dict[str, Any]:
    return {"recording": planner.Log(**LOG), "models": MODEL}


def _streamed() -> dict[str, Any]:
    return {"desired": ANGLES[:7, np.newaxis], "stream": planner.Stream(MODEL, preview=7)}


ENTRANCES: Mapping[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "JointModel": (
        lambda: {"v_max": 4.0, "theta_0": 0.2, "lag": 0.02, "acceleration_time": 0.04},
        "tick hold offset dead_band v_offset compliance speed_per_torque time_constant "
        "max_acceleration sag_sin sag_cos",
    ),
    "PiecewiseLinear": (lambda: dict(CURVE), ""),
    "PiecewiseLinear.slope_at": (lambda: {"index": 3}, ""),
    "CurveStack": (lambda: CURVE | {"values": np.array([CURVE["values"]] * 2)}, ""),
    "CurveStack.of": (lambda: {"curves": [curve()]}, ""),
    "Log": (lambda: dict(LOG), "torque_on name joint unit notes"),
    "LogOptions": (
        dict,
        "joint time requested actual torque unit ticks_per_turn topic command_topic episodes",
    ),
    "certify": (lambda: JOINT | {"level": "envelope", "time_limit": 1.0}, "cyclic norm start"),
    "lower_bound": (
        lambda: JOINT | {"norm": "max", "level": "slope", "time_limit": 1.0},
        "cyclic start",
    ),
    "closed_form_requests": (lambda: {"model": MODEL, "curves": [curve()]}, "rule"),
    "cross_check": (
        lambda: JOINT | {"segments": 3, "level": "envelope"},
        "cyclic limits leg norm names progress",
    ),
    "fit_pwl": (
        lambda: {"desired": ANGLES, "v_max": 4.0, "tick": 0.01, "segments": 3},
        "cyclic max_error max_rms knots required exact",
    ),
    "half_ellipse": (
        dict,
        "samples length height forward sideways hip_height ground_fraction heading",
    ),
    "identify": (lambda: {"logs": LOG, "tick": 0.01, "hold": 1, "hold_out": False}, ""),
    "invert_closed_form": (lambda: JOINT | {"segments": 3, "refine": False}, "cyclic rule"),
    "invert_shift": (lambda: dict(JOINT), "cyclic norm start"),
    "invert_foot": (
        lambda: {"models": MODEL, "leg": leg(), **_feet()},
        "cyclic limits norm weights max_step unreachable",
    ),
    "invert_optimal": (
        lambda: dict(JOINT),
        "cyclic limits solver norm start tolerance load max_step smoothness robust",
    ),
    "plan": (lambda: PLANNED | {"segments": 3, "rule": "exact"}, "names"),
    "read_models": (lambda: {"path": MISSING}, ""),
    "refine": (lambda: _executed() | {"sensor_delay": 0.0, "reidentify": False}, ""),
    "replay": (lambda: _recorded() | {"end": 0.12}, "speed track joints begin limits"),
    "fastest": (lambda: _recorded() | {"tolerance": 1.0}, "retime"),
    "joints_in": (lambda: {"path": MISSING}, "options"),
    "read_logs": (lambda: {"paths": MISSING}, "options"),
    "line_offset": (lambda: {"model": MODEL, "slope": 1.0}, "rule"),
    "play": (
        lambda: {"requests": ANGLES, "period": 0.01, "current": [0.1], "speed": 1.0},
        "cycles on_stop report",
    ),
    "follow": (lambda: _streamed() | {"send": lambda _: None}, "measure"),
    "Stream": (lambda: {"models": MODEL, "preview": 7}, "limits cycle max_step on_bad"),
    "Stream.step": (lambda: {"desired": ANGLES[:7]}, "measured load missed"),
    "simulate": (lambda: {"model": MODEL, "requests": ANGLES}, "cyclic start load"),
    "step_test": (lambda: {"amplitude": 0.5}, "samples"),
    "Leg.from_urdf": (lambda: dict(PLACE), "locked near"),
    "Leg.foot_positions": (_poses, ""),
    "Leg.joint_positions": (_poses, ""),
    "Leg.jacobians": (_poses, ""),
    "Leg.jumps": (_poses, ""),
    "Leg.joint_angles": (lambda: _feet() | {"unreachable": "nearest"}, ""),
    "Leg.inverse": (lambda: _feet() | {"unreachable": "clamp"}, ""),
    "foot_function": (lambda: {"leg": leg()}, ""),
    "urdf_path": (lambda: {"name": "ers210a.urdf"}, ""),
}
"""By name a maker of arguments, and further arguments; each is replaced in turn."""


def places(name: str) -> list[str]:
    """The arguments of a function that are tried."""
    good, more = ENTRANCES[name]
    return [*good(), *more.split()]
