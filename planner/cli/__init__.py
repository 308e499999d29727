"""The command line: the only place that reads arguments or prints."""

from __future__ import annotations

from planner.cli.program import cli, main

__all__ = ["cli", "main"]
