"""The command line of ``scripts/reference``: record, compare, processors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmark.reference import fits, identifications, plans
from benchmark.reference.compare import checks_of, compared, table_of, worst_cases
from benchmark.reference.processors import compare_processors
from benchmark.reference.record import Section, load, record, recorded

SECTIONS: dict[str, Section] = {
    "fits": fits.fits,
    "optima": fits.optima,
    "questions": fits.questions,
    "plans": plans.plans,
    "closed forms": plans.closed_forms,
    "feet": plans.feet,
    "certificates": plans.certificates,
    "identification": identifications.identifications,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Record, or compare with a record."""
    parser = described()
    options = parser.parse_args(arguments)
    only = [name.strip() for name in options.only.split(",") if name.strip()]
    unknown = sorted(set(only) - set(SECTIONS))
    if unknown:
        parser.error(f"no section {', '.join(unknown)}; there are {', '.join(SECTIONS)}")
    sections = {name: make for name, make in SECTIONS.items() if not only or name in only}
    if options.command == "processors":
        return compare_processors([*sections], options.every)
    if options.command == "record":
        record(options.file, sections, options.every)
        return 0
    try:
        old = load(options.file, only)
        new = load(options.with_file, only) if options.with_file else None
    except ValueError as error:
        parser.error(str(error))
    if new is None:
        new = recorded({name: sections[name] for name in old}, options.every)
    return judged(old, new)


def described() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    parser = argparse.ArgumentParser(
        prog="scripts/reference",
        description="Record reference results and compare later ones with them.",
        epilog=f"sections: {', '.join(SECTIONS)}",
    )
    commands = parser.add_subparsers(dest="command", required=True)
    cases = argparse.ArgumentParser(add_help=False)
    cases.add_argument("--only", default="", metavar="A,B", help="these sections; all by default")
    cases.add_argument(
        "--every", type=int, default=1, metavar="N", help="one case in so many, for a quick look"
    )
    kept = argparse.ArgumentParser(add_help=False)
    kept.add_argument("file", type=Path, metavar="FILE", help="the recorded results, JSON")
    commands.add_parser("record", parents=[kept, cases], help="run every case and write FILE")
    compare = commands.add_parser(
        "compare", parents=[kept, cases], help="run them again; status 1 where too much was lost"
    )
    compare.add_argument(
        "--with", type=Path, dest="with_file", metavar="NEW", help="compare this record instead"
    )
    commands.add_parser(
        "processors",
        parents=[cases],
        help="run them as on other processors; status 1 if any differ",
    )
    return parser


def judged(old: dict, new: dict) -> int:
    """Print the comparison; 1 where a check fails, else 0."""
    sections = compared(old, new)
    print(table_of(sections))
    failed = 0
    for name, section in sections.items():
        print(f"\n{name}")
        for check in checks_of(name, section):
            verdict = "pass" if check.passed else "FAIL"
            failed += not check.passed
            print(f"  {verdict}  {check.name}: {check.value:.4g}, at most {check.limit:.4g}")
        for line in worst_cases(section):
            print(f"        {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
