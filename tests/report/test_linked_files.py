"""Links of a page, relative to it and none to what is no file; and the versions on it."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from urllib.parse import unquote, urljoin, urlsplit

import pytest

from planner._version import __version__
from planner.report.page import LIBRARIES, linked_files, versions


@pytest.mark.parametrize(
    "name", ["plain.csv", "with blank.csv", "a#b?c%20d.csv", "co:lon.csv", "ünï.csv", "../up.csv"]
)
def test_a_browser_at_the_page_finds_the_file(tmp_path, name):
    page, file = tmp_path / "pages" / "page.html", tmp_path / "pages" / name
    (link,) = linked_files(page, [("requests", file)])
    seen = urlsplit(urljoin(page.as_uri(), link.href))
    assert unquote(seen.path) == str(file.resolve())
    assert not seen.query
    assert not seen.fragment
    assert (link.role, link.name) == ("requests", name)


def test_streams_and_absent_files_are_no_links_and_none_stands_twice(tmp_path):
    files = [("a", "-"), ("b", None), ("c", ""), ("d", tmp_path / "x"), ("e", f"{tmp_path}/./x")]
    assert [link.role for link in linked_files(tmp_path / "page.html", files)] == ["d"]


def test_a_page_named_without_a_folder_stands_in_the_working_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (link,) = linked_files("page.html", [("requests", "requests.csv")])
    assert link.href == "requests.csv"


def test_every_library_has_its_version_or_an_unknown_one(monkeypatch):
    def of(name):
        if name == "scipy":
            raise PackageNotFoundError(name)
        return version("numpy")

    monkeypatch.setattr("planner.report.page.version", of)
    assert versions("mujoco") == {
        "request-planner": __version__,
        "python": platform.python_version(),
        **dict.fromkeys((*LIBRARIES, "mujoco"), version("numpy")),
        "scipy": "unknown",
    }
