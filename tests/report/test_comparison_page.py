"""The page about a comparison: its verdict, shades and tables, and what a browser makes of it."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import planner
from planner.evaluation.checks import AGREES, Check
from planner.planning.bounds import foot_bound
from planner.report.comparison import (
    SHOWN,
    above_bound,
    checks_table,
    comparison_page,
    comparison_text,
    foot_figure,
    foot_table,
    joint_figure,
    key_figures,
    notes,
    plans_table,
    remarks,
    verdict,
)
from planner.report.plotly_figure import live
from tests.report.test_figure import check_words

WHOLE = 1e-12
"""Shares add up to one, but for rounding."""

SAME = 1e-12
"""The same numbers by another route [deg]."""

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


def test_the_last_card_of_joints_is_of_the_largest_error_when_optimised(check):
    worst = max(check.joints, key=lambda joint: joint.plans["optimal"].error)
    *others, last = check.joints
    assert worst is not last
    joints = [*others, replace(last, plans={**last.plans, SHOWN: SimpleNamespace(error=9.0)})]
    *_, card = key_figures(replace(check, joints=joints, foot=None))
    assert f"when optimised, {worst.name}; lower bound" in card.words
    assert card.figure == f"{np.degrees(worst.plans['optimal'].error):.3g}"


def test_another_steady_cycle_is_told_of_its_plan(check):
    answers = {"optimal": SimpleNamespace(elsewhere=0.0), SHOWN: SimpleNamespace(elsewhere=0.01)}
    joint = SimpleNamespace(name="hip", plans=check.joints[0].plans, answers=answers)
    (note,) = notes([joint])
    assert note.startswith("hip, closed form")
    assert note.endswith("another steady cycle is 0.57 deg away")


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


def test_the_plan_that_is_closest_to_breaking_a_claim_stands_for_it():
    far = Check("hip", "a", "holds", 1.0, 2.0, "rad", "")
    near = Check("knee", "b", "holds", 0.9, 0.95, "rad", "")
    (row,) = checks_table([far, near, far]).rows
    assert row.cells == ("9.0e-01", "9.5e-01 rad", "yes", "knee, b")
    broken = [replace(each, tolerance=0.5) for each in (far, near)]
    assert [row.cells[2:] for row in checks_table(broken).rows] == [
        ("NO", "hip, a"),
        ("NO", "knee, b"),
    ]


def test_requests_of_the_closed_form_beyond_the_limits_are_remarked(check):
    (said,) = [each for each in remarks(check) if "no limits" in each]
    abductor = check.joints[1].plans
    excess = np.max(abductor[SHOWN].requests - abductor["optimal"].limits[1])
    assert f"abductor by {np.degrees(excess):.3g} degrees" in said
    (*_, knee) = check.joints
    for beyond, told in ((7.0, ["knee by 7 degrees"]), (1e-3, ["knee by 0.001 degrees"]), (0, [])):
        low = SimpleNamespace(requests=knee.plans["optimal"].limits[0] - np.radians([0.0, beyond]))
        below = replace(knee, plans={**knee.plans, SHOWN: low})
        said = " ".join(remarks(replace(check, joints=(below,))))
        assert re.findall(r"more than they allow of (.*?)\. A robot", said) == told


def test_a_plan_at_a_bound_of_zero_has_an_error_and_no_infinite_gap(check):
    joint = check.joints[0]
    zero = {level: proof._replace(bound=0.0) for level, proof in joint.certificates.items()}
    exact = replace(check, joints=(replace(joint, certificates=zero),), foot=None)
    error = np.degrees(joint.plans[SHOWN].error)
    assert above_bound(exact, SHOWN) == f"{error:.3g} degrees"
    assert f"Errors above a lower bound of 0: closed form {error:.3g} degrees" in verdict(exact)[1]
    card = key_figures(exact)[1]
    assert (card.figure, card.unit) == (f"{error:.3g}", "deg rms")
    assert card.words.startswith("lower bound 0: closed form")
    for said in (comparison_page(exact).partition("<script")[0], comparison_text(exact)):
        assert not re.search(r"\binf\b", said)


def test_plotly_takes_every_figure(check):
    check_words(live(foot_figure(check)))
    for j, joint in enumerate(check.joints):
        check_words(live(joint_figure(check, joint, j)))


def test_joints_without_a_leg_or_a_cycle_have_a_page_too():
    once = planner.cross_check(
        planner.JointModel.ers210a(), WALK.desired[:, 2], cyclic=False, names=["knee"]
    )
    page = comparison_page(once)
    assert "<h1>Knee</h1>" in page
    assert '"leg"' not in page
    assert "deg rms" in page


def test_every_figure_comes_to_life_and_fits_a_phone(page, browser, tmp_path):
    file = tmp_path / "compare.html"
    file.write_text(page, encoding="utf-8")
    figures = ["leg", "joint_0", "joint_1", "joint_2", "foot_distances"]
    assert browser.read_through(file, width=390, dark=True) == figures


@pytest.mark.parametrize(("norm", "place"), [("rms", 0), ("max", 1)])
def test_a_bound_stands_below_the_error_that_it_is_a_bound_of(norm, place):
    once = planner.cross_check(
        planner.JointModel.ers210a(), WALK.desired[::4, 2], norm=norm, names=["knee"]
    )
    (joint,) = once.joints
    rows = plans_table(once.joints).rows
    bounds = [row.cells for row in rows if row.kind == "bound"]
    assert [cells[place] for cells in bounds] == [
        f"{np.degrees(bound):.3f}" for bound in joint.bounds.values()
    ]
    assert {cells[1 - place] for cells in bounds} == {""}
