"""The directive `gallery`: pages that the commands write at each build, behind their pictures."""

from __future__ import annotations

import base64
import contextlib
import html
import io
import json
import re
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from click.testing import CliRunner
from docutils import nodes
from matplotlib.figure import Figure
from sphinx.util.docutils import SphinxDirective

from planner.cli import cli

WALK = "--leg reference --unreachable clamp"


class Item(NamedTuple):
    """A page of the gallery.

    Attributes:
        name: The page's file, without its ending.
        title: What it is.
        commands: What writes it, in an empty folder.
        figure: The figure that stands for it: its `id` on the page.
    """

    name: str
    title: str
    commands: tuple[str, ...]
    figure: str


ITEMS = (
    Item(
        "foot",
        "A plan for a foot: the moving leg, the distances, every joint",
        (
            "gait -o foot.csv",
            f"plan foot.csv {WALK} --method foot-optimal -o requests.csv --report foot.html",
        ),
        "foot_distances",
    ),
    Item(
        "joints",
        "The same walk, planned joint by joint",
        ("gait -o foot.csv", f"plan foot.csv {WALK} -o requests.csv --report joints.html"),
        "joint_0",
    ),
    Item(
        "identified",
        "A model identified from a log: the verdict, the intervals, the residuals",
        (
            "excite --limits-deg -45:45 -o steps.csv --expected-log log.csv",
            "identify log.csv -o joint.toml --report identified.html",
        ),
        "speed",
    ),
    Item(
        "compared",
        "Closed form against optimised requests: how far they differ",
        ("gait -o foot.csv", f"compare foot.csv {WALK} --report compared.html"),
        "joint_0",
    ),
)
"""What is shown, in its order."""

LIVE = re.compile(r'<script type="application/json" id="live-figures">(.*?)</script>', re.DOTALL)

WIDTH, ROW = 4.8, 1.7  # width of a picture, height of a panel [in]


def figure_of(page, name):
    """The curves of a figure of a page, in the colours of the light page, as SVG."""
    plot = json.loads(LIVE.search(page)[1])[name]
    colours = dict(reversed(re.findall(r"(--[\w-]+):\s*([^;]+);", page)))  # light ones come first
    panels = plot["panels"]
    picture = Figure(figsize=(WIDTH, ROW * len(panels)), layout="constrained")
    rows = picture.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(rows, panels, strict=True):
        axes.set_ylabel(_title(panel["y"]))
        axes.grid(alpha=0.3)
        for curve in panel["curves"]:
            if not curve["hidden"]:
                role = curve["role"]
                colour = colours[role["colour"].removeprefix("var(").removesuffix(")")]
                style = {"ls": "", "marker": "."} if curve["marks"] else _line(role, curve["held"])
                axes.plot(_numbers(curve["x"]), _numbers(curve["y"]), color=colour, **style)
    rows[-1].set_xlabel(_title(plot["x"]))
    file = io.StringIO()
    picture.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def _title(axis):
    """The words of an axis."""
    return f"{axis['title']} [{axis['unit']}]{axis['note']}" if axis["unit"] else axis["title"]


def _line(role, held):
    """The looks of a line in Matplotlib's terms."""
    width, dashes = role["pixels"], role["strokes"].replace("px", "").split(",")
    solid = role["strokes"] == "solid"
    return {
        "lw": 0.7 * width,
        "ls": "-" if solid else (0, [float(each) / width for each in dashes]),
        "drawstyle": "steps-post" if held else "default",
    }


def _numbers(packed):
    return np.frombuffer(base64.b64decode(packed), dtype="<f4")


def written(item, folder):
    """The text of the page, written by its commands in a folder."""
    with contextlib.chdir(folder):
        for command in item.commands:
            result = CliRunner().invoke(cli, command.split())
            assert result.exit_code == 0, f"{command}: {result.stderr}"
        return Path(f"{item.name}.html").read_text(encoding="utf-8")


def write_gallery(app, error):
    """Write the pages and their pictures beside the site's own."""
    if error or app.builder.format != "html":
        return
    gallery = Path(app.outdir, "gallery")
    gallery.mkdir(exist_ok=True)
    for item in ITEMS:
        with tempfile.TemporaryDirectory() as folder:
            page = written(item, folder)
        (gallery / f"{item.name}.html").write_text(page, encoding="utf-8")
        (gallery / f"{item.name}.svg").write_text(figure_of(page, item.figure), encoding="utf-8")


def card(item):
    """A picture that opens its page, and the commands that write it."""
    title = html.escape(item.title)
    commands = html.escape("\n".join(f"request-planner {each}" for each in item.commands))
    place = f"gallery/{item.name}"
    return (
        f'<figure class="card"><a href="{place}.html"><img src="{place}.svg" alt="{title}"></a>'
        f'<figcaption><a href="{place}.html">{title}</a><pre>{commands}</pre></figcaption></figure>'
    )


class Gallery(SphinxDirective):
    """The cards of all pages."""

    def run(self):
        """Hand over HTML; the files it points to are written when the build has finished."""
        cards = "".join(card(item) for item in ITEMS)
        return [nodes.raw("", f'<div class="gallery">{cards}</div>', format="html")]


def setup(app):
    """Register the directive."""
    app.add_directive("gallery", Gallery)
    app.connect("build-finished", write_gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
