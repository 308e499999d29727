"""The contract of `import planner`: names, cost, examples in docstrings, and one clear error."""

import copy
import doctest
import inspect
import pickle
import sys

import numpy as np
import pytest

import kinematics
import planner
import planner.exceptions

FINDER = doctest.DocTestFinder(exclude_empty=True)


@pytest.mark.parametrize("package", [planner, kinematics], ids=["planner", "kinematics"])
def test_all_is_sorted_and_every_name_in_it_exists(package):
    assert package.__all__ == sorted(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in dir(package)


def test_everything_that_is_raised_on_purpose_is_public():
    raised = [
        name
        for name, value in vars(planner.exceptions).items()
        if isinstance(value, type) and value.__module__ == "planner.exceptions"
    ]
    assert set(raised) <= set(planner.__all__)


def test_a_name_that_does_not_exist_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'invert_magically'"):
        _ = planner.invert_magically


@pytest.mark.parametrize(
    "error",
    [
        planner.InvalidFile("log.csv", "is empty", line=3),
        planner.UnreachableFoot(np.array([2]), np.array([0.1]), of=9),
        planner.SolverFailed("fit", "stopped", violation=0.5),
    ],
)
def test_an_error_comes_whole_from_another_process(error):
    error.add_note("knee")
    back = pickle.loads(pickle.dumps(error))
    assert (type(back), str(back), vars(back)) == (type(error), str(error), vars(error))


def _examples():
    for package in (planner, kinematics):
        for name in package.__all__:
            value = getattr(package, name)
            module = sys.modules.get(getattr(value, "__module__", ""))
            if module is not None:
                yield from FINDER.find(value, name, module=module, globs=vars(module).copy())


EXAMPLES = {test.name: test for test in _examples() if test.examples}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_prints_what_it_says(name):
    said: list[str] = []
    failed, _ = doctest.DocTestRunner().run(EXAMPLES[name], out=said.append)
    assert not failed, "".join(said)


def test_every_public_function_has_an_example():
    functions = {
        name
        for package in (planner, kinematics)
        for name in package.__all__
        if inspect.isfunction(getattr(package, name))
    }
    assert functions | {"JointModel.from_toml"} <= set(EXAMPLES)


ANGLES = np.sin(np.arange(30.0) / 5.0)


CURVE = planner.PiecewiseLinear(knots=[0, 5], values=[0.0, 1.0], samples=9, tick=0.01, cyclic=True)


SERVO = planner.JointModel(v_max=9.0, theta_0=0.2, lag=0.03, acceleration_time=0.05)


def _with_predicted(plan):
    """The plan, which has simulated its requests."""
    assert plan.predicted.shape == plan.requests.shape
    return plan


VALUES = {
    "Log": lambda: planner.Log(times=np.arange(30.0), requests=ANGLES, angles=ANGLES),
    "PiecewiseLinear": lambda: CURVE,
    "CurveStack": lambda: planner.CurveStack.of([CURVE]),
    "Plan": lambda: _with_predicted(planner.plan(SERVO, ANGLES, method="closed_form")),
    "fit": lambda: planner.fit_pwl(ANGLES, v_max=9.0, tick=0.1, segments=4),
    "Trial": lambda: planner.Trial(
        requests=ANGLES[:, np.newaxis], measured=ANGLES[np.newaxis, :, np.newaxis], error=0.0
    ),
}


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))]
)
def test_copies_of_values_cannot_be_written_to(name, copied):
    value = VALUES[name]()
    arrays = [each for each in vars(copied(value)).values() if isinstance(each, np.ndarray)]
    assert arrays
    assert not any(array.flags.writeable for array in arrays)
