"""What a run writes into its folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.scene import Scene
from planner.cli.declared import flat
from planner.files.paths import write_foot_path, write_joint_path
from planner.files.staging import MANIFEST, list_files
from planner.files.text import to_json, write_text
from planner.model.response import simulate_joints
from planner.report.comparison_tables import verdict_line
from planner.report.page import versions
from planner.report.scene import Motion, motions, scene_page
from planner.robot.schedule import Schedule
from planner.run.comparison import comparison_of, write_picture
from planner.run.export import rows_document, rows_of, rows_summary, write_rows
from planner.run.pages import plan_report
from planner.run.plan import misses
from planner.run.plan_answer import document

if TYPE_CHECKING:
    from collections.abc import Callable

    from kinematics import Leg
    from planner.planning.plan import Plan
    from planner.run.desired import Desired
    from planner.run.run import RunFile
    from planner.trajectory import Array


def write_run(
    folder: Path, run: RunFile, plan: Plan, *, progress: Callable[[str], None]
) -> tuple[dict[str, Any], str, list[str]]:
    """Write all that a run file asks for.

    Returns:
        ``results.json``, the exports in words, and what the plan or the comparison fails.
    """
    failures = missed = misses(run.settings, run.prepared.desired, plan)
    progress("the files")
    _write_paths(folder, run, plan)
    exports, words = _write_exports(folder, run, plan)
    if run.settings.output.comparison:
        progress("the comparison")
        check = comparison_of(run.prepared)
        pictures = [folder / f"comparison{ending}" for ending in (".png", ".svg")]
        write_text(folder / "comparison.json", to_json(check.to_dict()))
        for picture in pictures:
            write_picture(picture, check)
        failures = [*missed, *([] if check.passed else [verdict_line(check)])]
    if page := _place(folder, run, "report"):
        files: list[tuple[str, Path | str | None]] = [("run", run.file.path)]
        files += _written(folder, run)
        write_text(page, plan_report(run.prepared, plan, missed=missed, page=page, written=files))
    if page := _place(folder, run, "scene"):
        write_text(page, _scene(run, plan))
    results = {
        "made_by": "request-planner run",
        "settings": flat(run.settings),
        **document(run.prepared, plan, missed),
        "exports": exports,
        "versions": versions(),
        "files": list_files(folder),
    }
    write_text(folder / MANIFEST, to_json(results))
    return results, words, failures


def shown_motions(
    leg: Leg, desired: Desired, planned: Array, *, cyclic: bool, loads: Array | None = None
) -> tuple[Motion, ...]:
    """A leg's desired, direct and planned motions, the joints in the order of the leg.

    Args:
        leg: The leg.
        desired: What its joints should do.
        planned: What they do as planned [rad], shape (n, k), in the order of ``desired``.
        cyclic: Whether the path repeats for ever.
        loads: Torques on them for which the requests are planned [N m], like ``planned``.
    """
    order = [desired.names.index(name) for name in leg.joint_names]
    direct = simulate_joints(desired.models, desired.angles, cyclic=cyclic, loads=loads)
    angles = [each[:, order] for each in (desired.angles, direct, planned)]
    feet = [leg.foot_positions(each) for each in angles]
    if desired.foot is not None:
        feet[0] = desired.foot
    first, second, third = zip(angles, feet, strict=True)
    return motions(first, second, third)


def _write_paths(folder: Path, run: RunFile, plan: Plan) -> None:
    """Requests, predicted and desired angles, and positions of the foot, as CSV."""
    desired = run.prepared.desired
    for key, angles in (
        ("requests", plan.requests),
        ("angles", plan.predicted),
        ("desired", desired.angles),
    ):
        if file := _place(folder, run, key):
            write_joint_path(
                file,
                desired.names,
                angles,
                period=desired.period,
                units=desired.units,
                loads=plan.task.load if key == "requests" else None,
            )
    if desired.foot is not None and (file := _place(folder, run, "foot")):
        write_foot_path(file, plan.foot, period=desired.period)


def _write_exports(folder: Path, run: RunFile, plan: Plan) -> tuple[list[dict[str, Any]], str]:
    """The files for robots; their rows, for machines and for people."""
    documents, words = [], ""
    for export in run.settings.export:
        schedule = Schedule(run.prepared.desired.names, plan.requests, plan.period)
        rows, skipped = rows_of(export, schedule)
        file = folder / export.file
        file.parent.mkdir(parents=True, exist_ok=True)
        write_rows(str(file), export, rows)
        documents.append({"file": export.file, **rows_document(export, rows, skipped)})
        words += f"\n{export.file}: {rows_summary(rows, skipped)}"
    return documents, words


def _written(folder: Path, run: RunFile) -> list[tuple[str, Path]]:
    """What stands in the folder, and what will be written last."""
    scene = run.settings.output.scene
    names = [*list_files(folder), MANIFEST, *([scene] if scene else [])]
    return [(Path(name).stem, folder / name) for name in names]


def _scene(run: RunFile, plan: Plan) -> str:
    """The robot moving, as a page."""
    place, desired, cyclic = run.prepared.place, run.prepared.desired, plan.cyclic
    assert place is not None, "a scene without a leg is refused"
    assert desired.leg is not None, "a scene without a leg is refused"
    shown = shown_motions(desired.leg, desired, plan.predicted, cyclic=cyclic, loads=plan.task.load)
    scene = Scene.from_urdf(place.urdf, base=place.base, foot=place.foot, locked=place.locked)
    title = f"request-planner: {run.settings.leg.name or place.foot}"
    return scene_page(scene, shown, period=desired.period, cyclic=cyclic, title=title)


def _place(folder: Path, run: RunFile, key: str) -> Path | None:
    """Where an output goes; None where the run leaves it out."""
    name = getattr(run.settings.output, key)
    if not name:
        return None
    place: Path = folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    return place
