"""What a run writes into its folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinematics import Leg
    from planner.cli.planning import Plan
    from planner.cli.run_file import Run
    from planner.evaluation.cross_check import CrossCheck
    from planner.trajectory import Array


def write_paths(folder: Path, run: Run, made: Plan) -> None:
    """Requests, angles and what was wanted, as CSV."""
    from planner.files.foot_path import write_foot_path
    from planner.files.joint_path import write_joint_path

    wanted = run.wanted
    for key, angles in (
        ("requests", made.requests),
        ("angles", made.predicted),
        ("desired", wanted.angles),
    ):
        if file := _place(folder, run, key):
            write_joint_path(file, wanted.names, angles, period=wanted.period)
    if wanted.foot is not None and (file := _place(folder, run, "foot")):
        write_foot_path(file, made.foot_positions(wanted), period=wanted.period)


def write_exports(folder: Path, run: Run, requests: Array) -> tuple[list[dict[str, Any]], str]:
    """The files for robots; what they hold, for machines and for people."""
    from planner.cli.export_rows import rows_document, rows_summary, rows_to_write, write_schedule
    from planner.robot.schedule import Schedule

    documents, text = [], ""
    for choices in run.exports:
        schedule = Schedule(run.wanted.names, requests, run.wanted.period)
        rows, skipped = rows_to_write(schedule, choices)
        file = folder / choices["file"]
        file.parent.mkdir(parents=True, exist_ok=True)
        write_schedule(str(file), rows, choices)
        documents.append({"file": choices["file"], **rows_document(rows, skipped, choices)})
        text += f"\n{choices['file']}: {rows_summary(rows, skipped)}"
    return documents, text


def write_comparison(folder: Path, run: Run) -> CrossCheck:
    """Both inversions held against each other, as JSON and as pictures."""
    from planner.cli.compare import cross_checked, write_picture
    from planner.cli.run_file import COMPARISON
    from planner.cli.say import to_json
    from planner.files.text import write_text

    choices: Mapping[str, Any] = {**run.choices, "norm": run.choices["norm"] or "rms"}
    check = cross_checked(run.wanted.leg, run.wanted, run.limits, choices)
    document, *pictures = COMPARISON
    write_text(folder / document, to_json(check.to_dict()))
    for picture in pictures:
        write_picture(folder / picture, check)
    return check


def write_report(folder: Path, run: Run, made: Plan, missed: list[str]) -> None:
    """A page about the plan."""
    from planner.cli.plan_report import plan_report
    from planner.files.text import write_text

    if file := _place(folder, run, "report"):
        path = run.settings["path.file"] or "a half ellipse"
        choices = {**run.choices, "model": run.settings["model.file"]}
        page = plan_report(
            path,
            choices,
            run.wanted,
            made,
            limits=run.limits,
            missed=missed,
            page=file,
            written=_files_of(folder, run),
        )
        write_text(file, page)


def _files_of(folder: Path, run: Run) -> list[tuple[str, Path]]:
    """What the page of a run links to: what it reads, and what it writes beside the page."""
    from planner.files.output_folder import MANIFEST, list_files

    settings, beside = run.settings, Path(run.settings.file.path).parent
    named = [("run", settings.file.path), ("path", settings["path.file"])]
    named.append(("model", settings["model.file"]))
    given = [(role, Path(name) if role == "run" else beside / name) for role, name in named if name]
    names = [*list_files(folder), MANIFEST]
    if settings["output.scene"]:  # written last
        names.append(settings["output.scene"])
    return [
        *((role, file) for role, file in given if file.is_file()),
        *((Path(name).stem, folder / name) for name in names),
    ]


def write_scene(folder: Path, run: Run, made: Plan) -> None:
    """The robot moving, as a page."""
    from kinematics.scene import Scene
    from planner.cli.view import shown_motions
    from planner.files.text import write_text
    from planner.report.scene_page import scene_page

    file = _place(folder, run, "scene")
    if file is None:
        return
    place, cyclic = run.place, run.choices["cyclic"]
    assert place is not None, "a scene without a leg is refused"
    leg: Leg | None = run.wanted.leg
    assert leg is not None, "a scene without a leg is refused"
    shown = shown_motions(leg, run.wanted, made.predicted, cyclic=cyclic)
    scene = Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked)
    title = f"request-planner: {run.choices['leg'] or place.foot}"
    page = scene_page(scene, shown, period=run.wanted.period, cyclic=cyclic, title=title)
    write_text(file, page)


def _place(folder: Path, run: Run, key: str) -> Path | None:
    """Where an output goes; None where the run leaves it out."""
    name = run.settings[f"output.{key}"]
    if not name:
        return None
    place: Path = folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    return place
