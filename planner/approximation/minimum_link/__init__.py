"""The fewest segments within a largest error, a minimum-link path: docs/math.md, section 4."""
