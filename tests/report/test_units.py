"""Units: of errors over joints in angles and in shares of a range, and in names for machines."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from planner.approximation.fit_pwl import choices, fit_pwl
from planner.evaluation.pareto_front import Outcome, Swept
from planner.report.fit_page import fit_page, fit_results, fits_table
from planner.report.replay_page import fastest_results
from planner.report.sweep_page import sweep_results, sweep_text
from planner.report.wording import CARRIED, common, environment, renamed


def test_joints_of_one_unit_have_it_in_common_and_others_count_each_in_its_own():
    assert common(["percent", "percent"]) == CARRIED["percent"]
    assert common(["deg", "percent", "deg"]) == CARRIED["deg_or_percent"]
    in_each = environment(plain=True).filters["in_each"]
    words = in_each({"deg": 24.2, "percent": 9.51}, "two_digits")
    assert words == "24 degrees and 9.5 % of range"


def test_numbers_that_carry_percent_are_named_so():
    numbers = {"rms_deg": 1, "slopes_deg_per_s": 2, "plans": {"max_deg": 3}, "gap": 4, "degree": 5}
    names = {"rms_percent": 1, "slopes_percent_per_s": 2, "plans": {"max_percent": 3}}
    assert renamed(numbers, CARRIED["percent"]) == names | {"gap": 4, "degree": 5}
    assert renamed(numbers, CARRIED["deg"]) == numbers


@pytest.mark.parametrize(
    ("units", "name"), [("1", "percent"), (("rad", "1"), "deg_or_percent"), (("rad",), "deg")]
)
def test_the_tolerance_of_the_fastest_replay_is_in_the_unit_of_its_joints(units, name):
    joints = [SimpleNamespace(path=SimpleNamespace(unit=unit)) for unit in units]
    about = {"retime": "constant", "speed": 2.0, "constant": 2.0, "factors": np.ones(3)}
    found = SimpleNamespace(
        **about,
        foot=False,
        tolerance=np.radians(3.0),
        largest=0.5,
        impossible=None,
        contradicted=(),
        curve=(),
        replay=SimpleNamespace(planned=joints),
    )
    results = fastest_results(found)
    assert results[f"tolerance_{name}"] == pytest.approx(3.0)
    assert results[f"largest_error_{name}"] == pytest.approx(1.5)


def test_lines_through_shares_have_percent_beside_angles_in_degrees():
    units = {"hip": CARRIED["deg"], "jaw": CARRIED["percent"]}
    desired = np.radians(20.0 * np.sin(2.0 * np.pi * np.arange(40) / 40))
    fits = {name: fit_pwl(desired, v_max=9.0, tick=0.02, segments=3) for name in units}
    table = fits_table(fits, units)
    assert [each.about for each in table.rows] == ["hip [deg]", "jaw [% of range]"]
    both = [fit_results(fits[name], unit) for name, unit in units.items()]
    assert both[1]["rms_percent"] == both[0]["rms_deg"]
    page = fit_page(fits, {name: choices(fit) for name, fit in fits.items()}, units).html()
    assert re.search(r"within ([\d.]+) degrees and \1 % of range of the path", page)
    assert '"%"' in page


def test_the_fewest_lines_are_named_with_the_knots_that_they_are_proved_for():
    desired = np.radians(20.0 * np.sin(2.0 * np.pi * np.arange(24) / 24))
    bounds = {
        "fewest possible": {"max_error": 0.05},
        "fewest with knots on samples": {"max_rms": 0.03, "exact": True},
    }
    for title, bound in bounds.items():
        fits = {"hip": fit_pwl(desired, v_max=9.0, tick=0.02, **bound)}
        titles = [column.title for column in fits_table(fits, {"hip": CARRIED["deg"]}).columns]
        assert titles == ["lines", title, "rms [deg]", "max [deg]"]


def test_the_errors_of_a_sweep_of_shares_are_percent():
    point = Outcome((1.5,), speed=1.5, error=0.4, largest=0.8, direct=2.0, too_fast=0.0)
    swept = Swept("jaw.toml", ("speed",), (point,), speed_unit="×", error_unit="percent")
    assert sweep_results(swept)[0]["error_percent"] == 0.4
    assert "at 0.4 %" in sweep_text(swept)
    assert "error [%]" in sweep_text(swept)
