"""The command line: ``scripts/bench [options] [parts]``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import planner
from benchmark.machine import circumstances, kept_run
from benchmark.parts import Options
from benchmark.table import Table

PARTS = (
    *("inversion", "quality", "length", "foot", "fit", "identify", "models", "servos"),
    *("calibrated", "faults", "friction", "smooth", "stream", "pairs", "scale", "learning"),
)

QUICK = Options(instances=3, repeats=1, lengths=(88, 880), fit_lengths=(88, 880))

TEN_MINUTES = 75_000  # samples in ten minutes at 125 Hz
OPENING = """# Benchmark

Written by `scripts/bench --markdown docs/benchmark.md`. Times are wall-clock, after a
warm-up and on one thread; compare their ratios, since machines differ. Every error is that of the
exact model.

Measured: {}.

"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, keep and compare."""
    parser = described()
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.parts) - set(PARTS))
    if unknown:
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    try:
        earlier = kept_run(options.compare, "tables") if options.compare else None
    except ValueError as error:
        parser.error(str(error))
    where = circumstances()
    print("\n".join(f"{name}: {value}" for name, value in where.items()), end="\n\n")
    parts = [name for name in PARTS if name in options.parts or not options.parts]
    try:
        tables = measured(parts, options)
    except planner.MissingExtra as error:
        parser.error(str(error))
    if earlier is not None:
        print("Against", ", ".join(f"{k} {v}" for k, v in earlier["circumstances"].items()))
        for table in tables:
            if table.title in earlier["tables"]:
                print(f"\n{table.against(earlier['tables'][table.title])}")
    if options.save:
        run = {"circumstances": where, "tables": {each.title: each.as_json() for each in tables}}
        kept = json.dumps(run, indent=1, ensure_ascii=False)
        options.save.write_text(f"{kept}\n", encoding="utf-8")
    if options.markdown:
        page = OPENING.format(", ".join(f"{name} {value}" for name, value in where.items()))
        page += "\n".join(table.markdown() for table in tables)
        options.markdown.write_text(page, encoding="utf-8")
    return 0


def described() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench",
        description="Measure the planner, side by side with what else one could write.",
        epilog=f"parts: {', '.join(PARTS)}; all of them where none is named",
    )
    add = parser.add_argument
    add("parts", nargs="*", metavar="part", help="what to measure")
    add("--save", type=Path, metavar="FILE", help="keep the run as JSON")
    add("--compare", type=Path, metavar="FILE", help="print new over a kept run")
    add("--markdown", type=Path, metavar="FILE", help="write the tables as a page")
    add("--quick", action="store_true", help="few instances, short lengths")
    add("--instances", type=int, metavar="N", help="random instances of each kind")
    add("--samples", type=int, metavar="N", help="samples in a random instance (88)")
    add("--long", action="store_true", help=f"also {TEN_MINUTES} samples")
    effort = {"type": float, "default": 0.0, "metavar": "SECONDS"}
    add("--exact", **effort, help="also gaps over exact bounds, each given so long")
    return parser


def measured(parts: Sequence[str], arguments: argparse.Namespace) -> list[Table]:
    """The tables of the parts, each printed as soon as it is there."""
    options = (QUICK if arguments.quick else Options())._replace(exact=arguments.exact)
    for name in ("instances", "samples"):
        if getattr(arguments, name) is not None:
            options = options._replace(**{name: getattr(arguments, name)})
    if arguments.long:
        options = options._replace(lengths=(*options.lengths, TEN_MINUTES))
    tables = []
    for part in parts:
        for table in import_module(f"benchmark.parts.{part}").measure(options):
            print(table, end="\n\n", flush=True)
            tables.append(table)
    return tables


if __name__ == "__main__":
    sys.exit(main())
