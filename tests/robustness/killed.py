"""Run a command, then again and again, killed before the k-th change of any file.

A script, not a test: ``python killed.py FIRST SECOND``, two commands as JSON lists. Every run is a
fork of a process that has made both before. What the folder holds after each kill, and after the
next whole run, is printed as JSON.
"""

from __future__ import annotations

import json
import os
import sys
from hashlib import sha256
from pathlib import Path

from tests.robustness.watched import Watch

MOST = 40
"""Kills before the last changes; of more changes than that, evenly spaced ones are tried."""

LAST = 10
"""Changes at the end, where files are put in place: each of them is tried."""


def run(command: list[str], watch: Watch | None = None) -> None:
    """One command, its exit left out."""
    from planner.cli import cli

    if watch is not None:
        sys.addaudithook(watch)
        watch.on = True
    try:
        cli.main(command, "request-planner")
    except SystemExit as end:
        if end.code:
            raise
    finally:
        if watch is not None:
            watch.on = False


def forked(command: list[str], die_at: int | None) -> tuple[int, int]:
    """Exit status of a run in a fork, and how many changes it made."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        watch = Watch(die_at)
        try:
            run(command, watch)
            os.write(writing, str(len(watch.changes)).encode())
        except BaseException:
            os._exit(1)
        os._exit(0)
    os.close(writing)
    _, status = os.waitpid(child, 0)
    counted = os.read(reading, 20)
    os.close(reading)
    return os.waitstatus_to_exitcode(status), int(counted or b"0")


def held() -> dict[str, str]:
    """What every file of the folder holds, by name."""
    return {
        str(file): sha256(file.read_bytes()).hexdigest()
        for file in sorted(Path().rglob("*"))
        if file.is_file()
    }


def main() -> None:
    first, second = (json.loads(argument) for argument in sys.argv[1:3])
    inputs = held()
    sys.stdout = sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115  (for good)
    run(second)  # once for all imports
    run(first)
    old = held()
    _, changes = forked(second, None)
    new = held()
    told = []
    every = max((changes - LAST) // MOST, 1)
    for k in [*range(0, changes - LAST, every), *range(max(changes - LAST, 0), changes)]:
        status, _ = forked(second, k)
        after, again = held(), 0
        if not after.items() >= old.items():
            again, _ = forked(first, None)
        told.append({"status": status, "after": after, "again": again, "restored": held()})
    last, _ = forked(second, None)
    answer = {"inputs": inputs, "old": old, "new": new, "told": told, "last": [last, held()]}
    print(json.dumps(answer), file=sys.__stdout__)


if __name__ == "__main__":
    main()
