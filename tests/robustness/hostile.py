"""Values that nobody means: of every type, size and shape, beside a few that are fine."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

NUMBERS = [
    *(0, 1, -1, 2, 3, 10**400, -(10**400), 2**63, 0.0, -0.0, 0.5, 1e-320, 1e-9, 1e6, 1e18),
    *(1e308, -1e308, float("nan"), float("inf"), -float("inf"), True, False),
    *(np.float32(0.3), np.float64("nan"), np.int8(-3), np.bool_(True), 1j, 1.0 + 0.0j),
]
"""Numbers, and what looks like them."""

OTHERS = [
    *(None, "", "x", "nan", "1.0", "\0", "٣", "rms\n", b"1", b"", object(), int, len, ...),
    *((), [], {}, set(), {1: 2}, {"times": None}, [None], [[]], [[1.0], [2.0, 3.0]], range(3)),
    *((None, None), ("a", "b"), (1.0, 0.0), (0.0, 1.0), (1, 2, 3), iter([1.0]), slice(3)),
    *((1.0, -1.0, 1.0), (-2.0, (2.0, float("nan"), 2.0)), (-2.0, (2.0, 2.0, -3.0))),
]
"""What is no number."""

ARRAYS = [
    *(np.zeros(0), np.zeros((0, 3)), np.zeros((3, 0)), np.zeros(()), np.zeros(1), np.zeros(2)),
    *(np.ones(20), np.ones((20, 3)), np.ones((2, 2, 2)), np.full(20, np.nan), np.full(20, 1e300)),
    *(np.full((20, 3), np.inf), np.full((20, 3), 1e300), np.full((20, 3), 1e-300)),
    *(np.arange(20), np.arange(20) % 2 == 0, np.full(20, "a"), np.full(20, None)),
    *(np.array([1.0, None, "x"], dtype=object), np.full(20, 1j), np.full(20, 10**400)),
    *(np.zeros(20, dtype="datetime64[s]"), np.zeros(20, dtype=[("a", "f8")]), np.zeros(20, "S3")),
    *(np.ma.masked_array(np.ones(20), mask=np.arange(20) > 9)),
    *([0.1 * k for k in range(20)], [str(k) for k in range(20)], [10**400] * 20, [True] * 20),
    *(np.broadcast_to(0.1, 20), np.arange(60.0)[::-3], np.arange(20.0).astype(">f4")),
    *([[0.1] * 20] * 3, [float("nan")] * 20, "0.1" * 20, np.full(20, np.float16(0.3))),
]
"""Arrays, lists, and what NumPy makes arrays of."""

ANYTHING = st.one_of(
    st.sampled_from(NUMBERS),
    st.sampled_from(OTHERS),
    st.sampled_from(ARRAYS),
    st.floats(width=32),
    st.integers(-5, 200),
    st.text(max_size=3),
    st.lists(st.floats(allow_nan=True), max_size=5),
)
"""Any of them."""
