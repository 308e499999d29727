"""The step test: Equation 1 of the paper."""

from __future__ import annotations

import math

import numpy as np

from planner.exceptions import InvalidInput
from planner.trajectory import MOST_SAMPLES, Array
from planner.validation import as_number, as_whole, shown


def step_test(amplitude: float, *, samples: int = 88) -> Array:
    """Requests of one cycle of the step test: ``amplitude`` for the first half, 0 for the second.

    Args:
        amplitude: theta_test of Equation 1 [rad].
        samples: Requests in one cycle, t_step of the paper; even, at least 2.

    Returns:
        Requests [rad], shape (samples,).

    Raises:
        InvalidInput: The amplitude is not finite, or the cycle cannot be halved.

    Example:
        >>> import numpy as np
        >>> np.degrees(step_test(0.5, samples=8)).round(1)
        array([28.6, 28.6, 28.6, 28.6,  0. ,  0. ,  0. ,  0. ])
    """
    angle = as_number(amplitude)
    if math.isnan(angle):
        raise InvalidInput(f"amplitude: got {shown(amplitude)}, expected a finite angle [rad]")
    count = as_whole(samples) or 0
    if not 2 <= count <= MOST_SAMPLES or count % 2:
        raise InvalidInput(
            f"samples: got {shown(samples)}, expected an even number, 2 to {MOST_SAMPLES}"
        )
    requests = np.zeros(count)
    requests[: count // 2] = angle
    requests.setflags(write=False)
    return requests
