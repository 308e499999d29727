"""Compiled functions are cached until a source of theirs changes; compilation is announced."""

import io
import logging
import sys
from types import SimpleNamespace

import click
import pytest

from planner import compilation
from planner.cli.console import _settle
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
    others = [first.with_name(f"{name}-{16 * '0'}") for name in ("two", "one-more", "ones")]
    others += [first.with_name("one.cpython-311.pyc")]
    for other in others:
        other.mkdir()
    assert folder_of("one") == first
    modules["three"].write_text("LIMIT = 2.0\n")
    second = folder_of("one")
    assert second != first
    assert second.is_dir()
    assert not first.exists()
    assert all(other.exists() for other in others)


@pytest.fixture
def announced(tmp_path, monkeypatch, caplog):
    """What is announced of two compiled functions by a process of its own, after others."""
    monkeypatch.setattr(compilation, "PACKAGE", tmp_path)
    monkeypatch.setattr(compilation.LOG, "disabled", False)  # whatever this process did before
    for name in ("planner", "planner.compilation"):
        caplog.set_level(logging.WARNING, logger=name)
    monkeypatch.setattr(compilation, "_cache_folder", lambda _: tmp_path / "__pycache__" / "kept")

    def announced(*functions):
        stream = io.StringIO()
        monkeypatch.setattr("sys.stderr", stream)
        listener = compilation._Compilation()
        for function in functions or (kernel.periods, kernel.along):
            compiling = SimpleNamespace(data={"dispatcher": function})
            listener.on_start(compiling)
            listener.on_end(compiling)
        return stream.getvalue()

    return announced


def test_compilation_without_a_cache_is_announced_with_what_to_do(announced, monkeypatch):
    monkeypatch.setattr(compilation, "_cache_folder", lambda _: None)
    assert announced() == compilation.NO_CACHE + "\n"


def test_of_processes_that_compile_at_the_same_time_one_announces_it(announced):
    assert [announced() for _ in range(3)] == [compilation.COMPILING + "\n", "", ""]


def test_quiet_commands_announce_no_compilation(announced):
    with click.Context(click.Command("plan")) as context:
        _settle(context, click.Option(["--quiet"]), True)
        assert announced() == ""
    assert announced() == compilation.COMPILING + "\n"
