"""How the joint answers a trajectory of requests: Equation 3, run."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.exceptions import InvalidInput, NoSteadyCycle
from planner.model.joint import JointModel, Window, advance
from planner.trajectory import Array, as_trajectory

CLOSED = 1e-12
"""A cycle is closed when its ends agree to this [rad], relative to its size where that exceeds 1."""

MOST_CYCLES = 1000
"""Cycles after which a response that still drifts is given up."""


def simulate(
    model: JointModel,
    requests: npt.ArrayLike,
    *,
    cyclic: bool = True,
    start: float | None = None,
) -> Array:
    """Angles of the joint under ``requests``: the exact model, which has the last word on a plan.

    Cyclic, the answer is the steady cycle: the requests are repeated until the ends of a cycle agree
    to 1e-12 rad, with Newton's method on the angle at the seam in place of mere waiting. From rest,
    the requests before the first are taken to have been the first.

    Args:
        model: The joint.
        requests: Requests [rad], shape (n,), one every ``model.period``.
        cyclic: Whether the requests repeat for ever.
        start: From rest only: angle one tick before the first request [rad]. By default the joint
            rests where the first request holds it, at request + offset.

    Returns:
        Angles [rad], shape (n,), read-only; sample k is taken right after request k.

    Raises:
        InvalidTrajectory: ``requests`` is not a finite array of shape (n,) with n >= 2.
        InvalidInput: ``start`` is given for a cycle, or not finite.
        NoSteadyCycle: The response does not settle.
    """
    requests = as_trajectory(requests, name="requests")
    pulls = np.repeat(requests + model.offset, model.hold)
    if cyclic:
        if start is not None:
            raise InvalidInput("start: a cycle has none; leave it out, or say cyclic=False")
        angles = _steady_cycle(model, pulls)
    else:
        if start is not None and not np.isfinite(start):
            raise InvalidInput(f"start: got {start}, expected a finite angle [rad]")
        before = float(pulls[0] if start is None else start)
        angles = _run(model, _with_history(pulls, model.window, cyclic=False), before)
    sampled = np.array(angles[:: model.hold])
    sampled.setflags(write=False)
    return sampled


def _with_history(pulls: Array, window: Window, *, cyclic: bool) -> list[float]:
    """The pulls of every tick, preceded by the ``window.last`` that came before them."""
    history = (
        np.resize(pulls[::-1], window.last)[::-1]
        if cyclic
        else np.full(window.last, pulls[0])
    )
    return [*history.tolist(), *pulls.tolist()]


def _run(model: JointModel, pulls: list[float], angle: float) -> list[float]:
    """Angles at every tick after ``angle``; ``pulls`` starts with the history of the window."""
    first, weights = model.window
    last = model.window.last
    weights_ = weights.tolist()
    v_max, theta_0 = model.v_max_per_tick, model.theta_0
    angles = []
    for tick in range(last, len(pulls)):
        newest = tick - first
        window = pulls[newest : tick - last - 1 if tick > last else None : -1]
        angle = advance(angle, window, weights=weights_, v_max=v_max, theta_0=theta_0)
        angles.append(angle)
    return angles


def _steady_cycle(model: JointModel, pulls: Array) -> list[float]:
    """Angles at every tick of the cycle that repeats itself."""
    padded = _with_history(pulls, model.window, cyclic=True)
    seam = float(pulls[0])
    tolerance = CLOSED * max(1.0, float(np.max(np.abs(pulls))))
    for _ in range(MOST_CYCLES):
        angles = _run(model, padded, seam)
        if abs(angles[-1] - seam) <= tolerance:
            return angles
        # The end of a cycle is piecewise linear in its start; where it has slope 1 only waiting helps.
        contraction = _contraction(model, padded, seam, angles)
        newton = seam + (angles[-1] - seam) / (1.0 - contraction) if contraction < 1.0 else np.inf
        seam = newton if abs(newton) <= np.max(np.abs(pulls)) else angles[-1]
    raise NoSteadyCycle(abs(angles[-1] - seam), MOST_CYCLES)
