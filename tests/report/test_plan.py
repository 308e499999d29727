"""The page about a plan: its verdict, remarks and figures, and what a browser makes of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from kinematics import Limits
from planner.model.response import PathSpeeds
from planner.report.figure import FOOT_OPTIMAL
from planner.report.plan_page import jumps_of, leg_figure, limits_of, plan_page
from planner.report.plan_results import PlanAnswer
from planner.report.wording import table
from tests.corpus.page_text import text_of

DRAWN = 0.0051  # rounding of what is drawn [cm]
WALK = planner.reference_walk()
SERVO = planner.JointModel.ers210a()


def foot_of(motion):
    """The path of the foot of a moving leg [cm]."""
    return np.array(motion["points"])[:, -1]


@pytest.fixture(scope="module")
def outcome():
    """The plan for the foot, its bound known to be 0."""
    made = planner.invert_foot(SERVO, WALK.leg, WALK.desired_foot).plan
    return asked(made, desired=WALK.desired)


def asked(plan, **changes):
    """The same requests for another task; nothing is bounded, as that takes seconds."""
    changed = replace(plan, task=replace(plan.task, **changes))
    changed.__dict__["lower_bounds"] = np.zeros(len(changed.error))
    return changed


def limited(plan, joint, limits):
    """The plan with other limits of a joint [rad]."""
    lower, upper = plan.task.lower.copy(), plan.task.upper.copy()
    lower[joint], upper[joint] = limits
    return asked(plan, lower=lower, upper=upper)


@pytest.fixture(scope="module")
def page(outcome):
    return page_of(outcome)


def answer_about(outcome, **about):
    return PlanAnswer(plan=outcome, **{"method": "foot-optimal", **about})


def text_of_page(outcome, **about):
    return text_of(page_of(outcome, **about))


def page_of(outcome, **about):
    return plan_page(answer_about(outcome, **about), title="leg <1>").html(
        "page.html", [("path", "<x>.csv")]
    )


@pytest.mark.parametrize(
    ("error", "told"), [(5.046, "5.1"), (0.0612, "0.062"), (3.0, "3"), (101.0, "110"), (0.0, "0")]
)
def test_no_joint_leaves_the_distance_within_which_it_is_said_to_stay(outcome, error, told):
    errors = np.zeros((len(WALK.desired), 1))
    errors[3] = np.radians(error)
    one = outcome.joint(0)
    one.__dict__["predicted"] = WALK.desired[:, :1] + errors
    page = text_of_page(one, method="optimal")
    assert f"By the model the joint stays within {told} degrees of its path," in page


def test_what_goes_wrong_is_remarked(outcome, page):
    free = replace(WALK.leg, limits=Limits(np.full(3, -3.0), np.full(3, 3.0)))
    mirrored = replace(free, near=WALK.desired[0] * [1.0, 1.0, -1.0]).joint_angles(
        WALK.desired_foot
    )
    jumping = np.vstack([WALK.desired[:40], mirrored[40:]])
    jumped = asked(outcome, desired=jumping)
    said = text_of_page(jumped, unreachable=7, missed=["the foot is 2 cm off"])
    assert "the foot is 2 cm off." in said
    assert "7 of 88 positions are out of the leg's reach" in said
    assert "the distances count them" in said
    assert "jumps to another pose" in said
    assert {39, 87} <= {*jumps_of(jumped)}
    assert jumps_of(asked(outcome, desired=jumping, cyclic=False))[-1] < 87
    assert 'class="verdict no"' in page_of(jumped)
    assert 'class="verdict no"' not in page


def test_a_path_is_said_to_be_too_fast_where_that_is_more_than_a_trace(outcome):
    said = []
    for fast, share in ((1, 1.005), (1, 1.02), (9, 1.005)):  # of 400 samples
        shares = np.r_[np.full(fast, share), np.full(400 - fast, 0.5)]
        changed = asked(outcome)
        changed.__dict__["speeds"] = (PathSpeeds(shares, np.ones(400)),) * 3
        said.append("faster than the top speed" in text_of_page(changed))
    assert said == [False, True, True]


def joints_of(answer):
    return table("plan_joints", answer=answer, **limits_of(answer))


def test_requests_at_a_limit_are_counted_and_those_beyond_it_told_by_how_much(outcome):
    at_largest = limited(outcome, 0, (-10.0, float(outcome.requests[:, 0].max())))
    at_least = limited(outcome, 0, (float(outcome.requests[:, 0].min()), 10.0))
    for tight in (at_largest, at_least):
        assert answer_about(tight).joints[WALK.joint_names[0]]["requests_at_limits"] >= 1
    free = limited(outcome, 0, (-np.inf, np.inf))
    assert answer_about(free).joints[WALK.joint_names[0]]["requests_at_limits"] == 0
    assert "none" in joints_of(answer_about(free)).rows[0].cells
    for limits, words in (((-np.inf, 10.0), "at most 573"), ((-10.0, np.inf), "at least −573")):
        half = joints_of(answer_about(limited(outcome, 0, limits))).rows[0].cells
        assert words in half
    most = float(outcome.requests[:, 0].max())
    for limit, beyond in ((most - math.radians(2.0), True), (most, False)):
        said = text_of_page(limited(outcome, 0, (-10.0, limit)))
        assert (f"{WALK.joint_names[0]} by 2 degrees" in said) == beyond
        assert ("Requests at a limit" in said) != beyond


def test_the_foot_is_drawn_where_it_should_be_though_the_leg_does_not_reach(outcome):
    far = WALK.desired_foot + np.array([0.0, 0.0, -0.1])
    desired, direct, planned = leg_figure(asked(outcome, foot=far), FOOT_OPTIMAL).live["motions"]
    np.testing.assert_allclose(foot_of(desired), 100.0 * far, atol=DRAWN)
    for motion, angles in ((direct, outcome.direct.predicted), (planned, outcome.predicted)):
        foot = WALK.leg.foot_positions(angles)
        np.testing.assert_allclose(foot_of(motion), 100.0 * foot, atol=DRAWN)
        distances = 100.0 * np.linalg.norm(foot - far, axis=1)
        np.testing.assert_allclose(motion["distances"], distances, atol=DRAWN)


def test_every_figure_comes_to_life_and_fits_a_phone(page, browser, tmp_path):
    file = tmp_path / "plan.html"
    file.write_text(page, encoding="utf-8")
    figures = ["leg", "foot_distances", "joint_0", "joint_1", "joint_2"]
    assert browser.read_through(file, width=390, dark=True) == figures
