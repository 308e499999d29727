"""The report of an identification: one page that needs nothing else, whatever was found."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from planner.identification.parameters import PARAMETERS
from planner.identification.result import Interval
from planner.model.response import simulate
from planner.report.identification_page import cloud_figure, cloud_of, identification_page
from tests.report.made_up import JOINT, made_up, made_up_fit, made_up_log, never_saturated

WIDTH, HEIGHT = 420, 900  # of the screenshot [pixels]: a phone's


@pytest.fixture(scope="module")
def several():
    refused = replace(never_saturated(), verdict="refused", held_out_rms=None)
    gripper = made_up(made_up_log(unit="1", joint="<gripper> & co", name="<img src=x>.csv"))
    joints = {"hip": made_up(), "knee": refused, "<gripper> & co": gripper}
    return identification_page(joints).html()


def test_a_page_on_data_that_says_nothing_can_still_be_drawn():
    nothing = Interval(-math.inf, math.inf)
    unknown = made_up(
        intervals=dict.fromkeys(PARAMETERS, nothing),
        gain_interval=nothing,
        held_out_rms=None,
        alternatives=(),
        verdict="refused",
    )
    assert identification_page({"": unknown}).html().count("not determined") >= 5


def test_every_log_is_drawn_row_by_row_and_zoomed_by_its_button(browser, several, tmp_path):
    page = tmp_path / "report.html"
    page.write_text(several)
    figures = browser.read_through(page, width=WIDTH, height=HEIGHT, dark=True)
    assert len(figures) == 3 * (2 + 1)  # of each joint the cloud, intervals and log
    log = next(name for name in figures if "log" in name)
    plot = f"document.querySelector('[id=\"{log}\"] .canvas')"
    measured = f"{plot}.data.find((trace) => trace.name === 'measured')"
    assert browser.ask(f"atob({measured}.y.bdata).length") == 4 * 1000  # bytes of every row
    assert browser.ask(f"{plot}.data.map((trace) => trace.yaxis).join()").endswith("y,y2,y2")
    browser.ask(f"[...{plot}.parentElement.querySelectorAll('.views button')].at(-1).click()")
    browser.wait_for(f"{plot}.layout.xaxis.range[1] - {plot}.layout.xaxis.range[0] <= 3.001")
    assert browser.complaints == []
    assert browser.asked_of_others == []
    picture = browser.screenshot()
    assert struct.unpack(">II", picture[16:24]) == (WIDTH, HEIGHT)
    assert len(picture) > 20_000  # an empty page of this size takes a few thousand bytes


def test_a_top_speed_that_is_a_guess_does_not_flatten_the_cloud():
    found = never_saturated()
    guessed = replace(found, model=replace(found.model, v_max=5.0 * found.model.v_max))
    fastest = np.max(np.abs(cloud_of(guessed)[0].speeds))
    assert cloud_of(guessed)[2] < 2.0 * fastest


def test_of_a_joint_with_inertia_the_points_of_its_model_stand_beside_the_measured_ones():
    slow = replace(JOINT, time_constant=0.1)
    log = made_up_log()
    log = replace(log, angles=simulate(slow, log.requests, cyclic=False))
    found = made_up(model=slow, fits=(made_up_fit(log, slow),))
    curves = {curve.name: curve for curve in cloud_figure(found).panels[0].curves}
    measured, model = (curves[f"{whose}, as its speed changes"] for whose in ("measured", "model"))
    np.testing.assert_allclose(measured.x, model.x)
    np.testing.assert_allclose(measured.y, model.y)
    on_f = curves["measured"]
    off = np.degrees(slow.speed(np.radians(on_f.x))) - on_f.y
    assert len(on_f.x) > 50
    assert np.max(np.abs(off)) <= 0.021 * np.degrees(slow.v_max)
    assert len(model.x) > 200
    assert not any("model," in curve.name for curve in cloud_figure(made_up()).panels[0].curves)
