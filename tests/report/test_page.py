"""The pictures of the report, in files beside it, and its differences from the paper."""

from __future__ import annotations

import pytest

from planner.report.paper.tables import difference

PICTURES = (
    "figure1_foot_direct",
    "figure2_joints_direct",
    "figure3_step_40",
    "figure4_step_110",
    "figure5_speed",
    "figure6_approximation",
    "figure7_trajectories",
    "figure8_foot_paths",
    "foot_distances",
    "foot_optimised_trajectories",
    "joints_by_method",
    "optimised_trajectories",
    "table2_agreement",
)


@pytest.mark.parametrize(
    ("ours", "paper", "told"),
    [(9.1, 9.1, "0 %"), (10.0, 8.0, "+25 %"), (6.0, 8.0, "−25 %"), (9.11, 9.1, "0 %")],
)
def test_a_difference_is_relative_to_the_papers_figure(ours, paper, told):
    assert difference(ours, paper) == told


def test_pictures_are_drawn_and_not_dated(folder):
    for name in PICTURES:
        svg = (folder / "figures" / f"{name}.svg").read_text()
        assert svg.startswith("<?xml")
        assert "<dc:date>" not in svg
        assert (folder / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
