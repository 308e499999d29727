"""The report: one page that needs nothing else, and pictures in the page's own colours."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest

from planner.report.paper.tables import difference
from planner.report.style import ROLES

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


class Page(HTMLParser):
    """What a page links to, its identifiers, and whether its elements are closed in order."""

    VOID = ("meta", "link", "br", "img", "hr", "input")

    def __init__(self, text):
        super().__init__()
        self.links, self.ids, self.open, self.labels = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.links += [
            attributes[key] for key in ("href", "src", "xlink:href") if key in attributes
        ]
        self.ids += [attributes["id"]] if "id" in attributes else []
        if tag == "figure":
            self.labels.append(attributes.get("aria-label"))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "report.html").read_text()


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_every_link_is_a_file_of_the_run_or_a_place_in_the_page(page, folder):
    for link in page.links:
        if link.startswith("#"):
            assert link[1:] in page.ids
        elif not link.startswith("data:,"):
            assert (folder / link).is_file(), link


def test_elements_are_closed_and_identifiers_unique(page):
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))


def test_nothing_is_loaded_from_a_network(text):
    text = re.sub(r'<script type="[^"]*" id=.*?</script>', "", text)  # numbers in base 64
    addresses = set(re.findall(r"(?:https?:)?//[\w.]+[^\"'\s<>)]*", text))
    assert {address for address in addresses if "www.w3.org" not in address} == set()
    assert "@import" not in text
    assert "default-src 'none'; script-src 'unsafe-inline';" in text
    assert not re.findall(r"<(?:script|img|iframe|object)[^>]*\b(?:src|data)=", text)


def test_every_picture_is_drawn_described_and_linked(page, text, folder):
    assert {name for name in page.ids if name in PICTURES} == set(PICTURES)
    assert len(page.labels) == len(PICTURES)
    assert all(label and len(label) > 40 for label in page.labels)
    for name in PICTURES:
        assert (folder / "figures" / f"{name}.svg").read_text().startswith("<?xml")
        assert (folder / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert f'href="figures/{name}.svg"' in text


def test_pictures_wear_the_colours_of_the_page(text):
    body = text[text.index("<body>") :]
    for variable, role in ROLES.items():
        assert role.light not in body, role.label
        assert f"--{variable}: {role.light};" in text
        assert f"--{variable}: {role.dark};" in text


def test_pictures_are_not_dated(folder):
    for name in PICTURES:
        assert "<dc:date>" not in (folder / "figures" / f"{name}.svg").read_text()


def test_figures_of_the_results_stand_in_the_page(text, results):
    for entry in results["foot"].values():
        assert f"{entry['L2']:.2f}" in text
    assert "the paper&#39;s figures were measured on a robot" in text


@pytest.mark.parametrize(
    ("ours", "paper", "told"),
    [(9.1, 9.1, "0 %"), (10.0, 8.0, "+25 %"), (6.0, 8.0, "−25 %"), (9.11, 9.1, "0 %")],
)
def test_a_difference_is_relative_to_the_papers_figure(ours, paper, told):
    assert difference(ours, paper) == told
