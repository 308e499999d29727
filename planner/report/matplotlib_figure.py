"""Figures of the paper in files: drawn by Matplotlib, as the same bytes every time."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.figure import MARGIN, Axis, Figure, Panel
from planner.report.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

WIDTH = 4.8
"""Width of a picture [inch]: legible on a phone, and between one and two columns of a paper."""

V_MAX = r"$v_\mathrm{max}$"


def pictures_of(figure: Figure) -> tuple[str, bytes]:
    """The figure as an SVG file, text as text, and as a PNG file, laid out once and not dated."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    svg, png = io.StringIO(), io.BytesIO()
    with mpl.rc_context(fname=Path(__file__).with_name("paper.mplstyle")):
        picture = draw(figure)  # printed by canvases: `savefig` draws it once before
        canvas: Any = FigureCanvasSVG(picture)
        canvas.print_svg(svg, metadata={"Date": None, "Creator": None})
        picture.set_layout_engine("none")
        picture.dpi = 200  # dots per inch
        canvas = FigureCanvasAgg(picture)
        canvas.print_png(png, metadata={"Software": None})
    rows = (row.rstrip() for row in svg.getvalue().splitlines())
    return "\n".join(rows) + "\n", png.getvalue()


def draw(figure: Figure) -> Picture:
    """The figure as Matplotlib draws it: the panels, and the legend above them."""
    from matplotlib.figure import Figure as Picture

    drawn = [curve for panel in figure.panels for curve in panel.curves if not curve.hidden]
    names = list(dict.fromkeys(curve.name for curve in drawn if curve.legend))
    # of the words, with the line before each and the blank behind it [inch]
    widths = [0.062 * len(name) + 0.56 for name in names]
    columns = len(names) or 1
    while columns > 1 and sum(map(max, np.array_split(widths, columns))) > WIDTH:
        columns -= 1
    heights = [panel.height for panel in figure.panels]
    # for the panels, the axis, their headings and the rows of the legend [inch]
    height = 1.5 * sum(heights) + 0.45 + 0.2 * sum(bool(panel.title) for panel in figure.panels)
    height += 0.22 * -(-len(names) // columns)
    picture = Picture(figsize=(WIDTH, height), layout="constrained")
    rows = picture.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    handles: dict[str, Any] = {}
    for axes, panel in zip(rows[:, 0], figure.panels, strict=True):
        _draw_panel(axes, panel, figure)
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    _set_axis(rows[-1, 0].xaxis, figure.x)
    picture.align_ylabels(list(rows[:, 0]))
    if names:
        entries = [handles[name] for name in names]
        picture.legend(entries, names, loc="outside upper left", ncols=columns)
    return picture


def _draw_panel(axes: Axes, panel: Panel, figure: Figure) -> None:
    for span in panel.spans:
        shade = axes.axvspan if span.along == "x" else axes.axhspan
        look = (span.role.light, span.opacity)
        shade(span.start, span.end, zorder=0.5, facecolor=look, linewidth=0.0)
    for order, curve in enumerate(curve for curve in panel.curves if not curve.hidden):
        role, looks = curve.role, dict[str, Any](linestyle="", marker="o")
        if not curve.marks:
            drawstyle = "steps-post" if curve.held else "default"
            looks = {"linewidth": role.width, "linestyle": role.dashes, "drawstyle": drawstyle}
            looks |= {"solid_capstyle": "butt"} if role.width > 5.0 else {}
        elif curve.marks == "rings":
            looks |= {"ms": 5.0, "mfc": "none", "mew": 1.3, "clip_on": False}
        else:
            looks |= {"ms": 2.3 if curve.opacity < 1.0 else 5.0, "mew": 0.0, "alpha": curve.opacity}
        looks |= {"color": role.light, "label": curve.name, "zorder": 3.0 + 0.01 * order}
        axes.plot(curve.x, curve.y, **looks)
    away = {"left": 4, "right": -4, "bottom": 4, "top": -4}  # from their place [pt]
    for words in panel.words:
        axes.annotate(
            words.text.replace("v_max", V_MAX),
            (words.x, words.y),
            xytext=(away.get(words.across, 0), away.get(words.upward, 0)),
            textcoords="offset points",
            ha=words.across,
            va={"middle": "center"}.get(words.upward, words.upward),
            fontsize=8.5,
            color=INK.light,
            zorder=6.0,
        )
    axes.set_title(panel.title, loc="left")
    _set_axis(axes.yaxis, panel.y)
    if figure.equal:
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(MARGIN)
        return
    axes.margins(y=0.09)
    axes.set_xlim(*figure.x_range)
    if panel.y.range is not None or panel.y.from_zero:
        axes.set_ylim(*(panel.y.range or (0.0, None)))


def _set_axis(axis: Any, description: Axis) -> None:
    """The words of an axis: its title, and names where it has them."""
    axis.set_label_text(description.words)
    if description.names is not None:
        words = [name.replace("v_max", V_MAX) for name in description.names.values()]
        axis.set_ticks(list(description.names), labels=words)
        axis.set_tick_params(length=0)
        axis.grid(visible=False)
