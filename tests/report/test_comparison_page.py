"""The page about a comparison: its verdict, shades and tables, and what a browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.evaluation.checks import AGREES, Check
from planner.planning.bounds import foot_bound
from planner.report.comparison import (
    SHOWN,
    above_bound,
    comparison_page,
    foot_table,
    key_figures,
    remarks,
    verdict,
)

WALK = planner.reference_walk()


@pytest.fixture(scope="module")
def check():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foot_bound, "EFFORT", 100)  # weaker, as valid
        return planner.cross_check(planner.JointModel.ers210a(), WALK.desired, leg=WALK.leg)


@pytest.fixture(scope="module")
def page(check):
    return comparison_page(check, title="leg <1>", leg=WALK.leg, unreachable=15)


@pytest.fixture
def failed(check):
    wrong = Check("knee", "optimised", "holds <always>", 2.0, 1.0, "rad", "rounding")
    joint = replace(check.joints[2], checks=(*check.joints[2].checks, wrong))
    return replace(check, joints=(*check.joints[:2], joint))


def test_the_verdict_comes_first_and_tells_agreement_gaps_and_difference(check, page):
    head, tail = verdict(check)
    assert head == f"The plans agree: all {len(check.checks)} checks hold"
    gaps = [100.0 * joint.gap("optimal") for joint in check.joints]
    for order in (1, -1):
        turned = replace(check, joints=check.joints[::order])
        assert above_bound(turned, "optimal") == f"{min(gaps):.2f} – {max(gaps):.2f} %"
    assert f"{min(gaps):.2f} – {max(gaps):.2f} %" in tail
    apart = [np.degrees(joint.difference(SHOWN)) for joint in check.joints]
    assert {bool(each.max() > -each.min()) for each in apart} == {True, False}
    for joints, largest in (
        (check.joints, max(np.abs(each).max() for each in apart)),
        *(((joint,), np.abs(each).max()) for joint, each in zip(check.joints, apart, strict=True)),
    ):
        assert f"up to {largest:.3g} degrees" in verdict(replace(check, joints=joints))[1]
    assert page.index(head) < page.index("<table>")
    assert f"15 of {len(WALK.desired)} samples were out of reach" in page
    agreements = [each.value for each in check.checks if each.name == AGREES]
    assert min(agreements) < max(agreements)
    first, *_ = key_figures(check)
    assert f"at most {max(agreements):.1g} rad" in first.words
    figures = {each.figure for each in key_figures(check)}
    assert f"{len(check.checks)} of {len(check.checks)}" in figures
    foot = [
        100.0 * float(check.foot.plans[method].rms[0]) for method in ("optimal", "foot_optimal")
    ]
    assert f"{foot[0]:.2f} → {foot[1]:.2f}" in figures


def test_what_does_not_hold_is_said_first(failed):
    head, _ = verdict(failed)
    assert head == f"1 of {len(failed.checks)} checks do not hold"
    assert remarks(failed)[0].startswith("knee, optimised: holds <always>: got 2 rad")
    page = comparison_page(failed)
    assert 'class="verdict no"' in page
    assert "holds &lt;always&gt;" in page
    assert re.search(r'<tr class="broken">.*holds &lt;always&gt;.*<td>NO</td>', page)


@pytest.mark.parametrize(("norm", "place"), [("rms", 0), ("max", 1)])
def test_the_bound_on_the_foot_stands_below_its_error(check, norm, place):
    best = check.foot.best
    plan = replace(best, task=replace(best.task, norm=norm))
    plan.__dict__["lower_bounds"] = 0.8 * plan.error
    plans = {"optimal": check.foot.plans["optimal"], "foot_optimal": plan}
    *_, bound = foot_table(replace(check.foot, plans=plans)).rows
    assert bound.kind == "bound"
    assert [bool(cell) for cell in bound.cells] == [k == place for k in range(5)]
    assert bound.cells[place] == f"{80.0 * plan.error[0]:.3f}"


def test_every_figure_comes_to_life_and_fits_a_phone(page, browser, tmp_path):
    file = tmp_path / "compare.html"
    file.write_text(page, encoding="utf-8")
    figures = ["leg", "joint_0", "joint_1", "joint_2", "foot_distances"]
    assert browser.read_through(file, width=390, dark=True) == figures
