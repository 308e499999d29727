"""The site's pages: every public name and page is on it, and nothing on it is fetched."""

import ast
import builtins
import re

import pytest

import kinematics
import planner
from tests.docs.blocks import PAGES, ROOT, blocks
from tests.report.test_page import PICTURES

DOCS = ROOT / "docs"


def _documented(package):
    """Names that the reference takes from a package."""
    names = set()
    for page in (DOCS / "reference").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        if f".. currentmodule:: {package}\n" in text:
            names.update(re.findall(r"^\.\. auto\w+:: (\w+)$", text, re.MULTILINE))
    return names


def test_the_reference_has_every_public_name_and_no_other():
    assert _documented("planner") == set(planner.__all__) - {"__version__"}
    own = {n for n in kinematics.__all__ if "kinematics" in getattr(kinematics, n).__module__}
    assert _documented("kinematics") == own


def test_every_page_is_in_the_table_of_contents():
    listed = {
        re.sub(r".*<(.*)>", r"\1", line)
        for block in re.findall(
            r"```\{toctree\}\n(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL
        )
        for line in block.splitlines()
        if line and not line.startswith(":")
    }
    pages = {page.relative_to(DOCS).with_suffix("").as_posix() for page in DOCS.rglob("*.md")}
    assert listed == pages - {"index"}


def test_pages_link_to_files_that_are_there_and_show_no_picture_from_elsewhere():
    for page in DOCS.rglob("*.md"):
        for target in re.findall(r"\]\(([^):#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).is_file(), f"{page}: {target}"
    for page in DOCS.rglob("*.md"):
        assert not re.search(r"!\[[^\]]*\]\(\w+:", page.read_text(encoding="utf-8")), page


def test_the_page_about_the_paper_names_tests_and_figures_that_exist():
    text = (DOCS / "paper.md").read_text(encoding="utf-8")
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", text)
    assert len(named) > 15
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8") or not test
    assert set(re.findall(r"`(figure\d_\w+)`", text)) <= set(PICTURES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_block_of_python_runs_by_itself_or_the_page_says_that_it_is_part_of_a_session(page):
    if "run one after the other, in one session" in page.read_text(encoding="utf-8"):
        return
    for block in (each for each in blocks(page) if each.language == "python"):
        nodes = list(ast.walk(ast.parse(block.code)))
        names = [node for node in nodes if isinstance(node, ast.Name)]
        own = {node.id for node in names if isinstance(node.ctx, ast.Store)} | {*dir(builtins)}
        own |= {getattr(node, key, "") for node in nodes for key in ("name", "asname", "arg")}
        assert {node.id for node in names} <= own, f"{page}, line {block.line}"
