"""The view at the command line: a page, or a server that nobody needs to look at."""

from __future__ import annotations

import pytest

from planner.cli import view
from planner.report import draw_scene
from planner.report.scene_page import Recording


@pytest.fixture
def meshcat():
    return pytest.importorskip("meshcat", reason="needs the extra meshcat")


def test_a_foot_path_becomes_a_page(run, foot, meshcat, tmp_path):  # noqa: ARG001
    result = run("view", foot, "--leg", "front-left", "--html", "walk.html")
    assert result.exit_code == 0, result.stderr
    assert result.stdout == ""
    assert result.stderr == "walk.html: 88 samples, 19 links\n"
    page = (tmp_path / "walk.html").read_text()
    assert "<h1>request-planner: front-left</h1>" in page
    assert page.count("<li><i") == 3


def test_requests_of_a_file_are_shown_as_they_are(run, foot, meshcat, tmp_path):  # noqa: ARG001
    run("plan", foot, "--leg", "front-left", "--method", "foot-optimal", "-o", "requests.csv")
    shared = ("view", foot, "--leg", "front-left", "--html")
    assert run(*shared, "a.html", "--requests", "requests.csv").exit_code == 0
    assert run(*shared, "b.html").exit_code == 0
    assert run(*shared, "c.html", "--method", "closed-form").exit_code == 0
    a, b, c = ((tmp_path / f"{name}.html").read_text() for name in "abc")
    assert len(a) == len(b)  # but for the twelve decimals of the file the same
    assert a != c


def test_the_server_is_fed_and_ends_with_ctrl_c(run, foot, meshcat, monkeypatch):
    window = Recording()
    window.open = lambda: pytest.fail("no browser was asked for")
    viewer = meshcat.Visualizer(window=window)

    def visualizer():
        print("You can open the visualizer")  # as Meshcat does
        return viewer

    monkeypatch.setattr(meshcat, "Visualizer", visualizer)
    monkeypatch.setattr(draw_scene, "import_meshcat", lambda: meshcat)

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(view.time, "sleep", interrupted)
    result = run("view", foot, "--leg", "front-left", "--no-open")
    assert result.exit_code == 130
    assert result.stdout == ""
    assert "You can open the visualizer" in result.stderr
    assert len(window.commands) > 50


WRONG = {
    "no leg": (
        ["desired.csv"],
        "name the leg with --leg, or with --urdf, --base and --foot. "
        "See 'request-planner view --help'.",
    ),
    "two plans": (
        ["foot.csv", "--leg", "front-left", "--requests", "r.csv", "--method", "optimal"],
        "--method plans what --requests brings along: leave one out. "
        "See 'request-planner view --help'.",
    ),
    "some of the joints": (
        ["some.csv", "--leg", "reference"],
        "some.csv: got joints knee, expected those of the leg: rotator, abductor, knee. "
        "See 'request-planner view --help'.",
    ),
    "requests of another path": (
        ["foot.csv", "--leg", "front-left", "--requests", "short.csv"],
        "short.csv: got 2 requests, expected 88, one per sample; show the path that they were "
        "planned for",
    ),
}


@pytest.mark.parametrize(("arguments", "message"), WRONG.values(), ids=WRONG)
@pytest.mark.usefixtures("meshcat", "foot", "desired")
def test_wrong_input_is_one_line_and_status_2(run, tmp_path, arguments, message):
    (tmp_path / "some.csv").write_text("knee_deg\n1\n2\n")
    joints = ",".join(f"front_left_{name}_deg" for name in ("rotator", "abductor", "knee"))
    (tmp_path / "short.csv").write_text(f"{joints}\n1,2,3\n1,2,3\n")
    result = run("view", *arguments)
    assert result.exit_code == 2
    assert result.stderr == f"request-planner: {message}\n"


def test_what_is_not_installed_is_named(run, foot, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "meshcat", None)
    result = run("view", foot, "--leg", "front-left", "--html", "walk.html")
    assert result.exit_code == 2
    assert result.stderr == (
        "request-planner: the view in Meshcat needs the extra 'meshcat': python -m pip install "
        "'request-planner[meshcat]'\n"
    )
