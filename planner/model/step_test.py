"""The step test: Equation 1 of the paper, and what one reads off the joint's answer."""

from __future__ import annotations

import math
import operator

import numpy as np

from planner.exceptions import InvalidInput
from planner.trajectory import Array


def step_test(amplitude: float, *, samples: int = 88) -> Array:
    """Requests of one cycle of the step test: ``amplitude`` for the first half, 0 for the second.

    Args:
        amplitude: theta_test of Equation 1 [rad].
        samples: Requests in one cycle, t_step of the paper; even, at least 2.

    Returns:
        Requests [rad], shape (samples,).

    Raises:
        InvalidInput: The amplitude is not finite, or the cycle cannot be halved.
    """
    try:
        angle = float(amplitude)
    except (TypeError, ValueError, OverflowError):
        angle = math.nan
    if not math.isfinite(angle):
        raise InvalidInput(f"amplitude: got {amplitude!r}, expected a finite angle [rad]")
    try:
        count = operator.index(samples)
    except TypeError:
        count = 0
    if count < 2 or count % 2:
        raise InvalidInput(f"samples: got {samples!r}, expected an even number, 2 or more")
    requests = np.zeros(count)
    requests[: count // 2] = angle
    requests.setflags(write=False)
    return requests
