"""Pages of answers that no command line of tests/corpus has, held by snapshots."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner import Log, plan, replay, simulate
from planner.model.evidence import Evidence
from planner.recording.recorded_path import JointModels
from planner.recording.replaying import JointReplay
from planner.report.calibration_text import calibration_page, calibration_text
from planner.report.plan_page import plan_page
from planner.report.plan_results import PlanAnswer
from planner.report.replay_page import findings, replay_page
from planner.robot.calibration import WORDS, Candidate, Compared
from tests.corpus.page_text import check_needs_nothing_else, figures_of, text_of
from tests.corpus.test_corpus import masked
from tests.instances import SERVO
from tests.kinematics.made_up_robots import ers210a_leg
from tests.report.made_up import made_up, made_up_log

ORIGINS = [("recording", "walks_2.csv"), ("<model>", "arm.toml")]

EXPECTED = (math.nan, math.nan, 0.2, 0.15, 0.14)
"""Error that the model leads one to expect of each way of a calibration [deg]."""


def calibrated(best, *, accepted=True):
    """A joint whose ways have errors of 1, 2, 3 ... tenths of a degree, the best one 0.05."""
    desired = np.sin(np.linspace(0.0, 6.0, 50))
    ways = []
    for k, (way, expected) in enumerate(zip(WORDS, EXPECTED, strict=True), 1):
        sizes = np.radians([0.05 if way == best else 0.1 * k, 0.3 * k, 2.0 * k, expected])
        ways.append(Candidate(way, *sizes, desired + sizes[0]))
    found = made_up(made_up_log(duration=4.0), verdict="holds" if accepted else "refused")
    (chosen,) = (each for each in ways if each.way == best)
    return Compared(
        identification=found,
        candidates=tuple(ways),
        recommended=chosen,
        model=found.model,
        desired=desired,
    )


def calibration():
    ways = ("direct", "shift", "optimal")
    found = {f"to_{best}": calibrated(best, accepted=best != "shift") for best in ways}
    return f"{calibration_text(found, 'arm.toml')}\n{calibration_page(found, 'my_arm.toml').html()}"


def logs(*names, size=0.5):
    """A motion there and back, recorded of some joints."""
    requests = size * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 80))) / 2.0
    angles = simulate(SERVO, requests, cyclic=False)
    times = SERVO.period * np.arange(80)
    return [Log(times=times, requests=requests, angles=angles, joint=name) for name in names]


def plan_by_tested_models():
    """A plan for a leg's joints whose models were tested, the last two of them in slow motions."""
    phase = 2.0 * np.pi * np.arange(16) / 16
    desired = np.array([0.1, 0.3, 1.0]) + 0.2 * np.sin(phase[:, np.newaxis] + np.arange(3.0))
    seen = (
        Evidence(error=0.01, over_delay=0.9),
        Evidence(error=0.02, speed=1.0),
        Evidence(error=0.03, speed=1.0),
    )
    models = [
        replace(SERVO, v_max=v_max).with_evidence(each)
        for v_max, each in zip((4.0, 3.0, 4.0), seen, strict=True)
    ]
    names = ers210a_leg("front_left").joint_names
    return plan(models, desired, names=names, limits=(-1.0, 1.25))


def robot():
    legs = {"front-left": ers210a_leg("front_left")}
    missed = ["the foot is 2 cm off"]
    answer = PlanAnswer(plan=plan_by_tested_models(), method="optimal", legs=legs, missed=missed)
    page = plan_page(answer, title="walk", notes=["Mind the step."])
    return page.html("page.html", ORIGINS)


def replayed_arm():
    leg = ers210a_leg("front_left")
    hip, knee, jaw = leg.joint_names
    tested = replace(SERVO, v_offset=0.25).with_evidence(
        Evidence(error=0.01, speed=1.0, intervals={"v_max": (3.0, math.inf)})
    )
    plain = SERVO.with_evidence(tested.evidence)
    recorded = [*logs(hip, size=2.5), *logs(knee, jaw, "gripper")]
    limits = {hip: (-0.25, 3.25)}
    made = replay(recorded, {hip: tested, knee: plain}, speed=1.5, track="action", limits=limits)
    return replay_page(
        made, title="demo.csv", models=JointModels(by_joint={}, words="model: arm.toml"), arm=leg
    ).html()


PAGES = {made.__name__: made for made in (calibration, robot, replayed_arm)}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_says_and_draws_what_it_did(name, snapshot, tmp_path):
    page = PAGES[name]()
    check_needs_nothing_else(page, tmp_path)
    snapshot.check(name, masked(f"{text_of(page)}\n{figures_of(page)}\n"))


@pytest.mark.parametrize("track", ["state", "action"])
@pytest.mark.parametrize("smoothness", [0.1, 0.5])
def test_settings_that_are_set_are_not_recommended(track, smoothness, monkeypatch):
    monkeypatch.setattr(JointReplay, "rough", (20.0, 2.0))
    made = replay(logs("knee"), SERVO, track=track, smoothness=smoothness)
    said = findings(made, JointModels(by_joint={}))["rough"].partition(": ")[2]
    assert ("such as 0.5" in said) == (smoothness < 0.5)
    assert ("--track action" in said) == (track == "state")
