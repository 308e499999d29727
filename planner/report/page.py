"""A page: one HTML file that needs nothing else, from a template and the values that it shows.

Figures are plain dictionaries in Plotly's terms, which the page's scripts draw; nothing of Plotly's
Python package is needed to make them. Colours are written as the page's own, ``var(--direct)``; the
script looks them up, so that a plot is light or dark with the page.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from markupsafe import Markup

from planner._version import __version__
from planner.report.figure import Axis, Curve, Figure, Panel, around
from planner.report.style import INK, MUTED, ROLES
from planner.report.wording import NOTHING, Row, Table, breakable, environment, signed

if TYPE_CHECKING:
    from planner.model.joint import JointModel

Written = Iterable[tuple[str, "Path | str | None"]]
"""Role and path of each file of a run; None or an empty name for none."""

GAP = 34
"""Between panels, room for a title [px]."""

PARAMETERS: Mapping[str, tuple[str, str]] = {
    "v_max": ("top speed", "top speed v_max"),
    "theta_0": ("error that calls for top speed", "threshold theta_0"),
    "gain": ("speed per error below that", "v_max / theta_0"),
    "lag": ("lag", "lag"),
    "acceleration_time": ("acceleration time", "acceleration time"),
    "tick": ("time step of the model", "tick"),
    "hold": ("ticks for which a request is held", "hold"),
    "offset": ("static sag", "static sag"),
    "dead_band": ("error that does not move it (dry friction, play)", "dead band"),
    "v_offset": ("top speed up less v_max", "up less v_max"),
    "compliance": ("sag per torque", "compliance"),
    "speed_per_torque": ("top speed per torque", "speed per torque"),
    "time_constant": ("time constant of the speed", "time constant"),
    "max_acceleration": ("largest acceleration", "acceleration"),
    "sag_sin": ("sag by the sine of the angle (gravity)", "sag by sine"),
    "sag_cos": ("sag by the cosine of the angle (gravity)", "sag by cosine"),
    "integral_rate": ("rate of the speed loop's integral", "integral rate"),
    "position_integral_rate": ("rate of the position's integral", "position integral"),
}
"""Descriptions of a joint's parameters, long and short; ``gain`` is v_max / theta_0."""


class Page:
    """A page: a template that extends ``base.html``, and the values that its blocks show.

    The words of a page are its template's. There ``{{ table }}`` draws a table and
    ``{{ show(figure) }}`` a figure, or a list of them side by side; ``macros.html`` has the parts
    that pages are made of. Everything is escaped where it is drawn.
    """

    def __init__(self, template: str, **values: Any) -> None:
        """Keep the template's name, such as "plan", and the values."""
        self.template, self.values = template, values

    def html(
        self, place: Path | str = "", origins: Iterable[tuple[str, str]] = (), written: Written = ()
    ) -> str:
        """The whole page; the same content makes the same page.

        Of a file at a ``place`` it ends with its inputs, ``origins``, and the files of its run,
        ``written``, by role: links are relative to it, so that it may move together with them.
        Standard input or output ("-"), missing files (None, "") and duplicates are left out.
        """
        templates, drawn = environment(), dict[str, Mapping[str, Any]]()
        element, downloads = templates.get_template("figure.html"), "files" in self.values

        def show(figures: Figure | Sequence[Figure]) -> Markup:
            if isinstance(figures, Figure):
                data = drawn[figures.name] = figures.live or plot(figures)
                return Markup(element.render(figure=figures, live=data, downloads=downloads))
            if not figures:
                return Markup()
            kind = "pictures many" if len(figures) > 5 else "pictures"  # in columns, not in rows
            elements = Markup("\n").join(map(show, figures))
            return Markup('<div class="{}">\n{}\n</div>').format(kind, elements)

        return templates.get_template(f"{self.template}.html").render(
            sources=sources_of(place, origins, written) if place else [],
            roles=ROLES,
            show=show,
            live_scripts=lambda: live_scripts(drawn),
            version=__version__,
            **self.values,
        )


def plot(figure: Figure) -> dict[str, Any]:
    """The figure as a plot, of ``data`` and ``layout``: zoom one panel along x, and all follow."""
    heights = [150 * panel.height for panel in figure.panels]  # [px]
    inner = top = sum(heights) + GAP * (len(heights) - 1)
    above = 30 + (18 if figure.panels[0].title else 0)  # for the buttons
    below = 8 if figure.x.names == {} else 46  # for the axis
    data, axes, words, shapes = list[Any](), dict[str, Any](), list[Any](), list[Any]()
    place: dict[str, Any]
    start, end = figure.x_range
    across = _axis(figure.x, standoff=8) | {"range": [start, end]}
    if figure.over_time:
        across |= {
            "anchor": f"y{len(heights)}" if len(heights) > 1 else "y",
            "minallowed": start,
            "maxallowed": end,
            "unifiedhovertitle": {"text": f"%{{x:.{figure.x.decimals}f}} {figure.x.unit}"},
            "showspikes": figure.clock is None,
            "spikemode": "across",
            "spikesnap": "cursor",
            "spikethickness": 1,
            "spikedash": "solid",
            "spikecolor": MUTED.colour,
        }
    if figure.clock is not None:  # the line at the moment of the moving leg; the script moves it
        place = {"xref": "x", "yref": "paper", "x0": 0, "x1": 0, "y0": 0, "y1": 1}
        look = {"line": {"color": INK.colour, "width": 1.2}, "layer": "above"}
        shapes.append({"type": "line", **place, **look})
    for number, (panel, height) in enumerate(zip(figure.panels, heights, strict=True), 1):
        axis = "y" if number == 1 else f"y{number}"
        domain = [round(max(top - height, 0.0) / inner, 6), round(top / inner, 6)]
        top -= height + GAP
        upward, ends = _axis(panel.y, standoff=6) | {"domain": domain}, panel.y.range
        if figure.equal:
            upward["scaleanchor"] = "x"
            ends = around([curve.y for curve in panel.curves])
        if panel.y.names is None:
            upward |= {"nticks": 6, "rangemode": "tozero" if panel.y.from_zero else "normal"}
        axes[axis.replace("y", "yaxis")] = upward if ends is None else upward | {"range": [*ends]}
        data += [{**_trace(curve, figure, panel), "yaxis": axis} for curve in panel.curves]
        if panel.title:
            title = {"text": f"<b>{escape(panel.title, False)}</b>", "x": 0, "y": domain[1]}
            corner = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
            words.append({**title, **corner, "showarrow": False})
        words += [
            {
                "text": escape(each.text, False).replace("v_max", "v<sub>max</sub>"),
                "x": each.x,
                "y": each.y,
                "xref": "x",
                "yref": axis,
                "xanchor": each.across,
                "yanchor": each.upward,
                "showarrow": False,
                "font": {"color": INK.colour, "size": 12},
            }
            for each in panel.words
        ]
        for span in panel.spans:  # across the panel
            place = {"xref": "x", "yref": f"{axis} domain", "x0": span.start, "x1": span.end}
            place |= {"y0": 0, "y1": 1}
            if span.along == "y":
                place = {"xref": "paper", "yref": axis, "x0": 0, "x1": 1}
                place |= {"y0": span.start, "y1": span.end}
            fill = {"fillcolor": span.role.colour, "opacity": span.opacity, "line": {"width": 0}}
            shapes.append({"type": "rect", **place, **fill, "layer": "below"})
    layout = {
        "xaxis": across,
        **axes,
        "annotations": words,
        "shapes": shapes,
        "hovermode": "x unified" if figure.over_time else "closest",
        "showlegend": False,  # the page has its own, of buttons
        "margin": {"l": 58, "r": 12, "t": above, "b": below},
        "uirevision": "kept",
    }
    return {
        "kind": "plot",
        "data": data,
        "layout": layout,
        "height": inner + above + below,
        "clock": figure.clock,
        "views": {name: list(ends) for name, ends in figure.views.items()},
    }


def _trace(curve: Curve, figure: Figure, panel: Panel) -> dict[str, Any]:
    """A curve with its looks, and with what is written beside the pointer."""
    colour = curve.role.colour
    trace: dict[str, Any] = {
        "type": "scatter",
        "name": curve.name,
        # in the fewest bytes that Plotly takes: single precision, little-endian
        **{
            axis: {
                "dtype": "f4",
                "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode(),
            }
            for axis, values in (("x", curve.x), ("y", curve.y))
        },
        "visible": "legendonly" if curve.hidden else True,
        "connectgaps": False,
    }
    if not curve.marks:
        line = {
            "color": colour,
            "width": curve.role.pixels,
            "dash": curve.role.strokes,
            "shape": "hv" if curve.held else "linear",
            "simplify": False,  # which makes a polygon of a wide line
        }
        trace |= {"mode": "lines", "line": line}
    else:
        marker = {"color": colour, "opacity": curve.opacity, "line": {"color": colour, "width": 0}}
        if curve.marks == "rings":
            marker = {"color": "rgba(0,0,0,0)", "line": {"color": colour, "width": 1.6}}
        trace |= {"mode": "markers", "marker": marker | {"size": 4.5 if curve.opacity < 1.0 else 7}}
    if curve.notes:
        trace["text"] = list(curve.notes)
    if not curve.legend:
        return trace | {"hoverinfo": "skip", "showlegend": False}
    note = " · %{text}" if curve.notes else ""
    if figure.over_time:
        return trace | {"hovertemplate": f"%{{y:.{panel.y.decimals}f}} {panel.y.unit}{note}"}
    axes = {
        letter: axis for letter, axis in (("x", figure.x), ("y", panel.y)) if axis.names is None
    }
    each = (f"%{{{k}:.{axis.decimals}f}} {axis.unit}".rstrip() for k, axis in axes.items())
    template = f"{', '.join(each)}{note}<extra>%{{fullData.name}}</extra>"
    return trace | {"hovertemplate": template}


def _axis(axis: Axis, *, standoff: float) -> dict[str, Any]:
    layout: dict[str, Any] = {
        "gridcolor": "var(--grid)",
        "linecolor": MUTED.colour,
        "zeroline": False,
        "title": {"text": escape(axis.words, False), "standoff": standoff},
    }
    if axis.names is not None:
        words = [escape(name, False) for name in axis.names.values()]
        layout |= {"tickvals": list(axis.names), "ticktext": words}
        layout |= {"automargin": True, "showgrid": False}
    return layout


def live_scripts(figures: Mapping[str, Mapping[str, Any]]) -> Markup:
    """The elements at the end of a page's body that bring its figures, by identifier, to life.

    Plotly is packed, which makes a page of 5 MB one of 2 MB.
    """
    # Within a script no "<" may stand that could end it.
    data = json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = [f'<script type="application/json" id="live-figures">{data}</script>']
    if any(figure["kind"] == "plot" for figure in figures.values()):
        parts.append(f'<script type="text/plain" id="plotly">{_library()}</script>')
    folder = files("planner.report").joinpath("scripts")
    parts += [
        f"<script>\n{folder.joinpath(name).read_text('utf-8')}</script>"
        for name in ("live.js", "plots.js", "leg.js", "moment.js", "tables.js")
    ]
    return Markup("\n".join(parts))  # our own, and JSON without markup


def models_table(names: Sequence[str], models: Sequence[JointModel]) -> Table:
    """The parameters of every joint."""
    titles = parameters_of([model.parameters() for model in models])
    rows = []
    for joint, model in zip(names, models, strict=True):
        values = (getattr(model, name) for name in titles)
        cells = [NOTHING if math.isinf(each) else signed(f"{each:.4g}") for each in values]
        rows.append(Row(joint, cells))
    return Table("joint", titles.values(), rows, "Models")


def parameters_of(models: Sequence[Mapping[str, float]]) -> dict[str, str]:
    """The parameters to show for some models, by name, in a few words."""
    from planner.model.joint import JointModel

    return {
        each.name: f"{PARAMETERS[each.name][1]} [{each.metadata['unit'].replace('^2', '²')}]"
        if each.name != "hold"
        else "hold"
        for each in fields(JointModel)
        if each.name in ("v_max", "theta_0", "lag", "acceleration_time", "tick", "hold", "offset")
        or any(model.get(each.name) for model in models)
    }


def versions(*more: str) -> dict[str, str]:
    """Versions of this project, of Python, and of the libraries whose numbers these are."""
    from importlib.metadata import PackageNotFoundError, version  # takes 10 ms

    by_package = {"request-planner": __version__, "python": platform.python_version()}
    libraries = ("numpy", "scipy", "casadi", "clarabel", "cvxpy", "pin", "matplotlib", "plotly")
    for library in (*libraries, *more):
        try:
            by_package[library] = version(library)
        except PackageNotFoundError:  # installed by other means than a package
            by_package[library] = "unknown"
    return by_package


def sources_of(
    page: Path | str, origins: Iterable[tuple[str, str]] = (), files: Written = ()
) -> list[tuple[str, list[tuple[str, Any]]]]:
    """The lists at the end of a page: its inputs, the files of its run by role, and versions.

    Each is a title with pairs of a name and its content; lists without any are left out.
    """
    folder, links = Path(page).resolve().parent, dict[str, tuple[str, Markup]]()
    for role, file in files:
        if file and str(file) != "-":
            name = Path(os.path.relpath(Path(file).resolve(), folder)).as_posix()
            href = f"./{quote(name)}" if ":" in name.split("/")[0] else quote(name)
            links.setdefault(href, (role, file_link(name, href)))
    lists: dict[str, list[tuple[str, Any]]] = {
        "Where it comes from": [(name, breakable(which)) for name, which in origins],
        "Files of this run": list(links.values()),
        "Versions": list(versions().items()),
    }
    return [each for each in lists.items() if each[1]]


def file_link(name: str, href: str = "") -> Markup:
    """A link to a file, by default to the one of this name beside the page."""
    return Markup('<a href="{}">{}</a>').format(href or name, breakable(name))


@cache
def _library() -> str:
    """Plotly's script, packed; the same bytes every time."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()
