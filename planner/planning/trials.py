"""Trials: the executed cycles that a plan has learnt from, and the state of learning."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.trajectory import Array
from planner.validation import freeze

UNFORESEEN = 0.2
"""Share of a change of the angles by the model that a joint is expected not to make [-]. (Of 33
first trials on servos from their physics the middle half missed 0.13 to 0.28 of it; by the model
alone their errors were up to five times those predicted.)"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Requests as they were executed, in one cycle or in several.

    Attributes:
        requests: What was sent to the joints [rad], shape (n, k).
        measured: What their sensors said in each cycle [rad], shape (cycles, n, k), known delays
            of the sensors taken off.
        error: Error of the mean cycle, in the norm of the plan: [rad], or [m] for a foot.
    """

    requests: Array
    measured: Array
    error: float

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze(self.requests, self.measured)

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
    """What of the disturbance would be explained by sensors that are late.

    Attributes:
        seconds: The delay of the measured angles behind the model that fits best [s].
        share: Share of the squared disturbance that it explains [-].
        removed: Delay that was taken off the measured angles before anything was learnt [s].
    """

    seconds: float
    share: float
    removed: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Learning:
    """The state of learning: with the plan it is all that the next cycle needs.

    Attributes:
        trials: The executed requests, oldest first, as many as are kept.
        noise: Standard deviation of one cycle about the mean of many, rms over samples [rad], (k,).
        gain: Share of the disturbance last found that the requests compensate for, 0 to 1.
        reidentified: The trials after which each joint's model was changed last, one a joint; 0
            where it is that of the first plan.
        delays: What a late sensor would explain, for each joint.
        best: The trial from which the requests were made.
        floor: What of the error of the best trial cannot be learnt: ``speed``, from the lower bound
            of the model, and ``noise``, in the unit of the trials' errors; ``nan`` where unknown.
        next_error: Error to expect of one measured cycle of the next requests, in the unit of the
            trials' errors: that of the models with the disturbance as it was measured in the best
            trial, its noise and what was not learnt included, and a share of what the requests
            change; ``nan`` where unknown.
        stopped: Why there is nothing more to learn; empty while there is.
        remarks: What was done with the measurements, in words.
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

    @property
    def errors(self) -> Array:
        """Error of each trial: [rad], or [m] for a foot, shape (trials,)."""
        return np.array([trial.error for trial in self.trials])
