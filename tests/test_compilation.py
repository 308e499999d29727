"""Compiled functions are cached until a source of theirs changes, and compiling is announced."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace

import pytest

from planner import compilation
from planner.model import kernel


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """Files of a module and of one that it imports, by a module between them."""
    texts = {"one": "from planner.two import f\n", "two": "from planner.three import g\n"}
    files = {}
    for name in ("one", "two", "three"):
        files[name] = tmp_path / f"{name}.py"
        files[name].write_text(texts.get(name, "LIMIT = 1.0\n"))
        module = SimpleNamespace(__file__=str(files[name]))
        monkeypatch.setitem(sys.modules, f"planner.{name}", module)
    monkeypatch.setattr(compilation.CONFIG, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    return files


def folder_of(name):
    compilation._cache_folder.cache_clear()
    return compilation._cache_folder(f"planner.{name}")


def test_a_change_of_a_source_that_is_imported_leaves_no_compiled_code_of_before(modules):
    first = folder_of("one")
    assert first.parent == modules["one"].parent / "__pycache__"
    assert folder_of("one") == first
    modules["three"].write_text("LIMIT = 2.0\n")
    second = folder_of("one")
    assert second != first
    assert second.is_dir()
    assert not first.exists()


def test_compiled_code_goes_where_numba_is_told_or_to_the_user_or_nowhere(
    modules, tmp_path, monkeypatch
):
    (modules["one"].parent / "__pycache__").write_text("no folder")
    assert folder_of("one").parent == tmp_path / "user" / "request-planner"
    monkeypatch.setattr(compilation.CONFIG, "CACHE_DIR", str(tmp_path / "told"))
    assert folder_of("one").parent == tmp_path / "told"
    (tmp_path / "nowhere").write_text("no folder")
    monkeypatch.setattr(compilation.CONFIG, "CACHE_DIR", str(tmp_path / "nowhere"))
    assert folder_of("one") is None


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("cached", [True, False])
def test_compilation_is_announced_once_and_to_a_terminal_only(terminal, cached, monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr("sys.stderr", stream)
    if not cached:
        monkeypatch.setattr(compilation, "_cache_folder", lambda _: None)
    listener = compilation._Announcement()
    for function in (kernel.run, kernel.along):
        listener.on_start(SimpleNamespace(data={"dispatcher": function}))
    told = compilation.COMPILING if cached else compilation.NO_CACHE
    assert stream.getvalue() == (told + "\n" if terminal else "")
