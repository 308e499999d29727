"""Every curve shows what its legend names: the figures of all pages against their numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner import replay
from planner.report import learning_page as learning
from planner.report.learning_page import AFTER, BEFORE, ERROR, EXECUTED, LEARNT, NEXT
from planner.report.replay_page import replay_page
from tests.corpus.page_text import figures_of, text_of
from tests.corpus.test_corpus import masked
from tests.report.test_made_up_pages import SERVO, logs

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


@pytest.mark.parametrize(("size", "speed"), [(2.0, 1.5), (4.0, 2.0), (3.0, 3.0)])
def test_the_error_that_joints_stay_within_is_not_rounded_down(size, speed):
    made = replay(logs("elbow", size=size), SERVO, speed=speed)
    page = replay_page(made, title="demo.csv", models="model: arm.toml").html()
    (promised,) = re.findall(r"stays within\s(\S+) degrees", page)
    largest = np.degrees(np.max(np.abs(made.planned[0].errors["planned"])))
    assert largest <= float(promised) <= 1.1 * largest
