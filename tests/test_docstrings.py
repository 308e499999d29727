"""The examples in the docstrings of what is public run, and print what they say."""

from __future__ import annotations

import doctest
import inspect
import sys

import pytest

import kinematics
import planner

FINDER = doctest.DocTestFinder(exclude_empty=True)


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
