"""Measured cycles that cannot belong to the requests: refused before anything is learnt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.exceptions import InvalidTrajectory, angle_text
from planner.planning.trials import Trial
from planner.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class MeasurementOptions:
    """Thresholds beyond which measured angles are refused.

    Attributes:
        still: Range of a joint that does not move [rad]: its reading flips between two counts of a
            sensor of 12 bit, and not more.
        moving: Range of the modelled angles from which on the joint should have moved [rad].
        equal: Measured angles that differ from the requests by less, everywhere, are the requests
            [rad]: files carry them rounded, to a hundredth of a degree or finer.
        lagging: Range of modelled angles less requests from which on they should not be [rad].
        repeated: Two cycles that differ by less, everywhere, are one [rad].
        degrees: Measured over modelled motion [-] from which angles look like degrees: 57.3, a bit
            off; and by one over it like radians that were read as degrees.
    """

    still: float = 1.5 * 2.0 * math.pi / 4096.0
    moving: float = 15.0 * 2.0 * math.pi / 4096.0
    equal: float = 1e-4
    lagging: float = 1e-3
    repeated: float = 1e-9
    degrees: tuple[float, float] = (40.0, 80.0)


OPTIONS = MeasurementOptions()


def check_angles(
    cycles: Array, requests: Array, desired: Array, modelled: Array, expected: Array
) -> None:
    """Refuse angles in another unit, joints that do not move, and other angles than measured ones.

    Desired angles are refused where they are not to be expected, as in a rounded file, else only if
    they are equal to the last digits.

    Args:
        cycles: Measured angles [rad], (cycles, n, k).
        requests: Executed requests [rad], (n, k).
        desired: Desired angles [rad], (n, k).
        modelled: Angles of the models under the requests [rad], (n, k).
        expected: The same plus the disturbance of the trial before [rad], (n, k).

    Raises:
        InvalidTrajectory: The angles cannot be those of the joints.
    """
    moved = modelled - modelled.mean(axis=0)
    power = float(np.vdot(moved, moved))
    ratio = float(np.vdot(cycles.mean(axis=0), moved)) / power if power else 0.0
    least, most = OPTIONS.degrees
    if least < ratio < most:
        raise InvalidTrajectory(
            f"measured: the angles move {ratio:.0f} times as far as the model: are they degrees? "
            "expected radians; convert them with numpy.radians"
        )
    should_move = np.ptp(modelled, axis=0) > OPTIONS.moving
    if np.any(should_move) and 1.0 / most < ratio < 1.0 / least:
        raise InvalidTrajectory(
            f"measured: the angles move 1/{1.0 / ratio:.0f} as far as the model: are they radians "
            "that were taken for degrees? check the unit of the file, or convert them once only"
        )
    for j in range(modelled.shape[1]):
        of, measured = _joint(j, modelled), cycles[:, :, j]
        if should_move[j] and np.ptp(measured) <= OPTIONS.still:
            raise InvalidTrajectory(
                f"measured: {of} does not move: its angles have a range of "
                f"{angle_text(np.ptp(measured), digits=2)}, the model's of "
                f"{angle_text(np.ptp(modelled[:, j]), digits=2)}; check that its torque was on, "
                "and that the recording is of this joint"
            )
        lags = float(np.ptp(modelled[:, j] - requests[:, j])) > OPTIONS.lagging
        if lags and np.max(np.abs(measured - requests[:, j])) <= OPTIONS.equal:
            raise InvalidTrajectory(
                f"measured: the angles of {of} are its requests: no joint follows so exactly; give "
                "what its sensor measured"
            )
        away = float(np.max(np.abs(expected[:, j] - desired[:, j])))
        equal = OPTIONS.equal if away > OPTIONS.lagging else OPTIONS.repeated
        moves = np.ptp(desired[:, j]) > OPTIONS.moving and away > equal
        if moves and np.max(np.abs(measured - desired[:, j])) <= equal:
            raise InvalidTrajectory(
                f"measured: the angles of {of} are the desired ones: no joint follows so exactly; "
                "give what its sensor measured"
            )


def check_trial(
    cycles: Array, modelled: Array, trials: Sequence[Trial], before: Sequence[Array]
) -> None:
    """Refuse another motion, and a cycle that was already measured under other requests.

    A motion is another one where it is farther from the modelled angles than that of a joint that
    does not move. Learning from it could not converge: a correction by the model would be off by
    more than the whole of it.

    Args:
        cycles: Measured angles [rad], (cycles, n, k), the sensors' delays taken off.
        modelled: Angles of the models under the executed requests [rad], (n, k).
        trials: The trials before.
        before: Angles of the models in each of them [rad], (n, k).

    Raises:
        InvalidTrajectory: They are of another motion, or of an earlier trial whose requests
            differ by the model.
    """
    away = np.std(cycles.mean(axis=0) - modelled, axis=0)
    resting = np.std(modelled, axis=0)
    should_move = np.ptp(modelled, axis=0) > OPTIONS.moving
    for j in np.flatnonzero(should_move & (away > resting + OPTIONS.still)).tolist():
        raise InvalidTrajectory(
            f"measured: the angles of {_joint(j, modelled)} are {angle_text(away[j], digits=2)} "
            "rms from those of the model under these requests, farther than a joint that does not "
            f"move ({angle_text(resting[j], digits=2)}): give what was measured while these "
            "requests were executed, of this joint and with its sign"
        )
    for number, (trial, angles) in enumerate(zip(trials, before, strict=True), start=1):
        apart = np.abs(trial.measured[:, np.newaxis] - cycles).max(axis=(2, 3))
        differ = np.max(np.abs(modelled - angles)) > OPTIONS.lagging
        if differ and np.any(apart <= OPTIONS.repeated):
            raise InvalidTrajectory(
                f"measured: the same angles as in trial {number}, whose requests were others; give "
                "what was measured while the last requests were executed"
            )


def _joint(j: int, angles: Array) -> str:
    return "the joint" if angles.shape[1] == 1 else f"joint {j + 1}"
