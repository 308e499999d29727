"""The law of a joint in CasADi symbols: one request period, for transcription and second opinions.

The same law for numbers is in ``model/kernel.py``; tests compare the two.
"""

from __future__ import annotations

import math
from typing import Any

from planner.model.joint import JointModel, acting_requests
from planner.model.law import Law, State


def period_function(model: JointModel) -> Any:
    """One request period as a CasADi function: (1a) of ``docs/math.md`` at its ``hold`` ticks.

    Its first argument and its answer are the state, as in :class:`planner.model.law.State`. The
    further arguments are the acting requests, youngest first [rad], the load [N m] and the radius
    of the rounded corners [rad], 0 for the exact law.
    """
    import casadi

    law, size, acting = model.law, model.states, acting_requests(model)
    state: Any = casadi.SX.sym("x", size)
    requests = casadi.SX.sym("R", acting.width)
    load, radius = casadi.SX.sym("load"), casadi.SX.sym("e")
    torque = load if model.feels_load else 0.0
    sag, corner = model.compliance * torque, law.gain * radius
    faster = (model.v_offset + model.speed_per_torque * torque) * model.tick
    angle, speed, integral = State(*(state[s] for s in range(size)))
    for weights in acting.weights[0].tolist():
        raised = law.offset + sag + law.integral_inside * integral / law.gain
        by_pose = law.sag_sin * casadi.sin(angle) + law.sag_cos * casadi.cos(angle)
        drives = [
            weight
            * _clip(
                law.gain * (requests[j] + raised - angle),
                faster - law.top,
                faster + law.top,
                corner,
            )
            for j, weight in enumerate(weights)
            if weight
        ]
        demand, sagging = law.gain * by_pose + sum(drives), law.gain * (sag + by_pose)
        speed, integral = _moved(law, demand, sagging, speed, integral, corner)
        angle = angle + speed
    reached = casadi.vertcat(*State(angle, speed, integral)[:size])
    return casadi.Function("period", [state, requests, load, radius], [reached])


def _moved(
    law: Law, demand: Any, sagging: Any, speed: Any, integral: Any, corner: Any
) -> tuple[Any, Any]:
    """Speed and integral after a tick [rad/tick]: inertia and friction, as in ``kernel.moved``."""
    corner = law.share * corner
    friction, opened = law.share * law.friction, 1.0
    aim = demand + (1.0 - law.integral_inside) * integral
    if law.share == 1.0 and friction:
        aim, friction = aim - _clip(aim, -friction, friction, corner), 0.0
    if law.share < 1.0 or math.isfinite(law.acceleration):
        change = law.share * (aim - speed)
        if math.isfinite(law.acceleration):  # the slope of its clip
            above, below = change + law.acceleration, change - law.acceleration
            opened = above / _length(above, corner) - below / _length(below, corner)
            opened /= 2.0
            change = _clip(change, -law.acceleration, law.acceleration, corner)
        aim = speed + change
    now = aim - _clip(aim, -friction, friction, corner) if friction else aim
    paid = integral if law.integral_inside else now
    return now, integral + law.integral_share * opened * (demand - sagging - paid)


def _clip(value: Any, low: Any, high: Any, radius: Any) -> Any:
    """The value within [low, high], with corners of this radius."""
    return (low + high + _length(value - low, radius) - _length(value - high, radius)) / 2.0


def _length(value: Any, radius: Any) -> Any:
    """The absolute value with a corner of this radius, sqrt(x^2 + radius^2)."""
    return (value**2 + radius**2) ** 0.5
