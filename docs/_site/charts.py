"""Charts above the tables of the benchmark's page, drawn from the tables themselves."""

from __future__ import annotations

import io
import re
from itertools import cycle
from typing import NamedTuple

from docutils import nodes
from matplotlib.figure import Figure
from sphinx.util.docutils import SphinxDirective

PAGE = "benchmark"
INK, COLOURS = "#1f2328", ("#0067a8", "#c8501a", "#00805f", "#b3126b", "#8a4b9f")
ROW, WIDTH = 0.24, 6.8  # height of a row of dots, width of a chart [in]


class Chart(NamedTuple):
    """How a table is drawn.

    Attributes:
        kind: ``columns`` for a line of dots per column, ``rows`` for one per row of the table,
            ``curves`` for a curve per column over the row's number.
        columns: Pattern of the columns that are drawn.
        label: What the numbers are, with their unit.
    """

    kind: str
    columns: str
    label: str


CHARTS = {
    "Inversion, instance by instance": Chart("columns", ", ms$", "time of the second solve [ms]"),
    "Gaps, rms error": Chart("columns", "^over ", "rms error above the lower bound [%]"),
    "Gaps, largest error": Chart("columns", "^over ", "largest error above the lower bound [%]"),
    "The foot": Chart("rows", "^(rms|largest), cm$", "distance of the foot from its path [cm]"),
    "Approximation, time by length": Chart("curves", ", s$", "time [s] over the number of samples"),
    "Approximation, 6 segments, side by side": Chart("rows", "^time, ms$", "time [ms]"),
    "Closed form of known curves, microseconds per cycle": Chart(
        "curves", "^rule", "time of a curve [µs] over the number of curves at once"
    ),
    "Streams on a virtual servo": Chart(
        "rows", "^(direct|EMA|feed-forward|shift|stream)$", "rms error [mrad]"
    ),
    "Streams, recorded requests predicted from the measured path": Chart(
        "rows", "^(raw|best shift|stream)$", "rms of recorded minus predicted requests [mrad]"
    ),
}
"""The charts by the heading of their table."""

SECTION = re.compile(
    r"^## (?P<title>[^\n]+)\n(?P<note>.*?)(?P<table>^\|.*?)(?=\n\n|\Z)", re.M | re.S
)


def _number(cell):
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def table_of(text):
    """The headings of the columns, and the rows: a name and numbers."""
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines()]
    head, _, *rows = cells
    return head[1:], [(row[0].strip(), [_number(cell) for cell in row[1:]]) for row in rows]


def drawn(chart, text):
    """A table as SVG."""
    head, rows = table_of(text)
    chosen = [j for j, name in enumerate(head) if re.search(chart.columns, name)]
    lines = {"columns": len(chosen), "rows": len(rows), "curves": 10}[chart.kind]
    figure = Figure(figsize=(WIDTH, 0.9 + ROW * lines), layout="constrained")
    axes = figure.add_subplot()
    series = {head[j]: [numbers[j] for _, numbers in rows] for j in chosen}
    if chart.kind == "columns":
        for y, (values, colour) in enumerate(zip(series.values(), cycle(COLOURS), strict=False)):
            axes.plot(values, [y] * len(values), "o", ms=4, alpha=0.5, color=colour)
            median = sorted(values)[len(values) // 2]
            axes.plot([median], [y], "|", ms=14, mew=2, color=colour)
        _name_lines(axes, [name.removesuffix(", ms").removesuffix(", %") for name in series])
    elif chart.kind == "rows":
        for (name, values), colour in zip(series.items(), cycle(COLOURS), strict=False):
            axes.plot(values, range(len(values)), "o", ms=5, color=colour, label=name)
        _name_lines(axes, [name for name, _ in rows])
    else:
        for (name, values), colour in zip(series.items(), cycle(COLOURS), strict=False):
            axes.plot(
                [_number(row) for row, _ in rows], values, "o-", ms=4, color=colour, label=name
            )
        axes.set_yscale("log")
    axes.set_xscale("log" if chart.kind == "curves" or _wide(series) else "linear")
    axes.set_xlabel(chart.label)
    axes.grid(alpha=0.3)
    if len(series) > 1 and chart.kind != "columns":
        axes.legend(frameon=False, fontsize=8)
    return _svg(figure)


def _wide(series):
    """Whether values span more than a decade, all of them above 0."""
    values = [value for each in series.values() for value in each if value == value]
    return min(values) > 0 and max(values) > 10 * min(values)


def _name_lines(axes, names):
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)


def _svg(figure):
    """A figure as SVG for a page, whose text has the colour of the page's."""
    for axes in figure.axes:
        axes.set_facecolor("none")
        axes.tick_params(colors=INK, labelsize=8)
        axes.xaxis.label.set(color=INK, size=9)
        for text in axes.get_legend().get_texts() if axes.get_legend() else ():
            text.set_color(INK)
        for side in axes.spines.values():
            side.set_color(INK)
    file = io.StringIO()
    figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    text = file.getvalue()[file.getvalue().index("<svg") :]
    return text.replace(INK, "var(--color-foreground-primary)")


class ChartDirective(SphinxDirective):
    """A chart of the table that is its content; its argument is the heading of the table."""

    has_content = True
    required_arguments = 1
    final_argument_whitespace = True

    def run(self):
        """Draw the table."""
        title = self.arguments[0]
        svg = drawn(CHARTS[title], "\n".join(self.content))
        html = f'<figure class="chart" role="img" aria-label="{title}, as a chart">{svg}</figure>'
        return [nodes.raw("", html, format="html")]


def _with_charts(_app, name, source):
    """Put a chart above every table of the page that has one."""

    def charted(section):
        if section["title"] not in CHARTS:
            return section[0]
        chart = f"```{{chart}} {section['title']}\n{section['table']}\n```\n\n"
        head, rows = section["table"].split("\n", 1)
        head = head.replace("_", "_\N{ZERO WIDTH SPACE}")  # where a narrow column breaks
        return f"## {section['title']}\n{section['note']}{chart}{head}\n{rows}"

    if name == PAGE:
        source[0] = SECTION.sub(charted, source[0])


def setup(app):
    """Register the directive, and put it where it belongs."""
    app.add_directive("chart", ChartDirective)
    app.connect("source-read", _with_charts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
