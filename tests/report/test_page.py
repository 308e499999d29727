"""Pages: their pictures, the files that they link to, versions, and life without scrolling."""

PICTURES = (
    "figure1_foot_direct",
    "figure2_joints_direct",
    "figure3_step_40",
    "figure4_step_110",
    "figure5_speed",
    "figure6_approximation",
    "figure7_trajectories",
    "figure8_foot_paths",
    "joints_by_method",
)


def test_pictures_are_drawn_and_not_dated(reproduced):
    folder = reproduced.folder / "figures"
    for name in PICTURES:
        svg = (folder / f"{name}.svg").read_text()
        assert svg.startswith("<?xml")
        assert "<dc:date>" not in svg
