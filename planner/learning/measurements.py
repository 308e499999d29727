"""Measured cycles: refused where they cannot belong to the requests, delays of sensors, learning.

The disturbance ``d = mean measured - modelled angles`` repeats from cycle to cycle, the noise does
not: its spectrum is shrunk as by a Wiener filter. A pure delay that explains most of it is taken
off the measured angles first, where it is too long to be the joint's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.ndimage import convolve1d

from planner.arrays import LARGEST, Array, as_reals, rms
from planner.exceptions import InvalidTrajectory, angle_text
from planner.learning.trials import SensorDelay, Trial
from planner.model.joint import JointModel
from planner.planning.line_inverse import advanced
from planner.planning.plan import Plan

COUNT = 2.0 * math.pi / 4096.0  # count of a sensor of 12 bit [rad]

STILL, MOVING = 1.5 * COUNT, 15.0 * COUNT
"""Range of a joint that does not move, its reading flipping between two counts, and of the modelled
angles from which on it should have moved [rad]."""

EQUAL, REPEATED = 1e-4, 1e-9
"""Angles that differ by less, everywhere, are the same [rad]: as files carry them, rounded to a
hundredth of a degree or finer; and unrounded, of one cycle."""

LAGGING = 1e-3
"""Range of modelled angles less requests from which on they should not be equal [rad]."""

NOT_MEASURED = "no joint follows so exactly; give what its sensor measured"


def checked_cycles(measured: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Measured cycles [rad], (cycles, *shape); InvalidTrajectory for others."""
    try:
        rows = as_reals(measured)
    except (TypeError, ValueError) as error:
        raise InvalidTrajectory(f"measured: {error}; expected angles [rad]") from error
    if rows.shape == shape:
        rows = rows[np.newaxis]
    if rows.ndim != len(shape) + 1 or rows.shape[1:] != shape or not len(rows):
        inner = ", ".join(map(str, shape))
        raise InvalidTrajectory(
            f"measured: got shape {rows.shape}, expected ({inner}{',' if len(shape) == 1 else ''}) "
            f"or (cycles, {inner}): one angle for each request of the plan"
        )
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        cycle, row = bad[0][:2]
        raise InvalidTrajectory(
            f"measured: {len(bad)} of {rows.size} angles are not finite, the first in cycle "
            f"{cycle}, row {row}; leave out the cycles in which samples are missing"
        )
    if np.max(np.abs(rows), initial=0.0) > LARGEST:
        raise InvalidTrajectory(
            f"measured: got {np.max(np.abs(rows)):g}, expected at most {LARGEST:g} rad; check "
            "the unit"
        )
    return rows


def settled(cycles: Array) -> Array:
    """The cycles, without a first one that is on the way in: off by four standard deviations."""
    if len(cycles) < 3:
        return cycles
    later = cycles[1:]
    spread, first = rms(later - later.mean(axis=0)), rms(cycles[0] - later.mean(axis=0))
    count = float(np.max(np.ptp(later, axis=1)))
    return later if first > max(4.0 * spread, 0.01 * count) else cycles


def agree(first: Array, second: Array, *, cyclic: bool) -> bool:
    """Whether batches of cycles of the same requests, (cycles, n, k) [rad], may be averaged.

    The means of each joint differ, rms, by at most three standard deviations of that difference, by
    the noise within the batches, or 0.5 % of the range, as few cycles hide slow changes, or a count
    of a sensor.
    """
    mean, scale = first.mean(axis=0), math.sqrt(1.0 / len(first) + 1.0 / len(second))
    apart = (second.mean(axis=0) - mean) / scale  # with the noise of one cycle
    noise = deviation_of(noise_of([first, second], apart, cyclic=cyclic))
    most = np.maximum(3.0 * noise, np.maximum(0.005 * np.ptp(mean, axis=0), STILL) / scale)
    return bool(np.all(np.mean(apart**2, axis=0) <= most**2))


def check_angles(
    cycles: Array, requests: Array, desired: Array, modelled: Array, expected: Array
) -> None:
    """Refuse angles in another unit, joints that do not move, and other angles than measured ones.

    Cycles are (cycles, n, k), the others (n, k), all in rad; those ``expected`` are the modelled
    ones plus the disturbance of the trial before.
    """
    moved = modelled - modelled.mean(axis=0)
    power = float(np.vdot(moved, moved))
    ratio = float(np.vdot(cycles.mean(axis=0), moved)) / power if power else 0.0
    least, most = 40.0, 80.0  # degrees, or radians read as degrees, differ by 57.3
    if least < ratio < most:
        raise InvalidTrajectory(
            f"measured: the angles move {ratio:.0f} times as far as the model: are they degrees? "
            "expected radians; convert them with numpy.radians"
        )
    should_move = np.ptp(modelled, axis=0) > MOVING
    if np.any(should_move) and 1.0 / most < ratio < 1.0 / least:
        raise InvalidTrajectory(
            f"measured: the angles move 1/{1.0 / ratio:.0f} as far as the model: are they radians "
            "that were taken for degrees? check the unit of the file, or convert them once only"
        )
    for j in range(modelled.shape[1]):
        of, measured = _joint(j, modelled), cycles[:, :, j]
        sent, goal, model = requests[:, j], desired[:, j], modelled[:, j]
        away = float(np.max(np.abs(expected[:, j] - goal)))
        equal = EQUAL if away > LAGGING else REPEATED
        lags = np.ptp(model - sent) > LAGGING
        moves = np.ptp(goal) > MOVING and away > equal
        if should_move[j] and np.ptp(measured) <= STILL:
            fault = (
                f"{of} does not move: its angles have a range of "
                f"{angle_text(np.ptp(measured), digits=2)}, the model's of "
                f"{angle_text(np.ptp(model), digits=2)}; check that its torque was on, and that "
                "the recording is of this joint"
            )
        elif lags and np.max(np.abs(measured - sent)) <= EQUAL:
            fault = f"the angles of {of} are its requests: {NOT_MEASURED}"
        elif moves and np.max(np.abs(measured - goal)) <= equal:
            fault = f"the angles of {of} are the desired ones: {NOT_MEASURED}"
        else:
            continue
        raise InvalidTrajectory(f"measured: {fault}")


def check_trial(
    cycles: Array,
    modelled: Array,
    trials: Sequence[Trial],
    before: Sequence[Array],
    models: Sequence[JointModel],
) -> None:
    """Refuse another motion or zero, and a cycle already measured under other requests.

    ``modelled`` and ``before`` are the angles of the models in this and in earlier trials [rad],
    (n, k). From a motion farther from them than a joint at rest learning could not converge.
    """
    # A load explains so much [rad]. A joint in shares of its range has no other zero, and may hold.
    most = [math.inf if each.unit == "1" else math.radians(30.0) for each in models]
    missed = cycles.mean(axis=0) - modelled
    shift = np.mean(missed, axis=0)
    for j in np.flatnonzero(np.abs(shift) > most).tolist():
        raise InvalidTrajectory(
            f"measured: the angles of {_joint(j, modelled)} are on average "
            f"{angle_text(shift[j], digits=2)} from those of the model, which no load or friction "
            "explains: is their zero another one, or are they of another joint? give angles from "
            "the zero of the requests"
        )
    away = np.std(missed, axis=0)
    resting = np.std(modelled, axis=0)
    should_move = np.ptp(modelled, axis=0) > MOVING
    for j in np.flatnonzero(should_move & (away > resting + STILL)).tolist():
        raise InvalidTrajectory(
            f"measured: the angles of {_joint(j, modelled)} are {angle_text(away[j], digits=2)} "
            "rms from those of the model under these requests, farther than a joint that does not "
            f"move ({angle_text(resting[j], digits=2)}): give what was measured while these "
            "requests were executed, of this joint and with its sign"
        )
    for number, (trial, angles) in enumerate(zip(trials, before, strict=True), start=1):
        apart = np.abs(trial.measured[:, np.newaxis] - cycles).max(axis=(2, 3))
        if np.max(np.abs(modelled - angles)) > LAGGING and np.any(apart <= REPEATED):
            raise InvalidTrajectory(
                f"measured: the same angles as in trial {number}, whose requests were others; give "
                "what was measured while the last requests were executed"
            )


def _joint(j: int, angles: Array) -> str:
    return "the joint" if angles.shape[1] == 1 else f"joint {j + 1}"


def delays_to_remove(joints: Plan, cycles: Array, modelled: Array) -> list[float]:
    """The delay to take off the measured angles (cycles, n, k) of each joint [s]: a sensor's."""
    removed = []
    for j, delay in enumerate(delays_of(joints, cycles, modelled, [0.0] * len(joints.models))):
        seconds = delay.seconds if delay.share >= 0.9 else 0.0
        latency = joints.models[j].latency
        if -seconds > latency:
            raise InvalidTrajectory(
                f"measured: the angles of {_joint(j, modelled)} come {-1e3 * seconds:.3g} ms "
                f"earlier than the model's, and its latency is {1e3 * latency:.3g} ms: no joint "
                "answers before its request; are requests and measured angles exchanged?"
            )
        # A shorter one may be the joint's: parameters 30 % off make its latency wrong by 46 %.
        removed.append(seconds if seconds > 0.5 * latency else 0.0)
    return removed


def delays_of(
    joints: Plan, cycles: Array, modelled: Array, removed: Sequence[float]
) -> tuple[SensorDelay, ...]:
    """The delay beside the removed one that explains most, for each joint."""
    delays = []
    for angles, by_model, seconds in zip(cycles.mean(axis=0).T, modelled.T, removed, strict=True):
        delay, share = pure_delay(angles, by_model, cyclic=joints.cyclic)
        delay *= joints.period
        delays.append(SensorDelay(seconds=delay, share=share, removed=seconds))
    return tuple(delays)


def earlier(cycles: Array, removed: Sequence[float], joints: Plan) -> Array:
    """The cycles with the sensors' delays taken off [rad], (cycles, n, k)."""
    if not any(removed):
        return cycles
    columns = [
        [advanced(angles, late / joints.period, cyclic=joints.cyclic) for angles in cycles[:, :, j]]
        for j, late in enumerate(removed)
    ]
    return np.moveaxis(np.array(columns), 0, -1)


def remarks_on_delays(joints: Plan, delays: Sequence[SensorDelay], noise: Array) -> list[str]:
    """Remarks on delays that were taken off, and on those that might be a sensor's."""
    remarks = []
    speeds = np.sqrt(np.mean(np.diff(joints.requests, axis=0) ** 2, axis=0)) / joints.period
    for j, delay in enumerate(delays):
        of = "" if len(delays) == 1 else f" of joint {j + 1}"
        late = abs(delay.seconds)
        clear = late >= 0.25 * joints.period and late * speeds[j] > 2.0 * noise[j]
        if delay.removed:
            remarks.append(
                f"the measured angles{of} are taken to be {1e3 * delay.removed:.3g} ms late, by "
                "their sensor or log; that is not learnt. If the joint itself is that late: "
                "sensor_delay=0"
            )
        elif delay.share >= 0.8 and clear:
            share = f"{100.0 * delay.share:.0f} % of what the model misses{of} is"
            remarks.append(
                f"{share} that the joint answers {1e3 * late:.3g} ms earlier than the model: that "
                "is learnt"
                if delay.seconds < 0.0
                else f"{share} a delay of {1e3 * late:.3g} ms: it is learnt as the joint's. If the "
                f"sensor or the log is late by it: sensor_delay={late:.3g}"
            )
    return remarks


def pure_delay(measured: Array, modelled: Array, *, cyclic: bool) -> tuple[float, float]:
    """The delay behind the modelled angles (n,) that explains most of the disturbance [samples].

    And the share of the squared disturbance about its mean that it explains.
    """

    def unexplained(delay: float) -> float:
        return float(np.var(measured - advanced(modelled, -delay, cyclic=cyclic)))

    whole = unexplained(0.0)
    if whole <= np.finfo(np.float64).tiny or not np.ptp(modelled):
        return 0.0, 0.0
    reach = max(min(len(modelled) // 8, 50), 1)
    grid = [float(k) for k in range(-reach, reach + 1)]
    errors = [*map(unexplained, grid)]
    middle = int(np.argmin(errors))
    best, least = grid[middle], errors[middle]
    # A parabola through the least value and its neighbours: a fraction of a sample.
    if 0 < middle < len(grid) - 1:
        before, after = errors[middle - 1], errors[middle + 1]
        bend = before - 2.0 * least + after
        if bend > 0.0:
            trial = best + 0.5 * (before - after) / bend
            least, best = min((least, best), (unexplained(trial), trial))
    return best, max(1.0 - least / whole, 0.0)


LATENCY_ERROR = 0.3
"""Share of the model's latency by which it may be wrong [-]. What is learnt falls with the cosine
of the phase error that this makes, and is nothing from a quarter of a period on: from there a
correction by the model could make the error larger."""


def _transforms(*, cyclic: bool) -> tuple[Any, Any]:
    """To the orthonormal spectrum of axis -2 and back: of Fourier in a cycle, else of cosines."""
    pair: tuple[Any, Any] = (fft.rfft, fft.irfft) if cyclic else (fft.dct, fft.idct)
    forward, backward = (partial(each, norm="ortho", axis=-2) for each in pair)
    return forward, backward


def noise_of(trials: Sequence[Array], error: Array, *, cyclic: bool) -> Array:
    """Power of the noise of one measured cycle at every frequency [rad^2], (f, k).

    The larger of the variance between the cycles of each trial, (cycles, n, k), and of the upper
    half of the frequencies of the ``error``, (n, k), at which a joint hardly moves.
    """
    forward, _ = _transforms(cyclic=cyclic)
    powers = np.abs(forward(error)) ** 2
    upper = powers[len(powers) // 2 :]
    median = math.log(2.0) if cyclic else 0.4549  # of a power of mean 1, chi-square distributed
    floor = np.broadcast_to(np.median(upper, axis=0) / median, powers.shape)
    spread, freedom = np.zeros_like(powers), 0
    for measured in trials:
        spread += np.sum(np.abs(forward(measured - measured.mean(axis=0))) ** 2, axis=0)
        freedom += len(measured) - 1
    if not freedom:
        return np.array(floor)
    between = averaged(spread / freedom, 4)  # more than of one power: there are few cycles
    return np.asarray(np.maximum(between, floor))


def deviation_of(noise: Array) -> Array:
    """Standard deviation of noise of this power, rms over the samples [rad], (k,)."""
    return np.asarray(np.sqrt(noise.mean(axis=0)))


def averaged(powers: Array, neighbours: int) -> Array:
    """Powers averaged over so many neighbouring frequencies on either side, (f, k)."""
    sums, counts = (
        convolve1d(each, np.ones(2 * neighbours + 1), axis=0, mode="constant")
        for each in (powers, np.ones_like(powers))
    )
    return np.asarray(sums / counts)


def learnt(innovation: Array, noise: Array, models: Sequence[JointModel], *, cyclic: bool) -> Array:
    """The part of an innovation to learn, (n, k): less noise, where the models' phase is certain.

    ``F^-1 [cos(min(2 pi f e, pi/2)) max(0, 1 - c N(f) / S(f)) F [innovation]]``, with S the power
    of the innovation, N that of its noise [rad^2], (f, k), and e the latency's error.
    """
    forward, backward = _transforms(cyclic=cyclic)
    spectrum = forward(innovation)
    power = averaged(np.abs(spectrum) ** 2, 2)
    # A periodogram averaged over a few frequencies exceeds its mean by as much now and then.
    shrinkage = 1.0 - 2.0 * noise / np.maximum(power, np.finfo(np.float64).tiny)
    count = len(innovation)
    hertz = np.arange(len(spectrum)) / ((1 if cyclic else 2) * count * models[0].period)
    late = LATENCY_ERROR * np.array([model.latency for model in models])
    trust = np.cos(np.minimum(2.0 * np.pi * np.outer(hertz, late), np.pi / 2.0))
    return np.asarray(backward(trust * np.maximum(shrinkage, 0.0) * spectrum, n=count))
