"""A page: one HTML file that needs nothing else, from a template and the values that it shows."""

from __future__ import annotations

import base64
import gzip
import json
import math
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from planner._version import __version__
from planner.report.figure import ROLES, Figure, Role
from planner.report.wording import (
    NOTHING,
    UNITS,
    Row,
    Table,
    Unit,
    breakable,
    environment,
    signed,
    table_with_units,
)

if TYPE_CHECKING:
    from planner.model.joint import JointModel

Written = Iterable[tuple[str, "Path | str | None"]]
"""Role and path of each file of a run; None or an empty name for none."""

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
    """A page: a template that extends ``base.html``, and the values that its blocks show."""

    def __init__(self, template: str, **values: Any) -> None:
        """Keep the template's name, such as "plan", and the values."""
        self.template, self.values = template, values

    def html(
        self, place: Path | str = "", origins: Iterable[tuple[str, str]] = (), written: Written = ()
    ) -> str:
        """The whole page; at a ``place`` with its inputs and links to the files of its run."""
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


def plain(value: Any) -> Any:
    """A description as plain data, with every role as it looks, and the pairs of mappings."""
    if isinstance(value, np.ndarray):
        return base64.b64encode(value.astype("<f4").tobytes()).decode()
    if isinstance(value, Role):
        names = ("label", "colour", "pixels", "strokes")
        return {name: getattr(value, name) for name in names}
    if is_dataclass(value):
        return {name: plain(each) for name, each in vars(value).items()}
    if isinstance(value, Mapping):
        return [[plain(each) for each in pair] for pair in value.items()]
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    return value


def plot(figure: Figure) -> dict[str, Any]:
    """The figure as plain data, which the page's script draws."""
    whole = replace(figure, x=replace(figure.x, range=figure.x_range))
    shown = ("x", "panels", "over_time", "equal", "clock", "views")
    return {"kind": "plot"} | {name: plain(getattr(whole, name)) for name in shown}


def live_scripts(figures: Mapping[str, Mapping[str, Any]]) -> Markup:
    """The elements at the end of a page's body that bring its figures, by identifier, to life."""
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


def models_table(
    models: Mapping[str, JointModel], units: Mapping[str, Unit] | None = None
) -> Table:
    """The parameters of every joint, in degrees or in its unit, and in milliseconds."""
    names = parameters_of([model.parameters() for model in models.values()])
    titles = {name: PARAMETERS[name][1] for name in names}
    rows = []
    for joint, model in models.items():
        unit, cells = UNITS["rad"] if units is None else units[joint], dict[str, tuple[str, str]]()
        for name, title in titles.items():
            (factor, words), value = shown_in(name, unit), getattr(model, name)
            size = NOTHING if math.isinf(value) else signed(f"{factor * value:.4g}")
            cells[title] = (size, words)
        rows.append((Row(joint), cells))
    return table_with_units("joint", list(titles.values()), rows, "Models")


def shown_in(parameter: str, unit: Unit) -> tuple[float, str]:
    """The factor from SI to the unit in which a parameter is shown of a joint, and this unit."""
    from planner.files.joint_model import PARAMETER_UNITS

    si = PARAMETER_UNITS.get(parameter, "1/s").replace("^2", "²")
    if si == "s":
        return 1e3, "ms"
    if si == "ticks":
        return 1.0, ""
    if "rad" not in si:
        return 1.0, si
    return unit.factor, si.replace("rad", unit.words if si == "rad" else unit.sign)


def parameters_of(models: Sequence[Mapping[str, float]]) -> list[str]:
    """The names of the parameters to show of some models."""
    from planner.model.joint import JointModel

    shown = "v_max", "theta_0", "lag", "acceleration_time", "tick", "hold", "offset"
    names = (each.name for each in fields(JointModel))
    return [name for name in names if name in shown or any(each.get(name) for each in models)]


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
    """Title and pairs of name and content of the lists at the end of a page; none is empty."""
    # "-" is standard input or output; one file may have several roles
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
