"""Circumstances of a measurement: versions and machine."""

from __future__ import annotations

import os
import platform
from datetime import date
from importlib import metadata
from pathlib import Path

PACKAGES = ("request-planner", "numpy", "scipy", "casadi", "cvxpy", "osqp", "pin")
OPTIONAL = ("pyscipopt", "pwlf", "ruptures")


def circumstances() -> dict[str, str]:
    """Date, machine and versions."""
    versions = {name: _version(name) for name in (*PACKAGES, *OPTIONAL)}
    return {
        "date": date.today().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "BLAS threads": os.environ.get("OPENBLAS_NUM_THREADS", "as it comes"),
        "Python": platform.python_version(),
        **{name: version for name, version in versions.items() if version},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    described = Path("/proc/cpuinfo")
    if described.is_file():
        for line in described.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
