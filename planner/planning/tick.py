"""One tick of a stream, compiled: check arguments, update states, improve the plan, send requests.

A plan R of one joint, with the angles M of the exact model under it, costs

    sum_k  w_k (M_k - D_k)^2 + sigma (R_k - R_{k-1})^2 + xi excess_k^2 + rho (R_k - R*_k)^2

where excess_k is the excess of the change R_k - R_{k-1} over ``max_step``, and R* would hold the
desired angles D. The plan of the tick before, shifted by one request, is improved by damped
Gauss-Newton steps on the model with corners that are rounded more the later a sample is; the exact
model judges steps of several lengths and the inverses of lines. Then the first request is sent
(real-time iteration: M. Diehl, H. G. Bock, J. P. Schlöder, SIAM J. Control Optim. 43, 2005). A step
solves a linear-quadratic problem by one Riccati recursion (C. V. Rao, S. J. Wright, J. B. Rawlings,
J. Optim. Theory Appl. 99, 1998).

Import this module where it is used, inside functions. Below, k joints have W requests that act
between two samples of any of them, and n samples are planned.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from planner.arrays import LARGEST, TURN, Array
from planner.compilation import compiled, inner
from planner.model.kernel import (
    at_rest,
    law_of,
    left_at_rest,
    moving_states,
    periods,
    pose_sag,
    run_period,
)
from planner.model.law import Law, State
from planner.planning.repeating_path import Repeating, continue_path
from planner.planning.task import NEGLIGIBLE_SAG, ON_THE_LIMIT

SHARES = (1.0, 0.4, 0.15)
"""Trial lengths of a step, as shares of it."""

EXCEEDING = 10.0
"""Weight xi of the squares by which planned changes exceed ``max_step``, which is kept exactly."""

RESTING = 1e-7
"""Weight rho of the squared distances from the requests that hold the desired angles: it brings
saturated requests back."""

PLANNED, NOT_FINITE, BLOCKED, BEYOND, JUMPED = range(5)
"""Faults of a joint's arguments: none, a desired angle that is not finite, a load that blocks it, a
desired angle beyond its limits, a measured angle that it cannot have reached. The joint is held
after the first two faults."""

Record = Any
"""An entry of an array with named fields."""


def _fields(numbers: str, counts: str) -> np.dtype[np.void]:
    kinds = [(name, np.float64) for name in numbers.split()]
    return np.dtype(kinds + [(name, np.int64) for name in counts.split()])


JOINT = _fields(
    "compliance "  # its sag by a load [rad/(N m)]
    "faster faster_by_load "  # how much faster it is in the positive direction, likewise [/tick]
    "steady_by_load "  # and how much faster at a steady speed by a load
    "v_max travel theta_0 dead_band "  # [rad/tick], [rad/period], [rad], [rad]
    "lower upper max_step "  # of its requests [rad]
    "smoothing "  # sigma
    "effect "  # samples from a request of the plan to its effect
    "observer",  # share of a measured error that counts at a tick
    "hold",  # ticks of a period
)
"""Constants of a joint."""

STATE = _fields(
    "angle speed "  # now, predicted and corrected, NaN before the first tick [rad], [rad/tick]
    "integral load "  # of its servo, now [rad/tick]; torque on it at the last tick [N m]
    "damping "
    "read believed unread "  # the last measured angle, the one that counted, ticks since then
    "measured "  # argument: the angle, NaN where there is none [rad]
    "request amount",  # answer: to send now; how far an angle is beyond what is possible [rad]
    "fault",  # answer
)
"""State of a joint, with a tick's arguments and answer."""

SAMPLE = _fields("load_sag resting faster goal count rounded", "")
"""Data of one joint's plan in a period: its sag under the load, the request R* that would hold the
desired angle [rad], how much faster it is [rad/tick], the desired angle D [rad], the weight w, and
the squared radius of the corners [rad^2/tick^2]."""


class Data(NamedTuple):
    """The arrays of a stream."""

    joints: Any  # JOINT, (k,)
    laws: Array  # the numbers of each law, (k, 10)
    states: Any  # STATE, (k,)
    weights: Array  # of each request at each tick, youngest first, (k, most ticks of a period, W)
    radii: Array  # of the corners at each sample [theta_0], (n,)
    sent: Array  # requests that act now or later, oldest first [rad], (k, youngest + W - 1)
    plan: Array  # [rad], (k, n)
    desired: Array  # argument [rad], (preview, k)
    load: Array  # argument [N m], (preview, k)


class Problem(NamedTuple):
    """The problem of one joint's plan."""

    joint: Record
    law: Law
    weights: Array  # of its requests, (hold, W)
    samples: Any  # SAMPLE, (n,)
    start: State  # before the first of them
    begins: bool  # whether this is the first tick, whose request stays


@compiled
def tick(data: Data, path: Repeating, missed: int, strict: bool) -> bool:
    """Plan the requests of all joints for now; the answer, and states updated to now, are in data.

    ``path`` has no rows ahead where it does not repeat; ``missed`` ticks have passed without a
    step, in which the last requests were held. The answer is whether the tick has planned: not with
    faults where ``strict``, nor if the first tick has no angle of a joint; requests are then NaN.
    """
    joints, laws, states, weights, radii, sent, plan, desired, load = data
    preview, count = desired.shape
    samples, begins = plan.shape[1], np.isnan(states[0].angle)
    youngest = sent.shape[1] - weights.shape[2] + 1  # age of the youngest request that acts
    rows, rested = np.empty((count, preview + path.ahead)), np.empty(count, dtype=np.bool_)
    unknown = False
    for j in range(count):
        state = states[j]
        check(joints[j], law_of(laws[j]), state, desired, load, j)
        state.request = np.nan
        rested[j] = state.fault == NOT_FINITE or state.fault == BLOCKED
        now = state.angle
        if begins:
            now = np.nan if state.fault == NOT_FINITE else desired[0, j]
            if not np.isnan(state.measured):
                now = state.measured
        unknown |= np.isnan(now) or (strict and state.fault != PLANNED)
        for row in range(preview):  # a joint that is held is planned to stay where it was
            rows[j, row] = now if rested[j] else desired[row, j]
    if unknown:
        return False
    shares = np.ones(count)
    if path.ahead > 0:
        continue_path(path, rows, rested, 1 + missed, shares)
    period_samples = np.empty(samples, dtype=SAMPLE)
    for j in range(count):
        joint, state, its_plan, its_sent = joints[j], states[j], plan[j], sent[j]
        law = law_of(laws[j])
        own = weights[j, : joint.hold]
        if begins:
            state.angle = desired[0, j] if np.isnan(state.measured) else state.measured
            load_sag = joint.compliance * load[0, j]
            state.speed, state.integral = 0.0, at_rest(law, state.angle, load_sag).integral
            state.read, state.believed = state.measured, state.measured
            sag = law.offset + left_at_rest(law, load_sag + pose_sag(law, state.angle))
            for i in range(len(its_sent)):
                its_sent[i] = min(max(state.angle - sag, joint.lower), joint.upper)
        else:
            torque = (state.load + load[0, j]) / 2.0
            elapse(joint, state, law, own, its_sent, its_plan, torque, missed)
        state.load = load[0, j]
        # The motion before the first request of the plan acts is already determined
        begin = State(state.angle, state.speed, state.integral)
        for row in range(1, youngest + samples):
            at = load[min(row, preview - 1), j]
            torque = (load[min(row, preview) - 1, j] + at) / 2.0
            load_sag = joint.compliance * torque
            faster = joint.faster + joint.faster_by_load * torque
            if row < youngest:
                begin = run_period(law, own, its_sent, row, load_sag, faster, begin, 0)
            else:
                column, k = min(row, rows.shape[1] - 1), row - youngest
                sample = period_samples[k]
                sample.load_sag, sample.faster, sample.goal = load_sag, faster, rows[j, column]
                sags = joint.compliance * at + pose_sag(law, sample.goal)
                sag = law.offset + left_at_rest(law, sags)
                sample.resting = sample.goal - sag
                sample.count = 1.0 if column < preview else shares[j]
                sample.rounded = (law.gain * joint.theta_0 * radii[k]) ** 2
        problem = Problem(joint, law, own, period_samples, begin, begins)
        improve(problem, state, its_sent, its_plan)
        last = its_sent[-1]
        its_plan[0] = last if rested[j] or begins else within(joint, its_plan[0], last)
        state.request = its_plan[0]
        append(its_sent, state.request)
    return True


@inner
def check(joint: Record, law: Law, state: Record, desired: Array, load: Array, j: int) -> None:
    """Set the fault of a joint's arguments; a load that blocks the joint is replaced by 0."""
    finite, blocked, far = True, False, 0.0
    for row in range(len(desired)):
        faster = joint.faster + joint.steady_by_load * load[row, j]
        if not abs(faster) < joint.v_max:  # also where the load is no number
            blocked = True
        if not abs(desired[row, j]) <= LARGEST:
            finite = False
    for row in range(len(desired)):
        if blocked:
            load[row, j] = 0.0
        sags = joint.compliance * load[row, j] + pose_sag(law, desired[row, j])
        sag = law.offset + left_at_rest(law, sags)
        room = joint.dead_band + ON_THE_LIMIT + min(abs(sag), NEGLIGIBLE_SAG)
        request = desired[row, j] - sag
        far = max(far, max(request - joint.upper, joint.lower - request) - room)
    state.amount = far
    state.fault = BEYOND if far > 0.0 else PLANNED
    if blocked:
        state.fault = BLOCKED
    if not finite:
        state.fault = NOT_FINITE
    if not abs(state.measured) <= LARGEST:
        state.measured = np.nan


@inner
def elapse(
    joint: Record,
    state: Record,
    law: Law,
    weights: Array,
    sent: Array,
    plan: Array,
    load: float,
    missed: int,
) -> None:
    """Move on by the periods since the last step, and correct the angle by a measured one.

    A measured angle counts on the turn of the predicted one. If its distance from the last valid
    one exceeds twice the largest move of the model plus 0.1 rad, it counts as missing, unless the
    angle before confirms it: something has moved the joint.
    """
    load_sag, faster = joint.compliance * load, joint.faster + joint.faster_by_load * load
    now, periods = State(state.angle, state.speed, state.integral), 1 + missed
    for number in range(periods):
        if number:
            append(sent, sent[-1])
        now = run_period(law, weights, sent, 0, load_sag, faster, now, 0)
        append(plan, plan[-1])
    angle = now.angle
    measured = state.measured - TURN * round((state.measured - angle) / TURN)
    state.unread += periods
    off, reach = abs(measured - state.believed), 2.0 * joint.travel
    again = abs(measured - state.read) <= reach * periods + 0.1
    state.read = measured
    if off > reach * state.unread + 0.1 and not again:
        measured = np.nan
        if state.fault == PLANNED:
            state.fault, state.amount = JUMPED, off
    if not np.isnan(measured):
        state.believed, state.unread = measured, 0.0
        angle += min(max(joint.observer * (measured - angle), -joint.travel), joint.travel)
    state.angle, state.speed, state.integral = angle, now.speed, now.integral


@inner
def append(values: Array, last: float) -> None:
    """Shift values by one, and append a new one."""
    for i in range(len(values) - 1):
        values[i] = values[i + 1]
    values[-1] = last


@inner
def within(joint: Record, request: float, last: float) -> float:
    """The nearest request within the limits and ``max_step`` of the last one, exactly."""
    request = min(max(request, joint.lower), joint.upper)
    request = last + min(max(request - last, -joint.max_step), joint.max_step)
    if abs(request - last) > joint.max_step:  # by the last bit
        request = np.nextafter(request, last)
    return float(min(max(request, joint.lower), joint.upper))


@inner
def improve(problem: Problem, state: Record, sent: Array, plan: Array) -> None:
    """Replace the plan by the best of itself, shares of its Gauss-Newton steps and inverted lines.

    ``sent`` are the requests that act now or later, oldest first; ``plan`` is that of the tick
    before, shifted [rad], (n,). The damping of the state changes.
    """
    joint, samples, begins = problem.joint, problem.samples, problem.begins
    count, past = len(plan), max(problem.weights.shape[1] - 1, 1)
    best, now = np.empty(past + count), np.empty(past + count)
    lines, trial = np.empty(past + count), np.empty(past + count)
    step = np.empty(count)
    for i in range(past):
        now[i] = lines[i] = trial[i] = best[i] = sent[len(sent) - past + i]
    for k in range(count):
        now[past + k] = samples[k].resting if begins else plan[k]
        lines[past + k] = inverse_of_line(joint, samples, k)
    if begins:
        now[past] = lines[past] = sent[-1]
    elif count > 1:
        now[-1] += samples[count - 1].goal - samples[count - 2].goal
    for k in range(past, past + count):
        now[k] = min(max(now[k], joint.lower), joint.upper)
        lines[k] = min(max(lines[k], joint.lower), joint.upper)
    # With one step errors on recordings of an SO-101 are up to four times as large.
    for _ in range(10 if begins else 2):
        before = gauss_newton_step(problem, now, state.damping, step)
        least, winner = before, -1
        for number in range(1 + len(SHARES)):
            for k in range(count):
                request = lines[past + k]
                if number:
                    request = now[past + k] - SHARES[number - 1] * step[k]
                trial[past + k] = min(max(request, joint.lower), joint.upper)
            costs = cost(problem, trial, least)
            if costs < least:
                least, winner, best, trial = costs, number, trial, best
        if winner >= 0:
            now, best = best, now
        else:
            state.damping = min(3.0 * state.damping, 1.0)
        if winner == 1:
            state.damping = max(state.damping / 3.0, 3e-4)
        # Along walks there are 1.2 steps a tick; with twice this reduction of the cost 1.15, and
        # errors are up to a third further from the least. Beside 1e-12 nothing counts.
        if not begins and 1.0 - least / max(before, 1e-12) < 0.2:
            break
    for k in range(count):
        plan[k] = now[past + k]


@inner
def inverse_of_line(joint: Record, samples: Any, k: int) -> float:
    """A sample's line inverted: angle and slope when its request takes effect, raised by C_m.

    C_m as from rest: the error whose drive is the slope, and the dead band.
    """
    last = len(samples) - 1
    at = min(max(k + joint.effect, 0.0), float(last))
    number = max(min(int(at), last - 1), 0)
    slope = samples[min(number + 1, last)].goal - samples[number].goal
    slope = min(max(slope, -joint.travel), joint.travel)
    raised = slope * (joint.theta_0 / joint.travel) + np.sign(slope) * joint.dead_band
    return float(samples[number].resting + (at - number) * slope + raised)


@inner
def cost_of_request(joint: Record, change: float, away: float) -> float:
    """The cost of a request without the error [rad^2]."""
    excess = change - min(max(change, -joint.max_step), joint.max_step)
    return float(joint.smoothing * change**2 + EXCEEDING * excess**2 + RESTING * away**2)


@inner
def cost(problem: Problem, requests: Array, enough: float) -> float:
    """The cost of a plan by the exact model [rad^2]; incomplete once beyond ``enough``."""
    joint, law, weights, samples, now, _ = problem
    past, first = len(requests) - len(samples), len(requests) - len(samples) + 1 - weights.shape[1]
    of_errors, of_requests = 0.0, 0.0
    for k in range(len(samples)):
        sample, request = samples[k], requests[past + k]
        now = run_period(law, weights, requests, first + k, sample.load_sag, sample.faster, now, 0)
        away, change = request - sample.resting, request - requests[past + k - 1]
        of_errors += sample.count * (now.angle - sample.goal) ** 2
        of_requests += cost_of_request(joint, change, away)
        if of_errors + of_requests > enough:
            break
    return of_errors + of_requests


@inner
def carried_back(slopes: Array, derivatives: Array) -> tuple[float, float]:
    """Derivatives by angle and speed after a period, as those by these before it."""
    return (
        slopes[0, 0] * derivatives[0] + slopes[1, 0] * derivatives[1],
        slopes[0, 1] * derivatives[0] + slopes[1, 1] * derivatives[1],
    )


@inner
def gauss_newton_step(problem: Problem, requests: Array, damping: float, step: Array) -> float:
    """Fill ``step`` with minus the Gauss-Newton step of a plan; return the plan's cost [rad^2].

    Requests on a limit that the gradient would move beyond it stay, and so does the first one where
    the stream begins.

    The recursion goes backward. With x the changes of angle and speed before period k, and r the
    changes dR of the requests before it, half the cost from there on is, up to a constant,

        x'Px/2 + x'Cr + r'Qr/2 - p'x - q'r,

    first written in the state before period k and dR_k, then minimised over dR_k; all but a band of
    Q is zero. An integral term is not linearised; the exact model, which has it, judges every step.
    ``requests`` are the acting ones before the plan, then the plan [rad].
    """
    joint, law, weights, samples, state, begins = problem
    count, width = len(step), weights.shape[1]
    past, band = len(requests) - count, max(width, 2)  # requests of a period, or of a change
    inert = law.share < 1.0 or law.acceleration < np.inf
    # Forward: errors by the exact model, derivatives with rounded corners, costs
    own_states = moving_states(law)
    errors, slopes = np.empty(count), np.empty((own_states, own_states + width, count))
    window, (sags, faster, rounded) = np.empty((3, width, count)), np.empty((3, count))
    states = np.empty((own_states, count))
    q, per_change, of_errors, of_requests = np.zeros(count), np.empty(count), 0.0, 0.0
    for k in range(count):
        sample, first, request = samples[k], past + k + 1 - width, requests[past + k]
        for age in range(width):
            window[0, age, k] = requests[past + k - age]
        for s in range(own_states):
            states[s, k] = state[s]
        sags[k], faster[k], rounded[k] = sample.load_sag, sample.faster, sample.rounded
        state = run_period(law, weights, requests, first, sample.load_sag, sample.faster, state, 0)
        errors[k] = state.angle - sample.goal
        of_errors += sample.count * errors[k] ** 2
        away, change = request - sample.resting, request - requests[past + k - 1]
        of_requests += cost_of_request(joint, change, away)
        excess = change - min(max(change, -joint.max_step), joint.max_step)
        per_change[k] = joint.smoothing + (EXCEEDING if excess != 0.0 else 0.0)
        force = joint.smoothing * change + EXCEEDING * excess
        q[k] += force + RESTING * away
        if k:
            q[k - 1] -= force
    periods(law, weights, window, sags, faster, rounded, states, slopes)
    # Backward
    size = 2 if inert else 1  # without inertia the speed has no effect
    gradient, by_state, linear, moved = q.copy(), np.zeros(2), np.zeros(2), np.zeros(2)
    curved, product, c = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, count))  # P, PA, C
    matrix = np.zeros((count, band))  # Q: row i, column l at l - i + band - 1
    (lead, half), own = np.zeros((2, 2, band)), np.zeros(band)
    feedback, constant = np.zeros((count, band + 1)), np.zeros(count)
    for k in range(count - 1, -1, -1):
        low = max(k - band + 1, 0)
        last, error, change = k - low, samples[k].count * errors[k], slopes[:, :, k]
        by_state[0] += error
        linear[0] += error
        curved[0, 0] += samples[k].count
        # The requests low to k, of which the youngest is the last
        older, rest = gradient[low:], q[low:]
        for t in range(last + 1):
            age = last - t
            for x in range(size):
                lead[x, t] = change[x, own_states + age] if age < width else 0.0
                older[t] += lead[x, t] * by_state[x]
                rest[t] += lead[x, t] * linear[x]
            for x in range(size):
                moved[x] = curved[x, 0] * lead[0, t] + curved[x, 1] * lead[1, t]
                half[x, t] = moved[x] / 2.0 + c[x, low + t]
                moved[x] += c[x, low + t]
            for x in range(size):
                c[x, low + t] = change[0, x] * moved[0] + change[1, x] * moved[1]
        by_state[0], by_state[1] = carried_back(change, by_state)
        linear[0], linear[1] = carried_back(change, linear)
        for x in range(size):
            product[x, 0], product[x, 1] = carried_back(change, curved[x])
        for x in range(size):
            curved[0, x], curved[1, x] = carried_back(change, product[:, x])
        # The row of dR_k, which is eliminated where it is free
        row = matrix[k, band - 1 - last :]
        for t in range(last + 1):
            own[t] = row[t]
            for x in range(size):
                own[t] += lead[x, last] * half[x, t] + half[x, last] * lead[x, t]
        own[last] += per_change[k] + RESTING + damping
        if k:
            own[last - 1] -= per_change[k]
            matrix[k - 1, band - 1] += per_change[k]
        stays = requests[past + k] <= joint.lower and gradient[k] > 0.0
        stays |= requests[past + k] >= joint.upper and gradient[k] < 0.0
        share = 0.0 if stays or (begins and k == 0) else 1.0 / own[last]
        gains, constant[k] = feedback[k], share * q[k]
        for t in range(last):
            gains[t] = share * own[t]
            rest[t] -= gains[t] * q[k]
            for x in range(size):
                c[x, low + t] -= gains[t] * c[x, k]
        for x in range(size):
            gains[band - 1 + x] = share * c[x, k]
            linear[x] -= gains[band - 1 + x] * q[k]
            for y in range(size):
                curved[x, y] -= gains[band - 1 + x] * c[y, k]
        for i in range(last):
            row = matrix[low + i, band - 1 - i :]
            for t in range(i + 1):
                row[t] -= gains[i] * own[t]
            for x in range(size):
                lead_i, half_i = lead[x, i], half[x, i]
                for t in range(i + 1):
                    row[t] += lead_i * half[x, t] + half_i * lead[x, t]
    # Forward again
    now, after = np.zeros(2), np.zeros(2)
    for k in range(count):
        low, step[k] = max(k - band + 1, 0), constant[k]
        for x in range(size):
            step[k] -= feedback[k, band - 1 + x] * now[x]
        for t in range(k - low):
            step[k] -= feedback[k, t] * step[low + t]
        for x in range(size):
            after[x] = slopes[x, 0, k] * now[0] + slopes[x, 1, k] * now[1]
            for age in range(min(width, k + 1)):
                after[x] += slopes[x, own_states + age, k] * step[k - age]
        now, after = after, now
    return of_errors + of_requests
