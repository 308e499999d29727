"""Options that several commands share."""

from __future__ import annotations

import click

output = click.option(
    "-o",
    "--output",
    default="-",
    metavar="FILE",
    help="Where to write the CSV; '-' is standard output.  [default: -]",
)
as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON for machines.")
model = click.option(
    "--model",
    default="ers210a",
    metavar="FILE",
    help="Joint models as TOML; 'ers210a', the paper's Table 1; or 'urdf', the same servos with "
    "the top speeds of the leg's URDF.  [default: ers210a]",
)
cyclic = click.option(
    "--cyclic/--no-cyclic",
    default=True,
    show_default=True,
    help="Whether the path repeats for ever, or starts from rest.",
)
joints = click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="NAME",
    help="A joint to use, several times for several; by default every column of the file.",
)
segments = click.option(
    "--segments",
    type=int,
    metavar="N",
    help="Lines of the approximation; by default as many as pay off.",
)
