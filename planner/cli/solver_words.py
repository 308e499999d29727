"""What the solvers report, with ``--verbose``: the log of the library, on standard error."""

from __future__ import annotations

import logging
from collections.abc import Callable

from planner.cli.say import detail


class _Telling(logging.Handler):
    """Says every entry of the log in a line."""

    def emit(self, record: logging.LogRecord) -> None:
        detail(record.getMessage())


def listen() -> Callable[[], None]:
    """Begin to say what the library logs; the answer ends it."""
    log = logging.getLogger("planner")
    before, handler = log.level, _Telling()
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)

    def end() -> None:
        log.removeHandler(handler)
        log.setLevel(before)

    return end
