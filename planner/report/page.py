"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from planner.report.figures import Picture
from planner.report.live_page import live_head, live_scripts
from planner.report.paper_tables import GAPS, KEPT, foot_rows, table2_rows
from planner.report.render import to_inline_svg
from planner.report.style import ROLES

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup

PARAMETERS = {
    "v_max": "top speed [rad/s]",
    "theta_0": "error from which on the joint moves at top speed [rad]",
    "lag": "lag [s]",
    "acceleration_time": "acceleration time [s]",
    "tick": "time step of the model [s]",
    "hold": "ticks for which a request is held",
    "offset": "static sag [rad]",
}
"""What the parameters of a joint are called in words."""

FEATURED = ("figure8_foot_paths", "joints_by_method")
"""The pictures after the key figures: the moving leg and its joints."""


def page(results: Mapping[str, Any], pictures: Sequence[Picture], files: Sequence[str]) -> str:
    """The whole page.

    Args:
        results: The content of ``results.json``.
        pictures: The pictures, in order; drawn into the page.
        files: Files of the run to link to, relative to the page.
    """
    return experiment_page(
        "report.html",
        results,
        pictures,
        files,
        featured=FEATURED,
        gap_of=GAPS,
        kept=KEPT,
        parameters=PARAMETERS,
    )


def experiment_page(
    template: str,
    results: Mapping[str, Any],
    pictures: Sequence[Picture],
    files: Sequence[str],
    *,
    featured: Sequence[str],
    **more: object,
) -> str:
    """The page of an experiment whose results are shaped like those of the paper's.

    Args:
        template: Name of the template.
        results: The content of ``results.json``.
        pictures: The pictures, in order; drawn into the page.
        files: Files of the run to link to, relative to the page.
        featured: Names of the pictures after the key figures.
        more: What else the template needs.
    """
    live = {picture.name: picture.live for picture in pictures if picture.live is not None}
    return (
        environment()
        .get_template(template)
        .render(
            results=results,
            table2=table2_rows(results),
            foot=foot_rows(results),
            pictures=pictures,
            drawn=drawn,
            featured=[picture for picture in pictures if picture.name in featured],
            live_head=live_head(),
            live_scripts=live_scripts(live),
            files=files,
            roles=ROLES,
            **more,
        )
    )


def drawn(picture: Picture) -> Markup:
    """The picture as an element of a page."""
    from markupsafe import Markup

    return Markup(  # its words are escaped where it is drawn
        to_inline_svg(picture.figure, name=picture.name, description=picture.description)
    )


def environment() -> jinja2.Environment:
    """Where every page finds its template, and how it writes numbers."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("planner.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["fixed"] = lambda value, digits=2: f"{value:.{digits}f}"
    environment.filters["percent"] = lambda share, digits=1: f"{100.0 * share:.{digits}f} %"
    return environment
