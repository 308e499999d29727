"""Executed cycles, and what a plan has learnt from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, ReadOnly, Summarised, Summary, freeze


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trial(ReadOnly, Summarised):
    """Requests as they were executed, in one cycle or in several.

    Attributes:
        requests: Sent requests [rad], shape (n, k).
        measured: Measured angles of each cycle [rad], shape (cycles, n, k), without known delays of
            the sensors.
        error: Error of the mean cycle, in the norm of the plan: [rad], or [m] for a foot.
    """

    requests: Array
    measured: Array
    error: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze(self.requests, self.measured)

    def _summarised(self) -> Summary:
        """Its cycles and its error."""
        return Summary(f"Trial of {self.cycles} cycles: error {self.error:.4g} rad (foot: m)")

    @property
    def mean(self) -> Array:
        """Mean of the measured cycles [rad], shape (n, k)."""
        mean: Array = self.measured.mean(axis=0)
        return mean

    @property
    def cycles(self) -> int:
        """Number of measured cycles."""
        return len(self.measured)


@dataclass(frozen=True, kw_only=True)
class SensorDelay:
    """The part of the disturbance that late sensors would explain.

    Attributes:
        seconds: The delay of the measured angles behind the model that fits best [s].
        share: Share of the squared disturbance that it explains [-].
        removed: Delay removed from the measured angles before learning [s].
    """

    seconds: float
    share: float
    removed: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Learning(ReadOnly, Summarised):
    """The state of learning: all data, beside the plan, for the next cycle.

    Attributes:
        trials: The executed trials, oldest first.
        noise: Standard deviation of one cycle about the mean of many, rms over samples [rad], (k,).
        gain: Learning gain: share of the last disturbance that the requests compensate, 0 to 1.
        reidentified: The trial after which each joint's model was changed last, one a joint; 0
            for the model of the first plan.
        delays: The effect of a late sensor, for each joint.
        best: The trial from which the requests were computed.
        floor: Error of the best trial that cannot be learnt: ``speed``, from the lower bound of the
            model, and ``noise``, in the unit of the trials' errors; ``nan`` where unknown.
        next_error: Error to expect of the next requests, of the mean of as many cycles as were
            measured last, in the unit of the trials' errors: from the models with the disturbance
            measured in the best trial, its noise and unlearnt part included, and a share of the
            change by the new requests; ``nan`` where unknown.
        stopped: Why learning has ended; empty while it continues.
        remarks: Remarks on the processing of the measurements.
    """

    trials: tuple[Trial, ...]
    noise: Array
    gain: float
    reidentified: tuple[int, ...]
    delays: tuple[SensorDelay, ...]
    best: int
    floor: tuple[float, float]
    next_error: float = math.nan
    stopped: str = ""
    remarks: tuple[str, ...] = ()

    def _summarised(self) -> Summary:
        """The error of each trial, and what is expected of the next, or why there is none."""
        rows = [
            (f"{number}", f"{trial.cycles}", f"{trial.error:.4g}")
            for number, trial in enumerate(self.trials, start=1)
        ]
        rest = f"ended: {self.stopped}" if self.stopped else f"next error {self.next_error:.4g}"
        plural = "s" * (len(rows) > 1)
        head = f"Learning from {len(rows)} trial{plural}, the best is {self.best + 1}; {rest}"
        return Summary(head, ("trial", "cycles", "error [rad, foot: m]"), rows)

    @property
    def errors(self) -> Array:
        """Error of each trial: [rad], or [m] for a foot, shape (trials,)."""
        return np.array([trial.error for trial in self.trials])
