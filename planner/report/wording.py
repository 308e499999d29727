"""The words of pages, figures and terminals: templates, tables, numbers and names."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import groupby, zip_longest
from numbers import Real
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from markupsafe import Markup, escape

if TYPE_CHECKING:
    import jinja2

NOTHING = "–"
"""Content of a cell without a value."""

_WIDTH: ContextVar[int | None] = ContextVar("_WIDTH", default=None)
"""Characters of a line; None, as for files, for any number."""


class Unit(NamedTuple):
    """The unit in which a joint's angles are shown."""

    name: str  # in names of results
    sign: str  # in figures
    words: str
    long: str  # in sentences
    factor: float  # from the unit of its logs, or of the package

    def sized(self, error: float | None) -> tuple[str, str]:
        """An error in the unit of the logs as a number, and this unit."""
        return (NOTHING, "") if error is None else (f"{self.factor * error:.3g}", self.words)


UNITS = {
    "rad": Unit("deg", "deg", "deg", "degrees", math.degrees(1.0)),
    "1": Unit("percent", "%", "% of range", "% of range", 100.0),
}
"""Units by those of logs: radians, or shares of the joint's range."""

CARRIED = {
    "deg": UNITS["rad"],
    "percent": UNITS["1"]._replace(factor=math.degrees(1.0)),
    "cm": Unit("cm", "cm", "cm", "cm", 100.0),
    "deg_or_percent": UNITS["rad"]._replace(
        name="deg_or_percent",
        sign="deg or %",
        words="deg or % of range",
        long="degrees or % of range",
    ),
}
"""Units of plans by their name: paths carry a percent of a range as a degree."""


def labelled(units: Mapping[str, Unit]) -> tuple[str, dict[str, str]]:
    """The unit of a table about joints, and their labels, with units where these differ."""
    if len({unit.sign for unit in units.values()}) == 1:
        return next(iter(units.values())).sign, {name: name for name in units}
    sign = CARRIED["deg_or_percent"].sign
    return sign, {name: f"{name} [{unit.words}]" for name, unit in units.items()}


def common(units: Iterable[str]) -> Unit:
    """The unit of an error over joints with units of these names, each counted in its own."""
    names = {*units}
    return CARRIED[names.pop() if len(names) == 1 else "deg_or_percent"]


def largest_of(sizes: Iterable[tuple[str, float]]) -> dict[str, float]:
    """The largest of sizes, each with the name of its unit, by unit."""
    pairs = [*sizes]
    return {unit: max(size for own, size in pairs if own == unit) for unit, _ in pairs}


def renamed(numbers: Mapping[str, Any], unit: Unit) -> dict[str, Any]:
    """Numbers for machines whose names say degrees, named with the unit that they carry."""
    return {
        re.sub(r"_deg(?=_per_s$|_s$|$)", f"_{unit.name}", name): (
            renamed(value, unit) if isinstance(value, Mapping) else value
        )
        for name, value in numbers.items()
    }


@contextmanager
def fitted_to(width: int | None) -> Iterator[None]:
    """Let tables that are drawn as text in the block be at most so wide; None for any width."""
    token = _WIDTH.set(width)
    try:
        yield
    finally:
        _WIDTH.reset(token)


@dataclass(frozen=True)
class Column:
    """A column of cells, or several under one title."""

    title: str
    parts: tuple[str, ...] = ()  # titles of the columns under it; none for a single column
    words: bool = False  # whether its cells are words, which stand on the left and may break

    # how a terminal writes the parts of a cell, as for `str.format`; the first part alone where
    # the second is `NOTHING`
    joined: str = "{0}"


@dataclass(frozen=True)
class Row:
    """A row."""

    about: str  # its label, in the first column

    # its cells: words, or one for each part of their column. Text after a line break is a note
    cells: Sequence[str | tuple[str, ...]] = ()
    subject: str = ""  # its group; rows of one subject stand together
    kind: str = ""  # how a page marks it, such as "bound"


class Table:
    """A table."""

    def __init__(
        self,
        about: str,
        columns: Iterable[str | Column],
        rows: Iterable[Row],
        label: str = "",
        *,
        apart: bool = False,
    ) -> None:
        """Label it for screen readers; ``apart``: whether subjects have a column of their own."""
        self.about, self.rows, self.label, self.apart = about, [*rows], label, apart
        self.columns = [Column(each) if isinstance(each, str) else each for each in columns]

    def text(self) -> str:
        """The table for a terminal, the subject before each row's label."""
        blank = [""] * self.apart
        rows = [[self.about, *blank, *(each.title for each in self.columns)]]
        for subject, same in self.subjects():
            for number, row in enumerate(same):
                about = [", ".join(filter(None, (subject, _with_note(row.about))))]
                if self.apart:
                    about = ["" if number else subject, row.about]
                rows.append([*about, *map(signed, map(_joined, row.cells, self.columns))])
        return _laid_out(rows, about=1 + self.apart)

    def subjects(self) -> list[tuple[str, list[Row]]]:
        """The rows of every subject together."""
        return [(name, list(rows)) for name, rows in groupby(self.rows, attrgetter("subject"))]


def table_of(
    about: str,
    rows: Iterable[tuple[str, Mapping[str, Any]]],
    columns: Mapping[str, str],
    label: str = "",
) -> Table:
    """A table of labels and numbers by name: by a column's title the name and, after it, a format.

    What is missing, None or NaN is a dash.
    """
    parts = [each.partition(" ") for each in columns.values()]

    def cell(value: Any, spec: str) -> str:
        if value is None or value != value:
            return NOTHING
        return percent(value, int(spec[1:-1])) if spec.endswith("%") else format(value, spec)

    cells = (Row(name, [cell(row.get(k), spec) for k, _, spec in parts]) for name, row in rows)
    return Table(about, columns, cells, label)


def table_with_units(
    about: str,
    titles: Sequence[str],
    rows: Sequence[tuple[Row, Mapping[str, tuple[str, str]]]],
    label: str,
    *,
    page: bool = True,
) -> Table:
    """A table of rows with values and their units by title, which has them if all are one unit.

    On a terminal the values keep their units.
    """
    common = dict[str, str]()
    for title in titles:
        units = {cells[title][1] for _, cells in rows if title in cells} - {""}
        common[title] = units.pop() if page and len(units) == 1 else ""
    drawn = []
    for row, cells in rows:
        own = [(*cells.get(title, (NOTHING, "")), unit) for title, unit in common.items()]
        words = [size if unit in ("", of_all) else f"{size} {unit}" for size, unit, of_all in own]
        drawn.append(replace(row, cells=words))
    columns = (f"{title} [{unit}]" if unit else title for title, unit in common.items())
    return Table(about, columns, drawn, label)


SEPARATORS = {ord(each): chr(0xE000 + ord(each)) for each in "|/;<>:#=\n"}
"""Private letters that stand for separators in the values of a table, which are no separators."""

RESTORED = {ord(private): chr(letter) for letter, private in SEPARATORS.items()}


class _Laid(str):
    """Text of cells, with separators."""

    __slots__ = ()


@cache
def _environment_of_tables() -> jinja2.Environment:
    """That of text, where a missing value is a dash, and no value has a separator."""
    import jinja2

    def shown(value: Any) -> str:
        if value is None or isinstance(value, jinja2.Undefined) or value != value:
            return NOTHING
        return value if isinstance(value, _Laid) else str(value).translate(SEPARATORS)

    own = environment(plain=True).overlay(
        finalize=shown, undefined=jinja2.ChainableUndefined, trim_blocks=False
    )
    own.filters["cells"] = lambda text: _Laid(" ".join(text.split()))
    return own


def table(name: str, /, **values: Any) -> Table:
    """A table, from its block of ``tables.txt``, which says how it is written."""

    def words(text: str) -> str:
        return "\n".join(map(str.strip, text.split(";;"))).translate(RESTORED)

    def split(text: str) -> list[str]:
        return [each.strip() for each in f" {text} ".split(" / ")]

    def column(text: str) -> Column:
        title, parts, joined = [*text.split(" :: "), *("", "{0}")[text.count(" :: ") :]]
        below = tuple(map(words, split(parts))) if parts else ()
        return Column(words(title.removeprefix("< ")), below, title.startswith("< "), joined)

    block = _block("tables.txt", name, _environment_of_tables()).render(values)
    lines = re.sub(r"\s*\n\s*(?=\||#\w)", " ", block).split("\n")
    head, *rows = [[each.strip() for each in line.split("|")] for line in lines if line.strip()]
    label, _, first = head[0].partition("=")
    drawn = []
    for about, *cells in rows:
        *subject, about = about.split(">>")
        cells[-1], _, kind = cells[-1].partition("#")
        parts = [tuple(map(words, split(cell))) for cell in cells]
        own = [each if len(each) > 1 else each[0] for each in parts]
        drawn.append(Row(words(about), own, words("".join(subject)), kind.strip()))
    *apart, about = first.split(">>")
    return Table(words(about), map(column, head[1:]), drawn, words(label), apart=bool(apart))


def _laid_out(rows: Sequence[Sequence[str]], about: int) -> str:
    """Aligned columns; those beyond the terminal follow below, after the first ``about``."""
    most, first = _WIDTH.get() or math.inf, list(range(about))
    stub = sum(max(len(row[j]) + 2 for row in rows) for j in first)

    def lines_of(cell: str, j: int) -> list[str]:
        if j < about or not cell or stub + len(cell) <= most:
            return [cell]
        room = max(int(most) - stub, 1)
        return textwrap.wrap(cell, room, break_long_words=False, break_on_hyphens=False)

    cells = [[lines_of(cell, j) for j, cell in enumerate(row)] for row in rows]
    widths = [
        max(len(line) for cell in column for line in cell) for column in zip(*cells, strict=True)
    ]
    blocks, width = list[list[int]](), math.inf
    for j in range(about, len(widths)):
        width += 2 + widths[j]
        if width > most or not blocks:
            blocks.append(first.copy())
            width = stub + widths[j]
        blocks[-1].append(j)
    return "\n".join(
        "  ".join(
            line.ljust(widths[j]) if j == 0 else line.rjust(widths[j])
            for j, line in zip(columns, parts, strict=True)
        ).rstrip()
        for columns in blocks
        for row in cells
        for parts in zip_longest(*(row[j] for j in columns), fillvalue="")
    )


def number(value: float | None, digits: int = 2) -> str:
    """A number with fixed decimals; a dash for none, and for NaN."""
    return NOTHING if value is None or math.isnan(value) else f"{value:.{digits}f}"


def two_digits(value: float) -> str:
    """Two digits of a number, or all that stand before the point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


def at_most(value: float) -> str:
    """Two digits of a size, rounded up: what stays below the size stays below them."""
    if not value > 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    # rounding of a division by a decimal step
    return two_digits(step * math.ceil(value / step * (1.0 - 1e-12)))


def spread(values: Iterable[float], form: str) -> str:
    """The least and the largest of some numbers in a format, or the one that both are."""
    every = list(values)
    return "–".join(dict.fromkeys(format(end, form) for end in (min(every), max(every))))


def signed(text: str) -> str:
    """A text with its numbers as pages and tables write them, with minus signs."""
    return re.sub(r"(?<![\w.=])-(?=[\d.])", "−", text)


def relative(share: float, digits: int = 0) -> str:
    """A share as a percentage with a sign."""
    text = f"{100.0 * share:+.{digits}f} %"
    return signed(text) if float(text[:-2]) else text[1:]


def percent(share: float | None, digits: int = 2) -> str:
    """A share as a percentage, a dash for none and NaN; of a bound near zero there is none."""
    if share is None or math.isnan(share):
        return NOTHING
    return "lower bound ≈ 0" if math.isinf(share) else f"{100.0 * share:.{digits}f} %"


def _joined(cell: str | tuple[str, ...], column: Column) -> str:
    if isinstance(cell, str):
        return _with_note(cell)
    missing = len(cell) > 1 and cell[1] == NOTHING
    return cell[0].replace("\n", " ") if missing else column.joined.format(*cell).replace("\n", " ")


def _with_note(words: str) -> str:
    value, _, note = words.partition("\n")
    return f"{value} ({note})" if note else value


@cache
def environment(*, plain: bool = False) -> jinja2.Environment:
    """Environment of the templates: filters and, unless ``plain`` text, macros; it draws tables."""
    import jinja2

    def drawn(value: Any) -> Any:
        if not isinstance(value, Table):
            return value
        return Markup(templates.get_template("table.html").render(table=value))

    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("planner.report"),
        autoescape=not plain,
        undefined=jinja2.StrictUndefined,
        finalize=drawn,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "at_most": at_most,
        "breakable": breakable,
        "degrees": math.degrees,
        "digits": lambda value, digits=3: f"{value:.{digits}g}",
        "fixed": lambda value, digits=2: f"{value:.{digits}f}",
        "heading": heading,
        "in_each": lambda sizes, form="digits": " and ".join(
            f"{templates.filters[form](size)} {CARRIED[unit].long}" for unit, size in sizes.items()
        ),
        "unit": lambda name, form="sign": getattr(CARRIED[name], form),
        "relative": relative,
        "line": lambda words: " ".join(words.split()),
        "noted": _noted,
        "number": lambda value, digits=2: number(_known(value), digits),
        "percent": lambda value, digits=2: percent(_known(value), digits),
        "sentence": sentence,
        "spread": spread,
        "two_digits": two_digits,
    }
    templates.globals["table"] = jinja2.pass_context(
        lambda context, name, /, **more: table(name, **context.get_all() | more)
    )
    templates.tests["finite"] = math.isfinite
    templates.tests["breaking"] = lambda cell: " " in cell and not re.search(r"\d", cell)
    if not plain:
        templates.globals |= vars(templates.get_template("macros.html").module)
        templates.globals["say"] = jinja2.pass_context(
            lambda context, template, block: phrase(template, block, **context.get_all())
        )
    return templates


def _known(value: Any) -> float | None:
    """A number; None for what a template has not."""
    return float(value) if isinstance(value, Real) else None


def rendered_text(template: str, **values: Any) -> str:
    """A template of plain text, for a terminal."""
    return environment(plain=True).get_template(template).render(values).rstrip()


def phrase(template: str, block: str, **values: Any) -> str:
    """A block of a template of plain text."""
    of = environment(plain=True).get_template(template)
    return "".join(of.blocks[block](of.new_context(values))).strip()


def words_of(figure: str, **values: Any) -> tuple[str, str]:
    """Title and caption of a figure: the first line of its block in ``captions.txt``, the rest."""
    block = _block("captions.txt", figure, environment(plain=True)).render(values)
    title, _, caption = block.strip().partition("\n")
    return title, " ".join(caption.split())


@cache
def _block(file: str, name: str, of: jinja2.Environment) -> jinja2.Template:
    """A block without others inside it, alone: to compile all of a long file takes 0.1 s."""
    text = files("planner.report").joinpath("templates", file).read_text("utf-8")
    _, _, block = text.partition(f"{{% block {name} %}}\n")
    return of.from_string(block.partition("{% endblock %}")[0])


def heading(name: str) -> str:
    """An identifier as words, to begin a line with."""
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]


def sentence(words: str) -> str:
    """Words, names in them as they are, to begin a line with and to end with a stop."""
    name = not words.split(" ", 1)[0].replace("_", "A").islower()
    return f"{words}." if name else f"{words[:1].upper()}{words[1:]}."


def _noted(text: str) -> Markup:
    """Words with minus signs, and a note after a line break in small letters."""
    value, _, note = signed(text).partition("\n")
    return Markup("{} <small>{}</small>").format(value, note) if note else escape(value)


def breakable(name: str) -> Markup:
    """A name of a file that may break between its parts, not inside a word."""
    return Markup(re.sub("([/_-])", r"\1<wbr>", str(escape(name))))
