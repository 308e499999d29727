"""What Python and a notebook show of an answer: a few lines, with units, at once."""

import numpy as np
import pytest

import planner
from tests.report.made_up import made_up, made_up_log

SERVO = planner.JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05)
PATH = 0.3 * np.sin(2.0 * np.pi * np.arange(40) / 40)
MOST_LINES, MOST_LETTERS = 12, 700


@pytest.fixture(scope="module")
def plan():
    return planner.plan(SERVO, np.column_stack([PATH, 0.5 * PATH]))


def answers(plan):
    found = made_up()
    replayed = planner.replay(made_up_log(duration=2.0), found.model)
    fit = planner.fit_pwl(PATH, v_max=4.0, tick=0.008)
    (learning,) = planner.refine(plan.inversions[0], plan.predicted[:, 0] + 0.01).plan.learning
    plans = [plan, plan.inversions[0], learning, learning.trials[0]]
    walk = planner.reference_walk()
    checked = planner.cross_check(SERVO, PATH)
    limit = planner.fastest(made_up_log(duration=2.0), found.model, tolerance=0.1)
    others = [walk, walk.leg, checked, limit, planner.Stream([SERVO] * 2, preview=25)]
    return [*plans, found, found.model, made_up_log(), replayed, fit, *others]


def test_every_answer_is_shown_in_a_few_lines_of_text_and_html(plan):
    for answer in answers(plan):
        shown = repr(answer)
        assert len(shown.splitlines()) <= MOST_LINES
        assert len(shown) <= MOST_LETTERS
        assert "array(" not in shown
        if not isinstance(answer, planner.JointModel):
            html = answer._repr_html_()
            for cell in shown.splitlines()[-1].split():
                assert cell in html


def test_a_plan_shows_the_errors_of_each_joint_and_computes_no_bound(plan):
    head, columns, first, second = repr(planner.plan(SERVO, np.column_stack([PATH, PATH]))).split(
        "\n"
    )
    assert head == "Plan by optimal: 40 requests to 2 joints, one every 8 ms, cyclic"
    assert columns.split() == ["rms", "[deg]", "max", "[deg]"]
    assert first.split()[1:] == second.split()[1:]
    assert plan.lower_bounds.shape == (2,)
    assert repr(plan).splitlines()[1].endswith("lower bound")
    rms = np.degrees(plan.rms[1])
    assert repr(plan.inversions[1]).splitlines()[-1].split()[1] == f"{rms:.4g}"


def test_a_model_is_shown_as_the_call_that_makes_it():
    assert repr(SERVO) == (
        "JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05)  # rad/s, rad, s, s"
    )
    assert eval(repr(SERVO), {"JointModel": planner.JointModel}) == SERVO


def test_intervals_of_an_identification_stand_beside_their_unit():
    (row,) = [row for row in repr(made_up()).splitlines() if "theta_0" in row]
    assert row.split()[-1] == "rad"
    (share,) = [row for row in repr(made_up(made_up_log(unit="1"))).splitlines() if "v_max" in row]
    assert share.split()[-1] == "1/s"
