"""Examples of property tests do not depend on which files are tested in the same process."""

from __future__ import annotations

import importlib.util
import sys

from hypothesis import given, settings
from hypothesis import strategies as st


def drawn():
    """Examples of a property test."""
    examples = []

    @settings(max_examples=500)
    @given(st.floats(0.0, 9.0))
    def property_test(value):
        examples.append(value)

    property_test()
    return examples


def test_examples_are_the_same_after_another_file_is_imported(tmp_path, monkeypatch):
    before = drawn()
    file = tmp_path / "another_file.py"
    file.write_text("NUMBERS = " + repr([k / 64 for k in range(500)]))
    spec = importlib.util.spec_from_file_location("another_file", file)
    monkeypatch.setitem(sys.modules, "another_file", importlib.util.module_from_spec(spec))
    spec.loader.exec_module(sys.modules["another_file"])
    assert drawn() == before
