"""The contract of `import planner`: what it offers, and how little it costs."""

from __future__ import annotations

import subprocess
import sys

import pytest

import kinematics
import planner
import planner.exceptions

HEAVY = ("casadi", "numba", "cvxpy", "osqp", "matplotlib", "pinocchio", "scipy", "jinja2")


@pytest.mark.parametrize("package", [planner, kinematics], ids=["planner", "kinematics"])
def test_all_is_sorted_and_every_name_in_it_exists(package):
    assert package.__all__ == sorted(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in dir(package)


@pytest.mark.parametrize(
    ("package", "table"),
    [(planner, planner._HOME), (kinematics, kinematics._HOMES)],
    ids=["planner", "kinematics"],
)
def test_the_lazy_table_and_all_name_the_same_things(package, table):
    assert sorted(table) == package.__all__


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


def test_importing_planner_and_its_command_line_imports_nothing_heavy():
    code = (
        "import sys, planner, planner.cli\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
