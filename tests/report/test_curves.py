"""Every curve shows what its legend names: the figures of all pages against their numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import planner
from planner.report import learning_page as learning
from planner.report import plan_page as plan
from planner.report import replay_page as replay
from planner.report.learning_page import AFTER, BEFORE, ERROR, EXECUTED, LEARNT, NEXT
from planner.report.style import FOOT_OPTIMAL
from tests.corpus.page_text import figures_of, text_of
from tests.corpus.test_corpus import masked

WALK = planner.reference_walk()
JOINT = planner.JointModel.ers210a()
SERVO = planner.JointModel(
    v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.005, hold=4
)


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


def test_a_plan(planned):
    for j in range(2):
        figure = plan.joint_figure(planned, FOOT_OPTIMAL, j)
        desired = planned.desired[:, j]
        angles = {
            "without a plan": planned.direct.predicted[:, j],
            "foot-optimised": planned.predicted[:, j],
        }
        requests = {"requested": planned.requests[:, j]}
        above, below = {"desired": desired, **angles}, {"desired": desired, **requests}
        same(drawn(figure, len(desired)), [above, below])


def test_learning(planned, snapshot):
    measured = planned.predicted + 0.02 * np.sin(2.0 * np.pi * np.arange(88) / 88)[:, np.newaxis]
    after = planner.refine(planned, measured, reidentify=False)
    assert np.max(np.abs(after.requests - planned.requests)) > 0.01
    page = learning.learning_page(
        after,
        executed=planned.requests,
        measured=measured,
        progress=[
            learning.Trials("hip", "deg", np.array([3.0, 1.5, 2.0]), 3.25, 1.0, 0.1,
                              1.0, 1, "", ("a cycle was left out",)),
            learning.Trials("knee", "deg", np.array([1.0, 4.0]), 0.9, math.nan, 1e-4, 1.0,
                              0, "no gain is left", ()),
        ],
        about_others="jaw is not learnt.",
        title="walk",
    ).html()  # fmt: skip
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
def replayed():
    requests = 0.8 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 80)))
    angles = planner.simulate(SERVO, requests, cyclic=False)
    times = SERVO.period * np.arange(80)
    logs = [
        planner.Log(times=times, requests=requests, angles=angles, joint=name)
        for name in ("elbow", "gripper")
    ]
    return planner.replay(logs, SERVO, speed=2.0, track="action")


def test_a_replay(replayed):
    elbow, gripper = replayed.joints
    samples = len(replayed.moments)
    sent = {"path": elbow.desired, "recorded requests": elbow.recorded_requests}
    shifted, predicted = elbow.shifted, elbow.predicted
    angles = {"path": elbow.desired, "as it is": elbow.direct}
    expected = [
        angles | {"best time shift": shifted, "optimised": predicted},
        {"best time shift": shifted - elbow.desired, "optimised": predicted - elbow.desired},
        sent | {"requested": elbow.requests},
    ]
    same(drawn(replay.joint_figure(replayed, 0), samples), expected)
    (alone,) = drawn(replay.joint_figure(replayed, 1), samples)
    assert alone["requested"] == pytest.approx(np.degrees(gripper.requests))
    live = replay.moment_figure(replayed).live
    kinds = {each["name"]: each["values"] for each in live["kinds"]}
    assert kinds["path"][0] == pytest.approx(np.degrees(elbow.desired), abs=0.0051)
    assert kinds["request"][0] == pytest.approx(np.degrees(elbow.requests), abs=0.0051)
    assert kinds["predicted"][0] == pytest.approx(np.degrees(predicted), abs=0.0051)
    assert kinds["predicted"][1] is None
