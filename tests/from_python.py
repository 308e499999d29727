"""Functions that only compiled ones call, for tests to call."""

from planner.compilation import compiled


def from_python(inner):
    """An inner function, compiled so that Python can call it."""
    return compiled(inner.py_func)
