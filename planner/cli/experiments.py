"""The experiments behind ``reproduce``: each fills a folder and says what came of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

    from planner.evaluation.outcome import Reproduction
    from planner.evaluation.virtual_outcome import VirtualOutcome
    from planner.report.figures import Picture


class Told(NamedTuple):
    """What an experiment says.

    Attributes:
        document: For machines: the content of ``results.json`` but for its list of files.
        text: For people.
        failures: Checks of its own that it failed, in words.
    """

    document: dict[str, Any]
    text: str
    failures: tuple[str, ...] = ()


def on_model(folder: Path, progress: Callable[[str], None]) -> Told:
    """The paper's experiment on the paper's own model."""
    from planner.evaluation.reproduction import reproduce
    from planner.report.figures import pictures
    from planner.report.page import page
    from planner.report.paper_tables import paper_text
    from planner.report.results import results

    reproduction = reproduce(progress=progress)
    progress("the report")
    _write_paths(folder, reproduction)
    document = results(reproduction)
    _write_report(folder, document, pictures(reproduction), page)
    return Told(document, paper_text(document))


def on_virtual_robot(folder: Path, progress: Callable[[str], None]) -> Told:
    """The paper's experiment on the virtual robot, whose joints are not the model."""
    from planner.evaluation.virtual_experiment import play_experiment
    from planner.report.virtual_figures import virtual_pictures
    from planner.report.virtual_page import virtual_page
    from planner.report.virtual_results import virtual_results
    from planner.report.virtual_tables import virtual_text

    outcome = play_experiment(progress=progress)
    progress("the report")
    _write_records(folder, outcome)
    document = virtual_results(outcome)
    _write_report(folder, document, virtual_pictures(outcome), virtual_page)
    failures = [
        f"{joint.name}: the model that was identified does not describe the joint; see its "
        "warnings in results.json"
        for joint, found in zip(outcome.planned.joints, outcome.identifications, strict=True)
        if not found.accepted
    ]
    return Told(document, virtual_text(document), tuple(failures))


def _write_paths(folder: Path, reproduction: Reproduction) -> None:
    import numpy as np

    from planner.files.foot_path import write_foot_path
    from planner.files.joint_path import write_joint_path
    from planner.report.paths import joint_paths

    period = reproduction.model.period
    names = reproduction.walk.joint_names
    for name, angles in joint_paths(reproduction).items():
        write_joint_path(folder / f"{name}.csv", names, angles, period=period)
    write_foot_path(folder / "foot_desired.csv", reproduction.walk.desired_foot, period=period)
    for name, outcome in reproduction.foot.items():
        write_foot_path(folder / f"foot_{name}.csv", np.asarray(outcome.positions), period=period)


def _write_records(folder: Path, outcome: VirtualOutcome) -> None:
    """Models, logs of the step tests, and requests and angles of every walk."""
    import numpy as np

    from planner.files.joint_model import write_model
    from planner.files.joint_path import write_joint_path
    from planner.files.table import write_table

    period = outcome.constants.request_period
    walk = outcome.planned.walk
    for name, found in zip(walk.joint_names, outcome.identifications, strict=True):
        write_model(folder / f"{name}.toml", found.model)
        for fit in found.fits:
            log = fit.log
            height = np.degrees(np.ptp(log.requests))
            write_table(
                folder / f"step_test_{name}_{height:.0f}.csv",
                ["t_s", "requested_deg", "actual_deg"],
                np.column_stack([log.times, np.degrees(log.requests), np.degrees(log.angles)]),
            )
    write_joint_path(folder / "desired.csv", walk.joint_names, walk.desired, period=period)
    for method, run in outcome.runs.items():
        for kind, angles in (
            ("requests", run.requests),
            ("angles", np.concatenate(run.angles)),
            ("sensed", np.concatenate(run.sensed)),
        ):
            path = folder / f"{kind}_{method}.csv"
            write_joint_path(path, walk.joint_names, angles, period=period)


def _write_report(
    folder: Path,
    document: dict[str, Any],
    drawn: Sequence[Picture],
    page: Callable[[dict[str, Any], Sequence[Picture], Sequence[str]], str],
) -> None:
    """The page, which links to the files that are already there, and its pictures."""
    from planner.files.output_folder import list_files
    from planner.files.text import write_bytes, write_text
    from planner.report.render import to_png, to_svg

    linked = ["results.json", *list_files(folder)]
    (folder / "figures").mkdir()
    for picture in drawn:
        write_text(folder / "figures" / f"{picture.name}.svg", to_svg(picture.figure))
        write_bytes(folder / "figures" / f"{picture.name}.png", to_png(picture.figure))
    write_text(folder / "report.html", page(document, drawn, linked))
