"""The command line: ``scripts/bench [options] [parts]``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import planner
from benchmark import record
from benchmark.machine import circumstances
from benchmark.parts import (
    Options,
    Part,
    calibrated,
    faults,
    fit,
    foot,
    friction,
    identify,
    inversion,
    learning,
    length,
    models,
    pairs,
    quality,
    scale,
    servos,
    smooth,
    stream,
)
from benchmark.table import Table

PARTS: dict[str, Part] = {
    "inversion": inversion.measure,
    "quality": quality.measure,
    "length": length.measure,
    "foot": foot.measure,
    "fit": fit.measure,
    "identify": identify.measure,
    "models": models.measure,
    "servos": servos.measure,
    "calibrated": calibrated.measure,
    "faults": faults.measure,
    "friction": friction.measure,
    "smooth": smooth.measure,
    "stream": stream.measure,
    "pairs": pairs.measure,
    "scale": scale.measure,
    "learning": learning.measure,
}

QUICK = Options(instances=3, repeats=1, lengths=(88, 880), fit_lengths=(88, 880))

TEN_MINUTES = 75_000
"""Samples in ten minutes at 125 Hz."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, keep and compare."""
    parser = described()
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.parts) - set(PARTS))
    if unknown:
        parser.error(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    try:
        earlier = record.load(options.compare) if options.compare else None
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
        for table in record.compared(tables, earlier):
            print(f"\n{table}")
    if options.save:
        record.save(options.save, record.as_json(where, tables))
    if options.markdown:
        options.markdown.write_text(record.markdown(where, tables), encoding="utf-8")
    return 0


def described() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench",
        description="Measure the planner, side by side with what else one could write.",
        epilog=f"parts: {', '.join(PARTS)}; all of them where none is named",
    )
    parser.add_argument("parts", nargs="*", metavar="part", help="what to measure")
    parser.add_argument("--save", type=Path, metavar="FILE", help="keep the run as JSON")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="print new over a kept run")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the tables as a page")
    parser.add_argument("--quick", action="store_true", help="few instances, short lengths")
    parser.add_argument("--instances", type=int, metavar="N", help="random instances of each kind")
    parser.add_argument(
        "--samples", type=int, metavar="N", help="samples in a random instance (88)"
    )
    parser.add_argument("--long", action="store_true", help=f"also {TEN_MINUTES} samples")
    parser.add_argument(
        "--exact",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="also gaps over exact bounds, each given so long",
    )
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
        for table in PARTS[part](options):
            print(table, end="\n\n", flush=True)
            tables.append(table)
    return tables


if __name__ == "__main__":
    sys.exit(main())
