"""Wall-clock times, memory, processes of their own for both, and what was measured on."""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Callable
from datetime import date
from importlib import metadata
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, TypeVar

Answer = TypeVar("Answer")


def timed(call: Callable[[], Answer]) -> tuple[Answer, float]:
    """The result of the call, and its time [s]."""
    began = perf_counter()
    answer = call()
    return answer, perf_counter() - began


def median_time(call: Callable[[], object], repeats: int) -> float:
    """Median time of several calls [s]; the caller has to warm up."""
    return median(timed(call)[1] for _ in range(repeats))


def peak_memory() -> float:
    """Most memory that this process has held [MB]."""
    status = Path("/proc/self/status")
    if status.is_file():  # Linux counts what the parent held before exec into ru_maxrss
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        if "VmHWM" in fields:
            return int(fields["VmHWM"].split()[0]) / 1024.0
    unit = 1024.0**2 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def in_child(module: str, *arguments: object) -> Any:
    """The JSON that a module prints in a process of its own, so that its memory is its own too."""
    command = [sys.executable, "-P", "-m", module, *map(str, arguments)]
    child = subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)
    if child.returncode:
        raise RuntimeError(f"{module}, {arguments}: {child.stderr.strip()}")
    return json.loads(child.stdout)


def environment() -> dict[str, str]:
    """Of other processes, which import the benchmark."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


PACKAGES = (
    *("request-planner", "numpy", "scipy", "casadi", "cvxpy", "osqp", "pin"),
    *("pwlf", "ruptures"),  # which need not be installed
)


def circumstances() -> dict[str, str]:
    """Date, machine and versions."""
    installed = {each.name for each in metadata.distributions()}
    return {
        "date": date.today().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "BLAS threads": os.environ.get("OPENBLAS_NUM_THREADS", "as it comes"),
        "Python": platform.python_version(),
        **{name: metadata.version(name) for name in PACKAGES if name in installed},
    }


def kept_run(path: Path, content: str) -> dict[str, Any]:
    """A run that was kept as JSON, with such content; ValueError where the file is none."""
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not a run that was kept: {error}") from error
    if not isinstance(run, dict) or not isinstance(run.get(content), dict):
        raise ValueError(f"{path}: not a run that was kept: it holds no {content}")
    return run


def _processor() -> str:
    described = Path("/proc/cpuinfo")
    if described.is_file():
        for line in described.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
