"""How much is read of a file at most, so that no file takes more than a gigabyte of memory."""

from __future__ import annotations

MOST_BYTES = 64 * 2**20
"""Longest text [bytes]: a million requests for three joints come to half of it."""

MOST_COLUMNS = 10_000
"""Columns of a table: a robot that records everything has some thousands."""

MOST_CELLS = 10_000_000
"""Cells of a table: some 70 bytes of memory each."""

MOST_JOINTS = 1000
"""Joints of a path, each a plan of its own."""

MOST_NUMBERS = 2**25
"""Unfolded numbers of one Parquet file: 22 hours at 30 Hz of 6 joints, 256 MiB."""

MOST_PARTS = 100
"""Parts of a dotted key of TOML: reading one takes memory by the square of their number."""
