"""Learning from executed cycles: the next requests remove the error that was measured.

Norm-optimal iterative learning control (N. Amann, D. H. Owens, E. Rogers, 1996) in the form of A.
P. Schoellig, F. L. Mueller, R. D'Andrea (2012): the executed cycles give the disturbance ``d =
measured - M(R)`` that the model M misses, and the next requests minimise ``|M(R) + d - D|`` by the
optimised inversion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from planner.arrays import Array, as_flag, as_number, freeze, rms, shown
from planner.exceptions import InvalidInput, NoSteadyCycle, PlannerError, about
from planner.identification.identify import identify
from planner.identification.log import Log
from planner.learning import measurements
from planner.learning.trials import Learning, Trial
from planner.model.evidence import ENCODER_STEP, UNFORESEEN
from planner.model.joint import JointModel
from planner.model.response import simulate, simulate_joints
from planner.planning.inversion import planned
from planner.planning.plan import FootInversion, Inversion, Plan, joined

WORTHWHILE = 0.003
"""Share of the error that the next requests must save by the model, else learning has ended."""

SAME_REQUESTS = 1e-6
"""Requests that differ by less are the same [rad]: files carry them rounded, servos in counts."""

AnyPlan = TypeVar("AnyPlan", Inversion, FootInversion, Plan)


@np.errstate(under="ignore")  # too small to matter, whatever the caller has set
def refine(
    plan: AnyPlan,
    measured: npt.ArrayLike,
    *,
    sensor_delay: float | None = None,
    reidentify: bool = True,
) -> AnyPlan:
    """The plan for the next cycles, from the angles measured while the plan was executed.

    The repeatable error of the model is learnt, noise is not. The more cycles are measured at once,
    the better the two are separated. Where an executed cycle is worse than the best one, the next
    plan is made from the best one with a smaller step. Where learning has ended,
    ``learning.stopped`` gives the reason, and the requests are those of the best cycle; it goes on
    where they break limits that were added to the plan since.

    Limits, norm and all other options stay those of the plan. After a plan for several models the
    next one is for the nominal model, or the one that is identified anew: the measured cycles
    replace the other models.

    Args:
        plan: The plan that was executed, from :func:`planner.invert_optimal`,
            :func:`planner.invert_closed_form`, :func:`planner.invert_foot`, :func:`planner.plan`,
            or this function: its answer carries all earlier trials.
        measured: Measured angles [rad], shape (n,), a row each request, or (cycles, n); with
            several joints (n, k) or (cycles, n, k). Cycles of a plan that repeats are taken once
            the joints have settled into it.
        sensor_delay: How late the measured angles are [s]; they are moved back by it, and it is not
            learnt. None to take a delay for the sensor's where it alone explains what was measured
            and is longer than half of the model's own latency; 0 to learn in any case.
        reidentify: Whether the trials may identify the model anew. That is done from the second one
            on, where the new model predicts a trial better which it has not seen.

    Returns:
        The next plan, of the same type. Its ``learning`` records the steps; its ``disturbance`` is
        the learnt one, and part of ``predicted``.

    Raises:
        InvalidInput: ``plan`` is not a plan, or the delay is not a time.
        InvalidTrajectory: ``measured`` has another shape or values that are not finite, or cannot
            belong to the requests: another unit, a joint that does not move, the requests
            themselves, another motion, or a cycle that was already measured under others.
        SolverFailed: No requests were found that lead to a steady cycle.

    Example:
        >>> import numpy as np
        >>> from dataclasses import replace
        >>> from planner import JointModel, invert_optimal, simulate
        >>> nominal = JointModel.ers210a()
        >>> true = replace(nominal, lag=1.2 * nominal.lag, theta_0=1.2 * nominal.theta_0)
        >>> desired = 0.4 * np.sin(2 * np.pi * np.arange(125) / 125)
        >>> plan = invert_optimal(nominal, desired)
        >>> for _ in range(3):
        ...     angles = simulate(true, plan.requests)
        ...     print(f"{np.degrees(np.sqrt(np.mean((angles - desired) ** 2))):.2f} deg rms")
        ...     plan = refine(plan, angles)
        1.10 deg rms
        0.08 deg rms
        0.01 deg rms
    """
    reidentify = as_flag("reidentify", reidentify)
    if sensor_delay is not None and not abs(as_number(sensor_delay)) <= 1e3:
        raise InvalidInput(
            f"sensor_delay: got {shown(sensor_delay)}, expected a time of at most 1000 s either way"
        )
    if not isinstance(plan, Inversion | FootInversion | Plan):
        raise InvalidInput(
            f"plan: got {shown(plan)}, expected what planner.plan, invert_optimal, invert_foot or "
            "refine returned"
        )
    refined = partial(_refined, sensor_delay=sensor_delay, reidentify=reidentify)
    cycles = measurements.checked_cycles(measured, plan.requests.shape)
    if isinstance(plan, Inversion):
        return Inversion(refined(plan.plan.joint(plan.column), cycles[:, :, np.newaxis]))
    if isinstance(plan, FootInversion):
        return FootInversion(refined(plan.plan, cycles))
    if plan.task.goal == "foot":
        return refined(plan, cycles)
    plans = []
    for j, name in enumerate(plan.names):
        with about(name):
            plans.append(refined(plan.joint(j), cycles[:, :, j : j + 1]))
    return joined(plans)


def _refined(joints: Plan, cycles: Array, sensor_delay: float | None, reidentify: bool) -> Plan:
    """The next plan for one joint or one foot; ``cycles`` has shape (cycles, n, k)."""
    remarks = list[str]()
    if joints.task.robust is not None:
        remarks.append(
            "the executed plan was for several models: learning goes on from the nominal one, and "
            "the measured errors replace the others"
        )
    before = joints.learning[0] if joints.learning else None
    cycles, removed, notes = _measured(joints, before, cycles, sensor_delay)
    trials, now, more = _with_trial(before, joints, cycles)
    remarks += notes + more
    reidentified_at = before.reidentified if before else (0,) * len(joints.models)
    reidentified_at = tuple(min(each, len(trials) - 1) for each in reidentified_at)
    measured = [each.measured for each in trials]
    disturbances = _disturbances(joints, trials)
    noise = measurements.noise_of(measured, disturbances[now], cyclic=joints.cyclic)
    if reidentify and now == len(trials) - 1:  # not an earlier trial, executed again
        joints, reidentified_at, notes = reidentified(
            joints, trials, reidentified_at, measurements.deviation_of(noise)
        )
        remarks += notes
        disturbances = _disturbances(joints, trials)
        noise = measurements.noise_of(measured, disturbances[now], cyclic=joints.cyclic)
    delays = measurements.delays_of(joints, cycles, joints.task.response(joints.requests), removed)
    spread = measurements.deviation_of(noise)
    remarks += measurements.remarks_on_delays(joints, delays, spread)
    disturbance, best, gain = _estimated(joints, trials, max(reidentified_at), noise)
    base, task = trials[best], joints.task
    freeze(disturbance)
    # Of the requests with about the least error those near the requests of the trial
    new = planned(
        replace(task.with_models(joints.models), disturbance=disturbance),
        solver=joints.solver or "gauss-newton",
        executed=base.requests,
    )
    expected = task.response(new.requests) + disturbances[best]
    saving = base.error - float(task.errors_of(expected)[0])
    stopped = _reason_to_stop(joints, base, gain, saving, spread)
    if stopped and not new.task.keeps(base.requests, rounding=SAME_REQUESTS):
        stopped = ""
        remarks.append(
            "the best cycle's requests do not keep the limits or the largest step of the next "
            "ones: it is not repeated"
        )
    floor = _floor(new, before, ended=bool(stopped)), _size(joints, spread)
    if base.error + floor[1] < 0.5 * floor[0]:
        remarks.append(
            "the measured error is less than half of the least that any requests reach by the "
            "model: the joint is faster than its model, or the measured angles are the desired ones"
        )
    if stopped:
        new, next_error = replace(new, requests=base.requests.copy()), base.error
        stopped += f"; {_remaining(joints, base.error, *floor)}"
    else:
        unforeseen = _unforeseen(joints, trials, spread)
        missed = unforeseen * _size(joints, _by_joint(expected - base.mean))
        new = _shortened(new, base, saving, missed)
        expected = task.response(new.requests) + disturbances[best]
        missed = unforeseen * _size(joints, _by_joint(expected - base.mean))
        next_error = math.hypot(float(task.errors_of(expected)[0]), missed)
    power = max(1.0 / len(cycles) - 1.0 / base.cycles, 0.0)  # of the next mean's noise beyond [-]
    next_error = math.hypot(next_error, math.sqrt(power) * _size(joints, spread))
    freeze(spread)
    learning = Learning(
        trials=trials,
        noise=spread,
        gain=gain,
        reidentified=reidentified_at,
        delays=delays,
        best=best,
        floor=floor,
        next_error=next_error,
        stopped=stopped,
        remarks=tuple(remarks),
    )
    return replace(new, learning=(learning,))


def _measured(
    joints: Plan, before: Learning | None, cycles: Array, sensor_delay: float | None
) -> tuple[Array, list[float], list[str]]:
    """Checked cycles without a transient and the sensor's delays; these delays [s], and remarks."""
    remarks = list[str]()
    modelled = joints.task.response(joints.requests)
    trials = before.trials if before else ()
    old = [joints.task.response(trial.requests) for trial in trials]
    error = trials[-1].mean - old[-1] if trials else 0.0
    measurements.check_angles(cycles, joints.requests, joints.desired, modelled, modelled + error)
    if joints.cyclic and (later := measurements.settled(cycles)) is not cycles:
        cycles = later
        remarks.append("the first cycle differs from the others: it is a transient and is ignored")
    if sensor_delay is not None:
        removed = [float(sensor_delay)] * len(joints.models)
    elif before is not None:
        removed = [delay.removed for delay in before.delays]
    else:
        removed = measurements.delays_to_remove(joints, cycles, modelled)
    cycles = measurements.earlier(cycles, removed, joints)
    measurements.check_trial(cycles, modelled, trials, old, joints.models)
    return cycles, removed, remarks


def _reason_to_stop(joints: Plan, base: Trial, gain: float, saving: float, spread: Array) -> str:
    """Why learning has ended with a trial, in words; "" where it goes on.

    By the model the next requests lower its error by ``saving``; ``spread`` is a cycle's noise.
    """
    if gain < 0.05:  # smaller steps from the best cycle are not tried any more
        return "smaller and smaller steps from the best cycle have made it worse"
    if saving <= WORTHWHILE * base.error:
        return (
            f"by the model the next requests would lower the error by less than "
            f"{100.0 * WORTHWHILE:g} %"
        )
    # Errors within the noise are left alone: they would be as likely to grow. Without this 0.8 % of
    # 264 trials on servos from their physics exceed the one before by a fifth, at worst 3.1 times;
    # with it 0.4 %, at worst 1.6 times.
    noise = 2.0 * _size(joints, spread) / math.sqrt(base.cycles)
    if base.error <= min(noise, _size(joints, np.full(len(joints.models), ENCODER_STEP))):
        return (
            f"noise hides what is left of the error in {base.cycles} measured "
            f"cycle{'s' if base.cycles > 1 else ''}; refine from {4 * base.cycles} cycles of these "
            "requests to go on"
        )
    return ""


def _disturbances(joints: Plan, trials: Sequence[Trial]) -> list[Array]:
    """The disturbance as it was measured in each trial [rad], (n, k)."""
    return [np.asarray(each.mean - joints.task.response(each.requests)) for each in trials]


def _shortened(plan: Plan, base: Trial, saving: float, missed: float) -> Plan:
    """The plan with a shorter change from a trial's requests, where that lowers the expected error.

    By the models the whole change lowers the error by ``saving``, of which the joint is expected to
    miss ``missed``. From requests that break limits, which are convex, the change is whole.
    """
    breaks = not plan.task.keeps(base.requests, rounding=SAME_REQUESTS)
    if breaks or saving <= 0.0 or missed == 0.0:
        return plan
    share = saving * base.error / (saving**2 + missed**2)
    least = base.error * missed / math.hypot(saving, missed)
    # At 1 a model that is right leaves 4 % of its error in each trial; at 1.1 the third trial of
    # one servo in six that overshoots is 1.6 times as far off.
    if share >= 1.0 or math.hypot(base.error - saving, missed) <= 1.05 * least:
        return plan
    return replace(plan, requests=base.requests + share * (plan.requests - base.requests))


def _unforeseen(joints: Plan, trials: Sequence[Trial], noise: Array) -> float:
    """Share of the modelled change not to be followed [-]: that of the last trial, beyond noise."""
    if len(trials) < 2:
        return UNFORESEEN
    before, last = trials[-2:]
    unforeseen = np.diff(_disturbances(joints, (before, last)), axis=0)[0]
    by_model = last.mean - before.mean - unforeseen
    random = noise * math.sqrt(1.0 / last.cycles + 1.0 / before.cycles)
    missed = np.sqrt(np.maximum(_by_joint(unforeseen) ** 2 - random**2, 0.0))
    change = _size(joints, _by_joint(by_model))
    if change <= _size(joints, random):
        return UNFORESEEN
    return max(UNFORESEEN, _size(joints, missed) / change)


def _by_joint(angles: Array) -> Array:
    """Root mean square of each joint's angles (n, k) [rad], (k,)."""
    return np.asarray(np.sqrt(np.mean(angles**2, axis=0)))


def _size(joints: Plan, deviations: Array) -> float:
    """Error that deviations of the angles make, rms, by those of each joint [rad], (k,), rms."""
    return joints.task.error_made_by(deviations, joints.predicted)


def _estimated(
    joints: Plan, trials: Sequence[Trial], since: int, noise: Array
) -> tuple[Array, int, float]:
    """Go through all trials: d <- d + gain * learnt(measured - M(R) - d), (21) of docs/math.md.

    A trial that is worse than the best one lowers the gain, unless it was planned on another model,
    before ``since``. The disturbance [rad], (n, k), the trial to start from, and the gain.
    """
    disturbance, gain, base, least = np.zeros_like(trials[0].requests), 1.0, 0, math.inf
    before, off = disturbance, _disturbances(joints, trials)
    for number, trial in enumerate(trials):
        random = _size(joints, measurements.deviation_of(noise)) / math.sqrt(trial.cycles)
        if trial.error <= 1.01 * least + 0.2 * random:  # no worse than noise explains
            gain = 1.0 if number <= since else min(gain * 1.5, 1.0)
            base, before = number, disturbance
            least = min(least, trial.error)
        elif number >= since:
            gain /= 3.0
        innovation = off[base] - before
        power = noise / trials[base].cycles
        disturbance = before + gain * measurements.learnt(
            innovation, power, joints.models, cyclic=joints.cyclic
        )
    return disturbance, base, gain


def _with_trial(
    before: Learning | None, joints: Plan, cycles: Array
) -> tuple[tuple[Trial, ...], int, list[str]]:
    """The trials with a new one, or with more cycles of one of the same requests; its number.

    And remarks. Cycles that do not agree with earlier ones of the same requests are of a changed
    robot: the trials before are left out, so that no two trials have the same requests. Of two
    single cycles the noise is not known.
    """
    trials, sent, remarks = list(before.trials if before else ()), joints.requests, list[str]()
    matches = (np.max(np.abs(trial.requests - sent)) <= SAME_REQUESTS for trial in trials)
    now = next((number for number, same in enumerate(matches) if same), len(trials))
    error = float(joints.task.errors_of(cycles.mean(axis=0))[0])
    if now < len(trials):
        old = trials[now]
        earlier = f"{old.cycles} earlier cycle{'s' * (old.cycles > 1)}"
        single = len(old.measured) == len(cycles) == 1
        if single or measurements.agree(old.measured, cycles, cyclic=joints.cyclic):
            remarks.append(f"{len(cycles)} new and {earlier} of the same requests are averaged")
            cycles = np.concatenate([old.measured, cycles])
            error = float(joints.task.errors_of(cycles.mean(axis=0))[0])
        else:
            remarks.append(
                f"the same requests gave {_text(joints, error)} rms where {earlier} had "
                f"{_text(joints, old.error)}, beyond noise: the robot has changed, or the angles "
                "are of other requests; learning begins anew from the new cycles"
            )
            trials, now = [], 0
    elif len(trials) == 30:  # as many are kept: the last ones and the best
        del trials[int(np.argmax([trial.error for trial in trials]))]
        now -= 1
    trials[now : now + 1] = [Trial(requests=sent.copy(), measured=cycles.copy(), error=error)]
    return tuple(trials), now, remarks


def _floor(new: Plan, before: Learning | None, *, ended: bool) -> float:
    """The error that remains by the lower bound of the model; NaN where it is not known."""
    if new.task.goal == "angles":
        return float(new.lower_bounds[0])
    floor = math.nan if before is None else before.floor[0]
    if not math.isnan(floor) or not ended:
        return floor  # a foot's bound takes seconds
    bound = replace(new, task=replace(new.task, disturbance=None)).foot_bound
    return math.nan if bound is None else bound


def _remaining(joints: Plan, error: float, bound: float, noise: float) -> str:
    """Where the remaining error comes from, in words."""
    text = partial(_text, joints)
    remaining = f"remaining error {text(error)}"
    if noise > error:
        return f"{remaining}: no more than the noise of a cycle, {text(noise)}"
    words = []
    if bound > error:
        words.append("all of it from speed limits by the model")
    elif text(bound) != text(0.0) and not math.isnan(bound):
        words.append(f"{text(bound)} from speed limits")
    if text(noise) != text(0.0):
        words.append(f"{text(noise)} noise of a cycle")
    return f"{remaining}: {', '.join(words)}" if words else remaining


def _text(joints: Plan, error: float) -> str:
    foot = joints.task.goal == "foot"
    return f"{100.0 * error:.3f} cm" if foot else f"{math.degrees(error):.3f} deg"


def reidentified(
    joints: Plan, trials: Sequence[Trial], since: Sequence[int], noise: Array
) -> tuple[Plan, tuple[int, ...], list[str]]:
    """The plan with the models that the trials identify anew, where these predict better.

    With the trial after which the model of each joint was changed last, (k,), and remarks.
    ``noise`` is the standard deviation of one cycle's [rad], (k,).
    """
    models, last, remarks = list(joints.models), list(since), list[str]()
    for j, model in enumerate(joints.models):
        better = better_model(model, joints, trials, j, float(noise[j]))
        if better is not None:
            models[j], last[j] = better, len(trials) - 1
            of = "" if len(models) == 1 else f" of joint {j + 1}"
            remarks.append(
                f"the model{of} was identified anew from the measured cycles: it predicts a trial "
                "that it had not seen better than the model as it was and what was learnt with it"
            )
    if remarks:
        joints = replace(joints, task=joints.task.with_models(models))
    return joints, tuple(last), remarks


def better_model(
    model: JointModel, joints: Plan, trials: Sequence[Trial], j: int, noise: float
) -> JointModel | None:
    """A model of joint j identified from the trials, if it predicts the last one better; else None.

    The last trial is predicted with the disturbance of the trial before it. ``noise`` is the
    deviation of one cycle's [rad].
    """
    if len(trials) < 2:
        return None
    cyclic, start, load = joints.cyclic, joints.task.starts[j], joints.task.loads[j]
    pairs = [(trial.requests[:, j], trial.mean[:, j]) for trial in trials]
    (before, angles), (sent, target) = pairs[-2:]

    def missed(by: JointModel) -> float:
        first, last = (
            simulate(by, each, cyclic=cyclic, start=start, load=load) for each in (before, sent)
        )
        return rms(last - first + angles - target)

    with suppress(PlannerError):  # no motion to identify from, or no steady cycle
        now, random = missed(model), noise / math.sqrt(trials[-1].cycles)
        if now > max(2.0 * random, 0.002 * float(np.ptp(target))):  # else learning copes with it
            logs = [_log(model, *each, cyclic=cyclic, load=load) for each in pairs[-5:]]
            candidate = _identified(model, logs[:-1])
            if candidate is not None and missed(candidate) <= 0.7 * now:
                return _identified(model, logs[-4:])
    return None


def _log(
    model: JointModel, requests: Array, angles: Array, *, cyclic: bool, load: Array | None
) -> Log:
    """A cycle twice, or a motion after some rest: all requests that act are known."""
    n = len(requests)  # and 20 rows are more than any lag
    rows = np.arange(2 * n) % n if cyclic else np.maximum(np.arange(-20, n), 0)
    return Log(
        times=model.period * np.arange(len(rows), dtype=np.float64),
        requests=requests[rows],
        angles=angles[rows],
        load=None if load is None else load[rows],
        name="executed cycles",
    )


def _identified(model: JointModel, logs: Sequence[Log]) -> JointModel | None:
    """The model of the logs; a top speed that they do not show remains as it was."""
    result = identify(logs, tick=model.tick, hold=model.hold, hold_out=False)
    if not result.accepted:
        return None
    candidate = replace(result.model, tick=model.tick)
    if not result.saturates and candidate.v_max < model.v_max:
        stretch = model.v_max / candidate.v_max
        candidate = replace(candidate, v_max=model.v_max, theta_0=candidate.theta_0 * stretch)
    return candidate


def in_a_cycle(
    models: Sequence[JointModel], requests: Array, measured: Array, starts: Sequence[float]
) -> bool:
    """Whether joints were in their steady cycle, not at rest at ``starts``: angles in rad."""
    try:
        cycle = simulate_joints(models, requests, cyclic=True)
    except NoSteadyCycle:
        return False
    apart = cycle - simulate_joints(models, requests, cyclic=False, starts=starts)
    toward = np.sum(apart * (measured.mean(axis=0) - cycle + apart))
    return bool(np.max(np.abs(apart)) > np.radians(0.5) and toward >= 0.5 * np.sum(apart**2))
