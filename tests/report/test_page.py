"""Pages: their pictures, the files that they link to, versions, and life without scrolling."""

import html
import re
import shutil
import subprocess
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest

from planner.report.figure import DIRECT, Axis, Curve, Figure, Panel
from planner.report.page import live_scripts, plot, sources_of
from tests.browser import ARGUMENTS

PICTURES = (
    "figure1_foot_direct",
    "figure2_joints_direct",
    "figure3_step_40",
    "figure4_step_110",
    "figure5_speed",
    "figure6_approximation",
    "figure7_trajectories",
    "figure8_foot_paths",
    "foot_optimised_trajectories",
    "joints_by_method",
    "optimised_trajectories",
)

BUDGET = 10_000  # time that passes in the page before its picture is taken, on its own clock [ms]
FAR = 5_000  # how far below the screen the last figure stands [px]


def test_pictures_are_drawn_and_not_dated(reproduced):
    folder = reproduced.folder / "figures"
    for name in PICTURES:
        svg = (folder / f"{name}.svg").read_text()
        assert svg.startswith("<?xml")
        assert "<dc:date>" not in svg
        assert (folder / f"{name}.png").read_bytes()[:4] == b"\x89PNG"


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
    file.write_text(f"<!doctype html>{figures}{live_scripts(plots)}")
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


def links_of(page, files):
    """The list of links at the end of a page."""
    lists = dict(sources_of(page, files=files))
    return lists["Files of this run"]


@pytest.mark.parametrize(
    "name", ["plain.csv", "with blank.csv", "a#b?c%20d.csv", "co:lon.csv", "ünï.csv", "../up.csv"]
)
def test_a_browser_at_the_page_finds_the_file(tmp_path, name):
    page, file = tmp_path / "pages" / "page.html", tmp_path / "pages" / name
    ((role, link),) = links_of(page, [("requests", file)])
    href, shown = re.fullmatch(r'<a href="(.*)">(.*)</a>', link).groups()
    seen = urlsplit(urljoin(page.as_uri(), html.unescape(href)))
    assert unquote(seen.path) == str(file.resolve())
    assert not seen.query
    assert not seen.fragment
    assert (role, html.unescape(shown.replace("<wbr>", ""))) == ("requests", name)
