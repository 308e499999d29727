"""A page that nobody scrolls: alive where it is opened for its picture."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from planner.report.figure import Axis, Curve, Figure, Panel
from planner.report.page import live_head, live_scripts
from planner.report.plotly_figure import plot
from planner.report.style import DIRECT
from tests.browser import ARGUMENTS

BUDGET = 10_000
"""Time that passes in the page before its picture is taken, on its own clock [ms]."""

FAR = 5_000
"""How far below the screen the last figure stands [px]."""


@pytest.fixture
def page(tmp_path):
    """A page with a plot on the screen and one far below it."""
    times = np.arange(11.0)
    panel = Panel(Axis("angle", "deg"), (Curve(DIRECT, times, times),))
    figure = Figure("hip", "", "", Axis("time", "ms"), (panel,), over_time=True)
    plots = {name: plot(figure) for name in ("near", "far")}
    figures = f'<div style="height: {FAR}px"></div>'.join(
        f'<figure id="{name}"><div class="live"></div></figure>' for name in plots
    )
    file = tmp_path / "page.html"
    file.write_text(f"<!doctype html>{live_head()}{figures}{live_scripts(plots)}")
    return file


def test_a_browser_that_shows_no_frame_before_its_picture_finds_the_page_alive(page, tmp_path):
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        pytest.skip("Chromium is not installed")
    done = subprocess.run(
        [executable, *ARGUMENTS, "--enable-logging=stderr", "--dump-dom",
         f"--user-data-dir={tmp_path / 'profile'}", f"--virtual-time-budget={BUDGET}",
         page.as_uri()],
        capture_output=True,
        text=True,
        check=True,
    )  # fmt: skip
    for name in ("near", "far"):
        assert f'<figure id="{name}" class="alive" data-drawn="">' in done.stdout
    assert "CONSOLE" not in done.stderr


def test_a_figure_far_below_the_screen_is_drawn_before_anybody_scrolls_there(page, browser):
    browser.open(page)
    browser.wait_for("'drawn' in document.getElementById('far').dataset")
    assert browser.ask("document.getElementById('far').getBoundingClientRect().top") > FAR
    assert browser.ask("scrollY") == 0
    assert browser.complaints == []
