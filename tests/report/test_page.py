"""Pages: their pictures, the files that they link to, versions, and life without scrolling."""

import html
import re
from urllib.parse import unquote, urljoin, urlsplit

import pytest

from planner.report.page import sources_of

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
        assert (folder / f"{name}.png").read_bytes()[:4] == b"\x89PNG"


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
