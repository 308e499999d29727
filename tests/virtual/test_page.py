"""The report of the virtual robot: one page that needs nothing else."""

from __future__ import annotations

import pytest

PICTURES = (
    "foot_paths",
    "step_tests",
    "joints_direct",
    "trajectories",
    "foot_optimised_trajectories",
    "learning",
    "joints_by_method",
)


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "report.html").read_text()


def test_every_constant_of_the_robot_stands_in_the_page(text, results):
    for name, constant in results["robot"]["constants"].items():
        assert f'<th scope="row">{name.replace("_", " ")}</th>' in text
        assert constant["source"].replace("'", "&#39;") in text


def test_every_figure_comes_to_life_without_a_complaint_or_a_request(folder, browser):
    assert set(browser.read_through(folder / "report.html", dark=True)) == set(PICTURES)
    title = browser.ask("document.querySelector('h1').textContent")
    assert title == "The paper’s experiment on a virtual robot"
