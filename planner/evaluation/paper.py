"""Numbers that the paper reports in Section 5 and Table 2, for comparison with ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from planner.trajectory import Distance

JOINTS = ("rotator", "abductor", "knee")

SOURCE = (
    "Daniel Stronger and Peter Stone: A Model-Based Approach to Robot Joint Control, "
    "Table 2 and Section 5"
)

STEP_AMPLITUDES = (40.0, 110.0)
"""Amplitudes of the step tests of Figures 3 and 4 [degrees]."""

SEGMENTS = 6
"""Lines of an approximation; the paper draws its own by hand, with about as many (Figure 6)."""


Table2 = Mapping[str, Mapping[str, Distance]]
FootTable = Mapping[str, Distance]


class Measured(NamedTuple):
    """A figure measured on the robot: mean and standard deviation over 20 steps of the walk."""

    mean: float
    deviation: float


class Published(NamedTuple):
    """A distance as published: the paper's L2, a root mean square, and its Linf."""

    L2: Measured
    Linf: Measured


TABLE_2: Mapping[str, Mapping[str, Published]] = {
    "rotator": {
        "Des,Dir": Published(Measured(31.0, 0.2), Measured(57.2, 0.3)),
        "Des,MB": Published(Measured(9.1, 0.2), Measured(29.4, 0.8)),
        "Pwl,MB": Published(Measured(2.7, 0.4), Measured(6.4, 0.6)),
    },
    "abductor": {
        "Des,Dir": Published(Measured(29.0, 0.2), Measured(59.5, 0.5)),
        "Des,MB": Published(Measured(10.4, 0.1), Measured(24.5, 0.7)),
        "Pwl,MB": Published(Measured(2.7, 0.3), Measured(6.0, 0.4)),
    },
    "knee": {
        "Des,Dir": Published(Measured(20.1, 0.1), Measured(42.6, 0.3)),
        "Des,MB": Published(Measured(5.6, 0.2), Measured(11.1, 0.5)),
        "Pwl,MB": Published(Measured(2.6, 0.2), Measured(6.2, 0.7)),
    },
}
"""Distances between angle trajectories [degrees], by joint and comparison.

Des is the desired trajectory, Dir the angles when it is requested, Pwl its piecewise
linear approximation, and MB (model-based) the angles under the requests from that.
"""

FOOT: Mapping[str, Published] = {
    "direct": Published(Measured(3.23, 0.01), Measured(4.61, 0.05)),
    "shift": Published(Measured(1.55, 0.04), Measured(3.57, 0.08)),
    "closed_form": Published(Measured(1.21, 0.04), Measured(2.34, 0.12)),
}
"""Distances of the foot from its desired path [cm], by method."""


SAME_METHOD: Mapping[str, str] = {
    "Des,Plain": "Des,MB",
    "Pwl,Plain": "Pwl,MB",
    "closed_form_plain": "closed_form",
}
"""The paper has one closed form; its figures stand beside ours as it is and with knots refined."""


def published(joint: str, comparison: str) -> Published | None:
    """The paper's figures beside a distance of angles [degrees]; None where it has none."""
    return TABLE_2.get(joint, {}).get(SAME_METHOD.get(comparison, comparison))


def published_foot(method: str) -> Published | None:
    """The paper's figures beside a distance of the foot [cm]; None where it has none."""
    return FOOT.get(SAME_METHOD.get(method, method))


def deviations(table2: Table2, foot: FootTable) -> tuple[float, ...]:
    """How far the baseline figures are from the published ones, each relative to the latter.

    The baselines are the figures that no choice of an approximation enters: the six of (Des, Dir),
    and L2 and Linf of the foot under the direct method and under the best time shift.

    Args:
        table2: Our distances by joint and comparison [degrees].
        foot: Our foot distances by method [cm].

    Returns:
        Ten relative deviations, without a sign.
    """
    pairs = [(table2[joint]["Des,Dir"], TABLE_2[joint]["Des,Dir"]) for joint in JOINTS]
    pairs += [(foot[method], FOOT[method]) for method in ("direct", "shift")]
    return tuple(
        abs(our / published.mean - 1.0)
        for ours, theirs in pairs
        for our, published in zip(ours, theirs, strict=True)
    )
