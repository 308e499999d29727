"""Wall-clock times."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import TypeVar

Answer = TypeVar("Answer")


def timed(call: Callable[[], Answer]) -> tuple[Answer, float]:
    """The result of the call, and its time [s]."""
    began = perf_counter()
    answer = call()
    return answer, perf_counter() - began


def median_time(call: Callable[[], object], repeats: int) -> float:
    """Median time of several calls [s]; the caller has to warm up."""
    return median(timed(call)[1] for _ in range(repeats))
