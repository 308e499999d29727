"""A table is one description: a page and a terminal have the same cells, escaped on the page."""

import re

import pytest

from planner.report.wording import NOTHING, Column, Row, Table, environment, fitted_to

PARTS = ("ours", "paper", "diff.")
WIDE = ["joint", *(f"column{k}" for k in range(12))]
ROWS = [[f"joint number {j}", *(f"{j}.{k} deg" for k in range(12))] for j in range(3)]


def drawn(table):
    return environment().from_string("{{ table }}").render(table=table)


def table(**more):
    columns = (Column("knee", PARTS, joined="{0} / {1} ({2})"), Column("<words>", words=True))
    rows = (
        Row("L2", (("1.00\n± 0.1", "2.00", "−50 %"), "a & b"), "direct"),
        Row("Linf", (("3.00\n± 0.2", NOTHING, NOTHING), "five\nsix"), "direct", "beyond"),
        Row("L2", (("4.00", "4.00", "0 %"), ""), "shift"),
    )
    return Table("what", columns, rows, **more)


def test_a_terminal_joins_the_parts_of_a_cell_and_shows_every_subject_once():
    lines = table().text().splitlines()
    assert re.split("  +", lines[0]) == ["what", "knee", "<words>"]
    assert re.split("  +", lines[1]) == ["direct, L2", "1.00 ± 0.1 / 2.00 (−50 %)", "a & b"]
    assert re.split("  +", lines[2]) == ["direct, Linf", "3.00 ± 0.2", "five (six)"]
    lines = table(apart=True).text().splitlines()
    assert re.split("  +", lines[1])[:2] == ["direct", "L2"]
    assert lines[2].split() == ["Linf", "3.00", "±", "0.2", "five", "(six)"]
    assert lines[3].startswith("shift")


def test_a_page_has_every_part_in_a_cell_and_every_subject_once():
    html = drawn(table(label="Table <2>"))
    assert 'aria-label="Table &lt;2&gt;"' in html
    assert '<th scope="rowgroup" rowspan="2">direct</th>' in html
    assert html.count(">direct<") == 1
    assert "<td class=part>1.00 <small>± 0.1</small></td><td>2.00</td><td>−50 %</td>" in html
    assert "<td class=words>a &amp; b</td>" in html
    assert '<th scope="colgroup" colspan="3">knee</th>' in html
    assert '<th scope="col" class="words">&lt;words&gt;</th>' in html
    rows = [re.findall(r"<t[hd]", row) for row in re.findall(r"<tr.*?</tr>", html, re.DOTALL)]
    assert [len(row) for row in rows] == [3, 5, 6, 5, 6]


def test_a_page_writes_minus_signs_and_leaves_names_alone():
    cells = ("-0.26", "\u22125.8 to -3.2\n-7 %", "1e-05", "log-2", "--at height=-0.1")
    rows = (Row("-1 V", cells),)
    html = drawn(Table("", tuple(map(Column, "abcde")), rows))
    assert "−0.26" in html
    assert "−5.8 to −3.2 <small>−7 %" in html
    assert "1e-05" in html
    assert "log-2" in html
    assert "height=-0.1" in html


def parts_of(text, rows):
    """The parts of one table, which stand right below one another, each with all rows."""
    lines = text.splitlines()
    assert all(lines), "blank lines stand between two tables only"
    return [lines[k : k + rows] for k in range(0, len(lines), rows)]


@pytest.mark.parametrize("width", [40, 80, 120])
def test_a_table_that_is_wider_than_the_terminal_goes_on_below_with_every_cell(width):
    wide = Table(WIDE[0], WIDE[1:], (Row(about, cells) for about, *cells in ROWS))
    whole = wide.text()
    with fitted_to(width):
        blocks = parts_of(wide.text(), 1 + len(ROWS))
    assert max(map(len, whole.splitlines())) > width
    assert len(blocks) > 1
    assert all(len(line) <= width for block in blocks for line in block)
    for j, row in enumerate([WIDE, *ROWS]):
        assert all(block[j].startswith(row[0]) for block in blocks)
        cells = [cell for block in blocks for cell in block[j][len(row[0]) :].split("  ") if cell]
        assert [cell.strip() for cell in cells] == row[1:]
    assert wide.text() == whole
