"""The pages of learning, replays and comparisons against the numbers that they show."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.evaluation.checks import Check, Claim
from planner.planning.bounds import foot_bound
from planner.report import learning_page as learning
from planner.report.comparison_page import SHOWN, comparison_page, spoken_of
from planner.report.learning_page import AFTER, BEFORE, ERROR, EXECUTED, LEARNT, NEXT
from planner.report.wording import table
from tests.corpus.page_text import figures_of, text_of
from tests.corpus.test_corpus import masked

WALK = planner.reference_walk()
JOINT = planner.JointModel.ers210a()


def drawn(figure, samples):
    """By panel the values of every curve by its name, lines across the panel left out."""
    return [
        {curve.name: curve.y[:samples] for curve in panel.curves if len(curve.y) >= samples}
        for panel in figure.panels
    ]


def same(got, expected):
    """Whether panels have these curves [rad], and no others."""
    assert [set(panel) for panel in got] == [set(panel) for panel in expected]
    for panel, named in zip(got, expected, strict=True):
        for name, values in named.items():
            np.testing.assert_allclose(panel[name], np.degrees(values), atol=1e-9, err_msg=name)


@pytest.fixture(scope="module")
def planned():
    return planner.plan([JOINT, replace(JOINT, v_max=1.3 * JOINT.v_max)], WALK.desired[:, 1:])


def test_learning(planned, snapshot):
    measured = planned.predicted + 0.02 * np.sin(2.0 * np.pi * np.arange(88) / 88)[:, np.newaxis]
    after = planner.refine(planned, measured, reidentify=False)
    assert np.max(np.abs(after.requests - planned.requests)) > 0.01
    page = learning.learning_page(
        after,
        executed=planned.requests,
        measured=measured,
        progress={
            "hip": {
                "unit": "deg",
                "trials": 3,
                "errors": [3.0, 1.5, 2.0],
                "predicted": 3.25,
                "lower_bound": 1.0,
                "noise": 0.1,
                "best_trial": 2,
                "stopped": None,
                "remarks": ["a cycle was left out"],
            },
            "knee": {
                "unit": "deg",
                "trials": 2,
                "errors": [1.0, 4.0],
                "predicted": 0.9,
                "lower_bound": math.nan,
                "noise": 1e-4,
                "best_trial": 1,
                "stopped": "no gain is left",
                "remarks": [],
            },
        },
        about_others="jaw is not learnt.",
        title="walk",
    ).html()
    text = f"{text_of(page)}\n{figures_of(page)}\n"
    snapshot.check("learning", masked(text[: text.index("figure learning_joint")]))
    for j in range(2):
        figure = learning.joint_figure(after, planned.requests, measured, j)
        desired, learnt = planned.desired[:, j], after.task.disturbance[:, j]
        expected = [
            {"desired": desired, EXECUTED.label: measured[:, j], NEXT.label: after.predicted[:, j]},
            {ERROR.label: measured[:, j] - desired, LEARNT.label: learnt},
            {BEFORE.label: planned.requests[:, j], AFTER.label: after.requests[:, j]},
        ]
        same(drawn(figure, 88), expected)


@pytest.fixture(scope="module")
def check():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foot_bound, "EFFORT", 100)  # weaker, as valid
        return planner.cross_check(planner.JointModel.ers210a(), WALK.desired[::4], leg=WALK.leg)


@pytest.fixture
def failed(check):
    wrong = Check("knee", "optimised", Claim("holds <always>", 1.0, "rad", "rounding"), 2.0)
    joint = replace(check.joints[2], checks=(*check.joints[2].checks, wrong))
    return replace(check, joints=(*check.joints[:2], joint))


def test_the_largest_difference_of_the_requests_is_told_whichever_its_sign(check):
    for joint in check.joints:
        largest = np.degrees(np.abs(joint.difference(SHOWN)).max())
        one = replace(check, joints=(joint,), foot=None)
        assert f"up to {largest:.3g} degrees" in text_of(comparison_page(one).html())


def test_what_does_not_hold_is_said_first(failed):
    page = comparison_page(failed).html()
    said = text_of(page)
    whose = f"checks on the plans of {', '.join(joint.name for joint in failed.joints)}"
    assert f"1 of {len(failed.checks)} {whose} do not hold. Gaps" in said
    assert "\nknee, optimised: holds <always>: got 2 rad" in said
    assert 'class="verdict no"' in page
    assert "holds &lt;always&gt;" in page
    assert re.search(r'<tr class="broken">.*holds &lt;always&gt;.*<td>NO</td>', page)


@pytest.mark.parametrize(("norm", "place"), [("rms", 0), ("max", 1)])
def test_the_bound_on_the_foot_stands_below_its_error(check, norm, place):
    best = check.foot.best
    plan = replace(best, task=replace(best.task, norm=norm))
    plan.__dict__["lower_bounds"] = 0.8 * plan.error
    plans = {"optimal": check.foot.plans["optimal"], "foot_optimal": plan}
    of = replace(check, foot=replace(check.foot, plans=plans))
    *_, bound = table("comparison_foot", **spoken_of(of)).rows
    assert bound.kind == "bound"
    assert [bool(cell) for cell in bound.cells] == [k == place for k in range(5)]
    assert bound.cells[place] == f"{80.0 * plan.error[0]:.3f}"
