"""The law of a joint in CasADi symbols: one request period, for transcription and second opinions.

The same law for numbers is in ``model/kernel.py``; tests compare the two.
"""

from __future__ import annotations

import math
from typing import Any

from planner.model.joint import JointModel, request_ages, weights_by_tick
from planner.model.law import Law, State


def period(
    model: JointModel,
    state: State,
    requests: Any,
    *,
    load: Any = 0.0,
    radius: Any = None,
) -> State:
    """The joint after one request period: (1a) of ``docs/math.md`` at each of its ``hold`` ticks.

    Args:
        model: The joint.
        state: State at the sample before, of CasADi expressions; its speed and integral count
            where the joint has them.
        requests: Requests of the ages :func:`planner.model.joint.request_ages`, youngest first
            [rad], a CasADi expression of that many entries.
        load: Torque on the joint in this period [N m], a number or a CasADi expression.
        radius: Radius of the rounded corners of the law [rad]; None for the exact one.

    Returns:
        The state at the next sample.
    """
    angle, speed, integral = state
    law, sag = model.law, model.compliance * load
    faster = (model.v_offset + model.speed_per_torque * load) * model.tick
    corner = None if radius is None else law.gain * radius
    for weights in weights_by_tick(model).tolist():
        raised = law.offset + sag + law.integral_inside * integral / law.gain
        by_pose = _pose_sag(law, angle)
        demand = law.gain * by_pose + sum(
            weight
            * _clip(
                law.gain * (requests[j] + raised - angle),
                faster - law.top,
                faster + law.top,
                corner,
            )
            for j, weight in enumerate(weights)
            if weight
        )
        sagging = law.gain * (sag + by_pose)
        speed, integral = _moved(law, demand, sagging, speed, integral, corner)
        angle = angle + speed
    return State(angle, speed, integral)


def period_function(model: JointModel) -> Any:
    """:func:`period` as a CasADi function, the first argument and the answer being the state.

    The state is the angle [rad], and below it for a joint with inertia the speed, and the integral
    of a speed loop [rad/tick]. The further arguments are the acting requests, youngest first [rad],
    the load [N m] and the radius of the corners [rad], 0 for the exact law.
    """
    import casadi

    state: Any = casadi.SX.sym("x", model.law.states)
    requests = casadi.SX.sym("R", request_ages(model).width)
    load, radius = casadi.SX.sym("load"), casadi.SX.sym("e")
    after = period(
        model,
        State(*(state[s] for s in range(model.law.states))),
        requests,
        load=load if model.feels_load else 0.0,
        radius=radius,
    )
    reached = casadi.vertcat(*after[: model.law.states])
    return casadi.Function("period", [state, requests, load, radius], [reached])


def _pose_sag(law: Law, angle: Any) -> Any:
    """The sag by the angle [rad]."""
    import casadi

    if law.sag_sin == 0.0 and law.sag_cos == 0.0:
        return 0.0
    return law.sag_sin * casadi.sin(angle) + law.sag_cos * casadi.cos(angle)


def _moved(
    law: Law, demand: Any, sagging: Any, speed: Any, integral: Any, corner: Any
) -> tuple[Any, Any]:
    """Speed and integral after a tick [rad/tick]: inertia and friction, as in ``kernel.moved``."""
    corner = None if corner is None else law.share * corner
    friction, limited = law.share * law.friction, 0.0
    aim = demand + (1.0 - law.integral_inside) * integral
    if law.share == 1.0 and friction:
        aim, friction = aim - _clip(aim, -friction, friction, corner), 0.0
    if law.share < 1.0 or math.isfinite(law.acceleration):
        change = law.share * (aim - speed)
        if math.isfinite(law.acceleration):
            limited = _limited(change, law.acceleration, corner)
            change = _clip(change, -law.acceleration, law.acceleration, corner)
        aim = speed + change
    now = aim - _clip(aim, -friction, friction, corner) if friction else aim
    paid = integral if law.integral_inside else now
    return now, integral + law.integral_share * (1.0 - limited) * (demand - sagging - paid)


def _limited(change: Any, most: float, radius: Any) -> Any:
    """1 where a change is beyond a limit, 0 within; with rounded corners a share of both."""
    import casadi

    if radius is None:
        return casadi.fabs(change) > most
    above, below = change + most, change - most
    slope = above / (above**2 + radius**2) ** 0.5 - below / (below**2 + radius**2) ** 0.5
    return 1.0 - slope / 2.0


def _clip(value: Any, low: Any, high: Any, radius: Any) -> Any:
    """The value within [low, high]; with rounded corners each ``|x|`` is sqrt(x^2 + radius^2)."""
    import casadi

    if radius is None:
        return casadi.fmin(casadi.fmax(value, low), high)
    above, below = value - low, value - high
    lengths = (above**2 + radius**2) ** 0.5 - (below**2 + radius**2) ** 0.5
    return (low + high + lengths) / 2.0
