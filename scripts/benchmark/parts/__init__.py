"""Parts of the benchmark, each a function from its options to tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from benchmark.table import Table


class Options(NamedTuple):
    """How much is measured.

    Attributes:
        instances: Random instances of each kind.
        repeats: Calls of which the median time is taken.
        samples: Length of the random instances.
        lengths: Lengths of the long trajectories.
        fit_lengths: Lengths of the approximated trajectories.
        exact: Seconds for each exact bound; 0 for none.
    """

    instances: int = 20
    repeats: int = 5
    samples: int = 88
    lengths: tuple[int, ...] = (88, 880, 8800)
    fit_lengths: tuple[int, ...] = (88, 10_000, 100_000)
    exact: float = 0.0


Part = Callable[[Options], list[Table]]
