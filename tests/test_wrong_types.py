"""Things of another type at the public entrances: one clear error, never a bare one of Python's."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import planner
from planner.exceptions import InvalidInput, InvalidModel

JOINT = planner.JointModel.ers210a()
ANGLES = np.sin(np.arange(30.0) / 5.0)

ENTRANCES = {
    "simulate": lambda model: planner.simulate(model, ANGLES),
    "line_offset": lambda model: planner.line_offset(model, 1.0),
    "invert_closed_form": lambda model: planner.invert_closed_form(model, ANGLES),
    "invert_optimal": lambda model: planner.invert_optimal(model, ANGLES),
    "lower_bound": lambda model: planner.lower_bound(model, ANGLES),
}


@pytest.mark.parametrize("model", ["x", None, {}, 3])
@pytest.mark.parametrize("entrance", ENTRANCES)
def test_what_is_no_model_is_refused_by_its_type(entrance, model):
    expected = rf"model: got {type(model).__name__}, expected a planner\.JointModel"
    with pytest.raises(InvalidModel, match=expected):
        ENTRANCES[entrance](model)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: planner.line_offset(JOINT, "fast"), "slope: got 'fast'"),
        (lambda: planner.line_offset(JOINT, 1.0 + 1.0j), "slope: got "),
        (lambda: planner.line_offset(JOINT, True), "slope: got True"),
        (lambda: planner.invert_optimal(JOINT, ANGLES, tolerance="a"), "tolerance: got 'a'"),
        (lambda: planner.invert_optimal(JOINT, ANGLES, tolerance=0.0), "tolerance: got 0.0"),
        (lambda: planner.step_test("a"), "amplitude: got 'a'"),
        (lambda: planner.step_test(1.0, samples=4.0), "samples: got 4.0"),
        (
            lambda: planner.lower_bound(JOINT, ANGLES, level="exact", time_limit=-1),
            "time_limit: got -1",
        ),
        (
            lambda: planner.lower_bound(JOINT, ANGLES, level="exact", time_limit=float("nan")),
            "time_limit: got nan",
        ),
    ],
)
def test_a_value_of_another_kind_is_named(call, message):
    with pytest.raises(InvalidInput, match=f"^{message}"):
        call()


def test_arrays_that_come_back_cannot_be_written_to():
    for array in (planner.line_offset(JOINT, [0.0, 1.0]), planner.step_test(1.0)):
        assert not array.flags.writeable


CURVE = planner.PiecewiseLinear(knots=[0, 5], values=[0.0, 1.0], samples=9, tick=0.01, cyclic=True)
VALUES = (
    planner.Log(times=np.arange(30.0), requests=ANGLES, angles=ANGLES),
    CURVE,
    planner.CurveStack.of([CURVE]),
    planner.fit_pwl(ANGLES, v_max=9.0, tick=0.1, segments=4),
    planner.Trial(
        requests=ANGLES[:, np.newaxis], measured=ANGLES[np.newaxis, :, np.newaxis], error=0.0
    ),
)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_of_values_cannot_be_written_to(value, copied):
    arrays = [each for each in vars(copied(value)).values() if isinstance(each, np.ndarray)]
    assert arrays
    assert not any(array.flags.writeable for array in arrays)
