"""The examples run: scripts from beginning to end, the notebook cell by cell with what it shows."""

import contextlib
import io
import json
import runpy
import sys

import pytest

import planner
from tests.docs.blocks import ROOT
from tests.docs.printed import difference

SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_script_runs_and_leaves_the_files_that_it_names(script, tmp_path, monkeypatch):
    if "mujoco" in script.read_text(encoding="utf-8"):
        pytest.importorskip("mujoco", reason="needs the extra 'mujoco'")
    monkeypatch.setattr(sys, "argv", [str(script)])
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        told = runpy.run_path(str(script), run_name="__main__")["__doc__"]
    assert printed.getvalue()
    for written in tmp_path.iterdir():
        assert written.stat().st_size > 0
        assert written.name in told
    assert len(list(tmp_path.iterdir())) == told.count(".svg") + told.count("requests.csv")


@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")  # no window is meant
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.name)
def test_the_cells_of_the_notebook_print_what_it_shows(notebook):
    names = {}
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            shown = "".join("".join(each.get("text", [])) for each in cell["outputs"])
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile("".join(cell["source"]), notebook.name, "exec"), names)
            assert difference(shown, printed.getvalue()) is None, printed.getvalue()
    assert isinstance(names["result"], planner.Identification)
