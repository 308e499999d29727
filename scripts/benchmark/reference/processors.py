"""The same results on every processor: run under other settings of OpenBLAS and NumPy, compared."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmark.reference.compare import compared, difference
from benchmark.reference.record import load
from benchmark.table import Table

SETTINGS = {
    **{core: {"OPENBLAS_CORETYPE": core} for core in ("Haswell", "SkylakeX", "Zen", "Nehalem")},
    "NumPy without AVX2": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3"},
}
"""Environments that stand for other processors."""

SAME = 1e-9  # largest relative difference of two results that count as the same
ROOM = {"feet": 1e-3, "identification": 1e-5, "certificates": 1e-3}
"""Where searches stop by their progress in a flat valley, or by their gap, the last bit may decide
when: the largest relative difference of the error, or of the bound, that is as good. A foot's error
may rise by 5e-3 in any case, for smoother requests."""

SHOWN = 10  # cases that are named for each section


def compare_processors(sections: Sequence[str], every: int) -> int:
    """Run the sections under every setting and print how they differ; 1 where some do, else 0."""
    settings = {name: SETTINGS[name] for name in SETTINGS if name != "SkylakeX" or _avx512()}
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / "first.json"
        _record(first, {}, sections, every)
        differ = 0
        for name, setting in settings.items():
            other = Path(folder) / "other.json"
            _record(other, setting, sections, every)
            table, beyond = beside(name, first, other)
            print(f"{table}\n{beyond}", flush=True)
            differ += bool(beyond)
    return 1 if differ else 0


def _record(path: Path, setting: dict[str, str], sections: Sequence[str], every: int) -> None:
    """Record in a process of its own, since the libraries choose when they are loaded."""
    command = [sys.executable, "-P", "-m", "benchmark.reference", "record", str(path)]
    command += ["--only", ",".join(sections), "--every", str(every)]
    subprocess.run(command, check=True, env={**os.environ, **setting})


def beside(name: str, first: Path, other: Path) -> tuple[Table, str]:
    """A row for each section, and the cases whose quality differs."""
    columns = "cases | same bits | within 1e-9 | as good | differ | largest loss or gain, %"
    table = Table(f"{name} beside this processor", f"section | {columns}")
    lines = []
    for section, runs in compared(load(first), load(other)).items():
        apart = {case: difference(runs.old[case], runs.new[case]) for case in runs.new}
        beyond = [case for case, each in apart.items() if each > SAME]
        # As good: other requests, or knots where none is needed, of the same error.
        changes = {
            case: new["bound"] / old["bound"] - 1.0 for case, old, new in runs.pairs("bound")
        }
        changes |= runs.losses
        room = ROOM.get(section, SAME)
        worse = [case for case in beyond if not abs(changes.get(case, math.inf)) <= room]
        same = sum(each == 0.0 for each in apart.values())
        counts = len(apart), same, len(apart) - len(beyond), len(beyond) - len(worse), len(worse)
        table.add(section, *counts, 100.0 * max(map(abs, changes.values()), default=math.nan))
        for case in worse[:SHOWN]:
            loss = changes.get(case, math.nan)
            lines.append(f"  {section}, {case}: by {apart[case]:.2g}, loss {100.0 * loss:.2g} %\n")
    return table, "".join(lines)


def _avx512() -> bool:
    """Whether this processor can run SkylakeX's kernels."""
    described = Path("/proc/cpuinfo")
    return described.is_file() and "avx512f" in described.read_text(encoding="utf-8")
