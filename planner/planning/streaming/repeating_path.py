"""A path that about repeats, such as that of a walking robot, and how it will probably go on."""

from __future__ import annotations

import math

import numpy as np

from planner.trajectory import Array, Mask

LEAST_SPREAD = 1e-12
"""Sum of squares about the mean below which a stretch does not move [rad^2]."""

MEMORY = 1.0
"""Time constant with which tests of continuations are forgotten [cycles]. Errors over walks whose
speed changes are 6.0 % above those of whole plans, with half of it 7.9 %, with twice of it 5.9 %;
over random walks 2.7, 3.2 and 3.1 % above those of streams without a cycle."""


class RepeatingPath:
    """What was known of the path over the last cycle, and how it goes on if it repeats.

    The known stretch of all joints is compared with those that ended about a cycle ago, all moved
    to end at the same angles. What followed the nearest one, moved likewise, continues the path;
    its weight is the coefficient of determination, the share of the known motion that the stretch a
    cycle ago explains. Nothing is continued before a whole cycle is known.

    The nearest of many stretches explains a share of any path, also of one that never repeats. The
    weight is therefore multiplied by a second share: the one by which earlier continuations were
    nearer to the rows that are known now than the last row known then was. It is one of the sums of
    squares over about the last cycle, each square weighted by its coefficient of determination.

    Attributes:
        ahead: Rows by which the known ones are continued.
    """

    def __init__(self, joints: int, known: int, cycle: int, *, varies: float, ahead: int) -> None:
        """Allocate the memory.

        Args:
            joints: Number of joints, which repeat together.
            known: Rows of the path that are known at every tick.
            cycle: Rows after which it about repeats.
            varies: Share of them by which the last cycle may have been shorter or longer [-].
            ahead: Rows by which to continue it, at most.
        """
        shortest, longest = round((1.0 - varies) * cycle), round((1.0 + varies) * cycle)
        self.ahead = min(ahead, shortest)
        self._known = known
        self._rows = np.full((joints, longest + known), np.nan)  # the known ones at the end
        self._lags = np.arange(longest, shortest - 1, -1)
        self._nearest = np.argsort(np.abs(self._lags - cycle), kind="stable")  # the cycle first
        windows = np.lib.stride_tricks.sliding_window_view(self._rows, known, axis=1)
        self._before = windows[:, : len(self._lags)]  # the stretches that ended these rows ago
        self._tested = min(known, self.ahead)  # rows after the known ones: the one that is tested
        # What rows from the first known one on were expected to be, and the row held until then
        self._expected = np.full((2, joints, known + self._tested), np.nan)
        self._counts = np.zeros(known + self._tested)
        self._kept = math.exp(-1.0 / (MEMORY * cycle))
        self._errors = np.zeros(2)  # sums of squares [rad^2]

    @property
    def memory(self) -> tuple[Array, ...]:
        """What changes from tick to tick, to be written to another path of the same sizes."""
        return self._rows, self._expected, self._counts, self._errors

    def reset(self) -> None:
        """Forget everything."""
        self._rows[:] = np.nan
        self._expected[:] = np.nan
        self._errors[:] = 0.0

    def move_on(self, periods: int) -> None:
        """Let time pass: what was known of the path and is now past is kept."""
        periods = min(periods, self._rows.shape[1])
        self._errors *= self._kept**periods
        for rows in (self._rows, self._expected, self._counts):
            left = max(rows.shape[-1] - periods, 0)
            rows[..., :left] = rows[..., rows.shape[-1] - left :].copy()
            rows[..., left:] = np.nan

    def continued(self, known: Array, bad: Mask) -> tuple[Array, Array]:
        """Take what is known now, and continue it.

        Args:
            known: The known rows [rad], shape (k, known).
            bad: Joints of which nothing is known now, shape (k,): their rows do not change.

        Returns:
            The rows that follow [rad], shape (k, ahead), and their weights from 0, where nothing is
            known of them, to 1, shape (k, 1).
        """
        rows, last = self._rows, known[:, -1:]
        rows[~bad, rows.shape[1] - self._known :] = known[~bad]
        self._test(known, bad)
        apart = self._before - self._before[:, :, -1:]
        apart -= (known - last)[:, np.newaxis]
        apart[bad] = 0.0
        distances = np.einsum("jlk,jlk->l", apart, apart)[self._nearest]
        if np.isnan(distances[0]):
            return np.repeat(last, self.ahead, axis=1), np.zeros_like(last)
        distances[np.isnan(distances)] = np.inf
        nearest = int(distances.argmin())
        centred = known - known.mean(axis=1, keepdims=True)
        spread = max(float(np.vdot(centred, centred)), LEAST_SPREAD)
        explained = max(0.0, 1.0 - float(distances[nearest]) / spread)
        begin = rows.shape[1] - int(self._lags[self._nearest[nearest]])
        follow = rows[:, begin : begin + self.ahead] + (last - rows[:, begin - 1 : begin])
        unknown = bad | np.isnan(follow).any(axis=1)
        follow[unknown] = last[unknown]
        self._expected[:, ~unknown, -1] = follow[~unknown, self._tested - 1], last[~unknown, 0]
        self._counts[-1] = explained
        reliable = max(0.0, 1.0 - self._errors[0] / max(self._errors[1], LEAST_SPREAD))
        return follow, np.where(unknown, 0.0, explained * reliable)[:, np.newaxis]

    def _test(self, known: Array, bad: Mask) -> None:
        """Compare what the rows known now were expected to be with what they are, once."""
        expected, counts = self._expected[:, :, : self._known], self._counts[: self._known]
        squares = counts * (known - expected) ** 2
        squares[:, bad] = np.nan
        self._errors += np.nansum(squares, axis=(1, 2))
        expected[:] = np.nan
