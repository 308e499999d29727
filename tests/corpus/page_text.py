"""What a reader of a page sees: its text, and what its figures draw, in a line each."""

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from planner.report.figure import ROLES

SKIPPED = ("script", "style", "svg")  # elements without text for the reader

BLOCKS = (
    *("p", "div", "h1", "h2", "h3", "h4", "li", "tr", "table", "figure", "figcaption", "section"),
    *("dt", "header", "footer", "nav", "main", "title", "summary", "details", "pre", "aside"),
)

VOID = ("meta", "link", "br", "img", "hr", "input", "wbr")  # elements that have no end

DATA = re.compile(r'<script type="[^"]*" id=.*?</script>', re.DOTALL)


class _Reader(HTMLParser):
    """What a page says and links to; its elements must be closed in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.parts: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self._open: list[str] = []
        self.feed(page)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.links += [given[key] for key in ("href", "src", "xlink:href") if key in given]
        self.ids += [given["id"]] if "id" in given else []
        if tag not in VOID:
            self._open.append(tag)
        if tag in BLOCKS or tag == "br":
            self.parts.append("\n")
        elif tag in ("td", "th"):
            self.parts.append(" | ")
        elif tag == "dd":  # on the line of its term
            while not self.parts[-1].strip():
                self.parts.pop()
            self.parts.append(": ")
        kind = given.get("class", "")
        if (tag in ("tr", "td") and kind) or kind == "verdict no":
            self.parts.append(f"{{{kind}}} ")
        if tag == "figure":
            assert len(given["aria-label"]) > 30, "every figure is described"
            self.parts.append(f"({given['aria-label']})")
        if tag == "a":
            self.parts.append(f"[{given['href']}] ")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag
        if tag in BLOCKS or tag == "dd":
            self.parts.append("\n")

    def handle_data(self, data: str) -> None:
        if not set(SKIPPED) & set(self._open):
            self.parts.append(re.sub(r"\s+", " ", data))


def text_of(page: str) -> str:
    """The text of a page, a line for each block and for each row of a table."""
    lines = (" ".join(line.split()) for line in "".join(_Reader(page).parts).split("\n"))
    return "\n".join(line for line in lines if line.strip(" |"))


def check_needs_nothing_else(page: str, folder: Path) -> None:
    """A page links to its own places and to files beside it, loads nothing, and has its colours."""
    reader = _Reader(page)
    assert len(reader.ids) == len(set(reader.ids))
    for link in reader.links:
        if link.startswith("#"):
            assert link[1:] in reader.ids
        elif not link.startswith("data:,"):
            assert (folder / unquote(link)).is_file(), link
    shown = DATA.sub("", page)
    addresses = re.findall(r"(?:https?:)?//[\w.]+[^\"'\s<>)]*", shown)
    assert [each for each in addresses if "www.w3.org" not in each] == []
    assert "default-src 'none'; script-src 'unsafe-inline';" in page
    assert not re.findall(r"@import|<(?:script|img|iframe|object)[^>]*\b(?:src|data)=", page)
    assert ('id="plotly"' in page) == ('"kind":"plot"' in page)
    for variable, role in ROLES.items():
        assert role.light not in shown[shown.index("<body>") :], role.label
        assert f"--{variable}: {role.light};" in page
        assert f"--{variable}: {role.dark};" in page


def figures_of(page: str) -> str:
    """A line for each figure of a page: of each curve its name, points, ends, and two sums.

    The sums of the values, and of the values by their places, differ where any value does. They are
    rounded to what single precision keeps. The last word is a checksum of how the figure looks.
    """
    found = re.search(r'id="live-figures">(.*?)</script>', page, re.DOTALL)
    figures = json.loads(found[1]) if found else {}
    return "\n".join(
        f"figure {name}: "
        + "; ".join([*map(_curve, _curves(figure)), *_around(figure)])
        + f"; look {zlib.crc32(json.dumps(_look(figure), sort_keys=True).encode()):08x}"
        for name, figure in figures.items()
    )


def _look(of: Any) -> Any:
    """What is said of a figure but for its numbers, which processors round in their own ways."""
    if isinstance(of, dict):
        return {
            name: _look(value)
            for name, value in of.items()
            if name not in "xy" or isinstance(value, dict)
        }
    if isinstance(of, list):
        return sorted({json.dumps(_look(each), sort_keys=True) for each in of})
    if isinstance(of, str):
        return re.sub(r"[\d.,−]+", "#", of)
    return of if isinstance(of, bool) or of is None else "#"


def _around(figure: dict[str, Any]) -> list[str]:
    """Ranges of axes, words and shades of a figure."""
    if figure["kind"] != "plot":
        return []
    panels = figure["panels"]
    axes = {"xaxis": figure["x"]}
    axes |= {f"yaxis{k if k > 1 else ''}": panel["y"] for k, panel in enumerate(panels, 1)}
    ranges = [
        f"{name} {' '.join(f'{end:.4g}' for end in axis['range'])}"
        for name, axis in axes.items()
        if axis["range"]
    ]
    words, shades = [], []
    for panel in panels:
        words += [panel["title"]] if panel["title"] else []
        words += [f"{each['text']} at {each['x']:.4g} {each['y']:.4g}" for each in panel["words"]]
        shades += [f"shade {each['start']:.4g} {each['end']:.4g}" for each in panel["spans"]]
    views = [f"view {name} {start:.4g} {end:.4g}" for name, (start, end) in figure["views"]]
    return [*ranges, *words, *shades, *views]


def _curves(figure: dict[str, Any]) -> list[dict[str, object]]:
    """The curves of a figure, and what moves in it, as if they were curves."""
    curves = [
        {**curve, "name": curve["label"] or curve["role"]["label"]}
        for panel in figure.get("panels", [])
        for curve in panel["curves"]
    ]
    motions = [
        {"name": each["name"], "x": np.ravel(each["points"]).tolist(), "y": each["distances"]}
        for each in figure.get("motions", [])
    ]
    kinds = [
        {"name": each["name"], "y": list(chain(*(values or [] for values in each["values"])))}
        for each in figure.get("kinds", [])
    ]
    return [*curves, *motions, *kinds]


def _curve(data: dict[str, object]) -> str:
    words = [str(data["name"])]
    for axis in ("x", "y"):
        values = numbers_of(data.get(axis))
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        places = np.arange(1, len(known) + 1) / len(known)
        size = float(np.sum(np.abs(known)))
        sums = [float(np.sum(known)), float(np.sum(known * places))]
        # What cancels is rounded to the size of what was added.
        least = 10.0 ** (np.floor(np.log10(size)) - 4) if size > 0.0 else 1.0
        shown = " ".join(f"{round(each / least) * least:.6g}" for each in sums)
        gaps = f" gaps {len(values) - len(known)}" if len(values) > len(known) else ""
        words.append(f"{axis} {len(known)}{gaps} {known.min():.4g} {known.max():.4g} {shown}")
    return " ".join(words)


def numbers_of(given: object) -> np.ndarray:
    """Numbers of a figure, as it packs them or in a list; none where they are no numbers."""
    if isinstance(given, str):
        return np.frombuffer(base64.b64decode(given), "<f4").astype(float)
    try:
        return np.array(given if isinstance(given, list) else [], dtype=float)
    except (TypeError, ValueError):
        return np.empty(0)
