"""Pages of answers that no command line of tests/corpus has, held by snapshots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from kinematics import Leg, urdf_path
from planner import JointModel, Log, plan, replay, simulate
from planner.identification.result import Interval
from planner.model.evidence import Evidence
from planner.recording.retiming import Fastest, Impossible, SpeedErrors
from planner.report.identification.page import (
    calibration_page,
    calibration_text,
    identification_page,
)
from planner.report.page import sources_of
from planner.report.plan import plan_page
from planner.report.replay import episodes_page, replay_page
from planner.report.sweep import Outcome, Requirement, Swept, sweep_page
from planner.robot.candidates import WORDS, Candidate, Compared
from tests.corpus.page_text import check_needs_nothing_else, figures_of, text_of
from tests.corpus.test_corpus import masked
from tests.report.made_up import made_up, made_up_log, never_saturated

SOURCES = sources_of("page.html", [("recording", "walks_2.csv"), ("<model>", "arm.toml")])

SERVO = JointModel(v_max=4.0, theta_0=0.2, lag=0.03, acceleration_time=0.05, tick=0.005, hold=4)


EXPECTED = (math.nan, math.nan, 0.2, 0.15, 0.14)
"""Error that the model leads one to expect of each way of a calibration [deg]."""


def calibrated(best, *, accepted=True):
    """A joint whose ways have errors of 1, 2, 3 ... tenths of a degree, the best one 0.05."""
    ways = [
        Candidate(way, *np.radians([0.05 if way == best else 0.1 * k, 0.3 * k, 2.0 * k, expected]))
        for k, (way, expected) in enumerate(zip(WORDS, EXPECTED, strict=True), 1)
    ]
    found = made_up(made_up_log(duration=4.0), verdict="holds" if accepted else "refused")
    (chosen,) = (each for each in ways if each.way == best)
    return Compared(
        identification=found, candidates=tuple(ways), recommended=chosen, model=found.model
    )


def calibration():
    ways = ("direct", "shift", "optimal")
    found = {f"to_{best}": calibrated(best, accepted=best != "shift") for best in ways}
    return f"{calibration_text(found, 'arm.toml')}\n{calibration_page(found, 'my_arm.toml')}"


def identification():
    refused = replace(never_saturated(), verdict="refused", held_out_rms=None)
    gripper = made_up(made_up_log(unit="1", joint="<gripper> & co", name="<img src=x>.csv"))
    stuck = replace(gripper.model, dead_band=0.01)
    intervals = {**gripper.intervals, "dead_band": Interval(0.009, 0.011)}
    (fit,) = gripper.fits
    slower = replace(fit, log=replace(fit.log, times=1.25 * fit.log.times))
    sticky = replace(gripper, model=stuck, intervals=intervals, fits=(slower,))
    return identification_page({"knee": refused, "<gripper> & co": sticky})


def logs(*names, size=0.5):
    """A motion there and back, recorded of some joints."""
    requests = size * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 80))) / 2.0
    angles = simulate(SERVO, requests, cyclic=False)
    times = SERVO.period * np.arange(80)
    return [Log(times=times, requests=requests, angles=angles, joint=name) for name in names]


def front_left_leg():
    return Leg.from_urdf(urdf_path("ers210a.urdf"), base="body", foot="front_left_ball")


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
    names = front_left_leg().joint_names
    return plan(models, desired, names=names, limits=(-1.0, 1.25))


def robot():
    legs = {"front-left": front_left_leg()}
    about = {"missed": ["the foot is 2 cm off"], "notes": ["Mind the step."], "sources": SOURCES}
    return plan_page(plan_by_tested_models(), title="walk", method="optimal", legs=legs, **about)


def replayed_arm():
    leg = front_left_leg()
    hip, knee, jaw = leg.joint_names
    tested = replace(SERVO, v_offset=0.25).with_evidence(
        Evidence(error=0.01, speed=1.0, intervals={"v_max": (3.0, math.inf)})
    )
    plain = SERVO.with_evidence(tested.evidence)
    recorded = [*logs(hip, size=2.5), *logs(knee, jaw, "gripper")]
    limits = {hip: (-0.25, 3.25)}
    made = replay(recorded, {hip: tested, knee: plain}, speed=1.5, track="action", limits=limits)
    return replay_page(made, title="demo.csv", words="follows the state", arm=leg)


def found_fastest(made, *curve):
    """The fastest replay within two degrees, at these errors over speed."""
    found = Fastest(
        replay=made,
        constant=1.8,
        tolerance=math.radians(2.0),
        foot=False,
        retime="varying",
        impossible=Impossible(2.5, "elbow", 1.1, of_model_only=True),
        curve=tuple(SpeedErrors(*each) for each in curve),
    )
    found.__dict__["factors"] = np.linspace(1.0, 3.0, len(made.moments) - 1)
    return found


def fastest_replay():
    seen = Evidence(intervals={"v_max": (3.0, math.inf)})
    made = replay(logs("elbow", size=3.0), SERVO.with_evidence(seen), speed=2.0)
    curve = (
        (1.0, 25.0, 1.5, 0.25, 0.125),
        (2.0, 30.0, 3.0, 0.75, math.nan),
        (3.0, 40.0, 6.0, 2.0, 1.5),
    )
    found = found_fastest(made, *curve)
    about = {"title": "demo.csv", "words": "follows the state", "verdict": "v_max is 1"}
    missed, remarks = ["elbow: 3 deg off"], ["The gripper is new."]
    return replay_page(
        made, fastest=found, missed=missed, remarks=remarks, sources=SOURCES, **about
    )


def row(number, planned=0.2, unit="deg", **others):
    """What ``replay --json`` says of a recording."""
    errors = {"resent_rms": 3.0, "direct_rms": 2.0, "shifted_rms": 1.0, "planned_rms": planned}
    return {
        "recording": f"data/walks, episode {number}",
        "requests": 100,
        "duration_s": 2.0,
        "speed": 1.5,
        "worst_joint": "elbow",
        "unit": unit,
        **errors,
        "expected_on_robot_rms": None,
        "lower_bound": 0.1,
        "remarks": [],
        **others,
    }


def document(rows, *, speed=1.5, left_out=()):
    failed = dict.fromkeys(left_out, "is the file cut short?")
    return {"track": "state", "speed": speed, "recordings": rows, "left_out": failed, "remarks": []}


def episodes():
    columns = ("resent_rms", "direct_rms", "shifted_rms", "expected_on_robot_rms", "lower_bound")
    errors = (
        (3.5, 2.5, 1.5, None, 0.1),
        (3.0, 2.25, 1.75, 0.75, 0.125),
        (4.0, 9.0, 1.25, 0.5, None),
    )
    about = (("elbow", "deg", 100), ("hip", "deg", 80), ("jaw", "percent", 120))
    rows = [
        row(number, planned, unit, worst_joint=joint, requests=requests, duration_s=requests / 40,
            **dict(zip(columns, each, strict=True)))
        for number, planned, (joint, unit, requests), each in zip(
            (0, 1, 3), (0.3, 0.45, 0.25), about, errors, strict=True
        )
    ]  # fmt: skip
    failed = [f"data/walks, episode {10 + k}" for k in range(20 + 1)]
    made = document(rows, left_out=failed)
    made["remarks"] = ["the models are old", "two episodes are short"]
    return episodes_page(made, title="walks", words="follows the state", sources=SOURCES)


def swept(*outcomes, required=None):
    numbered = tuple(replace(each, number=k) for k, each in enumerate(outcomes, 1))
    made = Swept("a b.toml", ("speed", "height"), numbered, "times", "deg", required)
    return sweep_page(made, sources=SOURCES)


def missed_sweep():
    points = (
        Outcome((0.5, -0.2), 0.5, 0.2, 0.9, 3.0, 0.0, ""),
        Outcome((1.25, -0.123456789), 1.25, 0.2, 1.5, 2.5, 0.25, "hip"),
        Outcome((1.0, -0.3), 1.0, 0.25, 1.25, 2.75, 0.125, "knee"),
        Outcome((2.0, -0.1), 2.0, 0.3, 1.125, 4.0, 0.5, "knee"),
    )
    required = Requirement("error", 0.1)
    missed = (replace(each, reason="0.1 deg") for each in points)
    return swept(Outcome((3.0, -0.1), reason="too far"), *missed, required=required)


PAGES = {
    made.__name__: made
    for made in (
        calibration,
        identification,
        robot,
        replayed_arm,
        fastest_replay,
        episodes,
        missed_sweep,
    )
}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_says_and_draws_what_it_did(name, snapshot, tmp_path):
    page = PAGES[name]()
    check_needs_nothing_else(page, tmp_path)
    snapshot.check(name, masked(f"{text_of(page)}\n{figures_of(page)}\n"))
