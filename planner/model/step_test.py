"""The step test: Equation 1 of the paper, and what one reads off the joint's answer."""

from __future__ import annotations

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
    if not np.isfinite(amplitude):
        raise InvalidInput(f"amplitude: got {amplitude}, expected a finite angle [rad]")
    if samples < 2 or samples % 2:
        raise InvalidInput(f"samples: got {samples}, expected an even number, 2 or more")
    requests = np.zeros(samples)
    requests[: samples // 2] = amplitude
    return requests
