"""The command line: the only place that reads arguments or prints."""

from __future__ import annotations

from planner.cli.main import cli, main

__all__ = ["cli", "main"]
