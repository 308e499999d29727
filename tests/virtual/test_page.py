"""The report of the virtual robot: one page that needs nothing else."""

from __future__ import annotations

PICTURES = (
    "foot_paths",
    "step_tests",
    "joints_direct",
    "trajectories",
    "foot_optimised_trajectories",
    "learning",
    "joints_by_method",
)


def test_every_figure_comes_to_life_without_a_complaint_or_a_request(folder, browser):
    assert set(browser.read_through(folder / "report.html", dark=True)) == set(PICTURES)
    title = browser.ask("document.querySelector('h1').textContent")
    assert title == "The paper’s experiment on a virtual robot"
