"""Things of another type at the public entrances: one clear error, never a bare one of Python's."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import planner

ANGLES = np.sin(np.arange(30.0) / 5.0)

CURVE = planner.PiecewiseLinear(knots=[0, 5], values=[0.0, 1.0], samples=9, tick=0.01, cyclic=True)
VALUES = {
    "Log": lambda: planner.Log(times=np.arange(30.0), requests=ANGLES, angles=ANGLES),
    "PiecewiseLinear": lambda: CURVE,
    "CurveStack": lambda: planner.CurveStack.of([CURVE]),
    "fit": lambda: planner.fit_pwl(ANGLES, v_max=9.0, tick=0.1, segments=4),
    "Trial": lambda: planner.Trial(
        requests=ANGLES[:, np.newaxis], measured=ANGLES[np.newaxis, :, np.newaxis], error=0.0
    ),
}


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_of_values_cannot_be_written_to(name, copied):
    value = VALUES[name]()
    arrays = [each for each in vars(copied(value)).values() if isinstance(each, np.ndarray)]
    assert arrays
    assert not any(array.flags.writeable for array in arrays)
