"""``request-planner replay``: a recording in, requests that repeat it out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from planner.cli import options
from planner.cli.console import Answer, Progress, remark, warn
from planner.cli.declared import Source, argument
from planner.cli.settings import SMOOTHING, ReplayRun

if TYPE_CHECKING:
    from planner.cli.recordings import ReplayTask


@options.command("Write a page (HTML) about the replay.")
def replay(
    *,
    logs: tuple[Source, ...] = argument(form="RECORDING..."),
    run: ReplayRun = options.settings(
        "model: file",
        "path: speed",
        "replay: track",
        "path: joints",
        "replay: begin_s end_s",
        "path: rate_hz",
        "limits: deg",
        f"plan: load norm solver {SMOOTHING}",
        "replay: fastest",
        "tolerance: deg cm",
        "replay: retime",
        f"leg: {options.LEG}",
        "replay: urdf_joints write_as",
        speed="How many times as fast as it was recorded.  [default: 1.0]",
        joints="The joints to plan; the others get their recorded requests. Repeat the option for "
        "several.  [default: all that have a model, but no grippers]",
        rate_hz="Requests per second.  [default: that of the recording]",
        name="A leg or arm of your robot, with --base and --foot, whose joints are recorded; or a "
        "shipped leg.",
        file="Joint models as TOML, by the names of the recording's joints; 'from-log' identifies "
        "them from the recording itself.  [required]",
        load="Torque on the joints: gravity by the masses of the URDF, all of its dynamics; "
        "or column, that of the recording (<joint>_load_Nm in a CSV).  [default: column, if any]",
        limits_deg="Range of the requests [deg, or percent of the range], of all joints or one.  "
        "[default: none; of percent 0 to 100, or as far as the recording goes]",
    ),
    log: Any = options.log_options(),
    output: str = options.output_or_folder,
    work: Mapping[str, Any] = options.parallel,
) -> Answer:
    """Plan requests that repeat RECORDINGs, at their own speed or another one.

    A RECORDING is what `identify` reads: CSV with columns such as t_s, requested_deg and
    actual_deg, a LeRobot dataset, a ROS bag, or a JSON of BAM. Its units, names and rate stay.
    Grippers and joints without a model get their recorded requests at the new speed.

    \b
    Example, a demonstration half as fast again, and one that brings its own models:
        request-planner replay demo.csv --model arm.toml --speed 1.5 -o requests.csv
        request-planner replay demo.csv --model from-log --speed 1.5 -o requests.csv

    \b
    Example, as fast as the joints stay within one degree, and slower only where they need it:
        request-planner replay demo.csv --model arm.toml --fastest --tolerance-deg 1 -o requests.csv
        request-planner replay demo.csv --model arm.toml --fastest --tolerance-deg 1 \\
            --retime varying -o requests.csv

    \b
    Example, ten episodes of a LeRobot dataset as a dataset of planned actions:
        request-planner replay my_dataset --episodes 0-9 --unit deg --model arm.toml --speed 1.5 \\
            --as lerobot -o planned_dataset
    """  # noqa: D301
    from planner.cli.recordings import ABOUT, check_writing, origin_of, replay_many, tasks_of
    from planner.files.logs import recordings_in
    from planner.files.results import finished
    from planner.parallel import executor_of
    from planner.recording.episode import left_out

    recordings = recordings_in(logs, log)
    check_writing(run.replay.write_as, recordings, output)
    if len(recordings) == 1:
        if unused := ", ".join(f"--{name}" for name in filter(work.get, work)):
            warn(f"{unused}: no effect on a single recording")
    elif work["resume"] and (before := finished(output, ABOUT, origin_of(run, recordings))):
        count = len(before["recordings"])
        remark(f"nothing is missing: {output} holds all {count} recordings, planned like this")
        before.setdefault("warnings", [])  # an earlier version wrote none
        return _answer(run, before, logs)
    with Progress() as progress:
        tasks = tasks_of(run, recordings, progress)
    for each in tasks[0].models.remarks:
        warn(each)
    if len(tasks) == 1:
        return _replay_one(run, tasks[0], output)
    with (
        executor_of(work["workers"], work["scheduler"]) as executor,
        Progress(len(tasks), parallel=True) as progress,
    ):
        document, kept = replay_many(
            tasks, output, executor, resume=work["resume"], progress=progress
        )
    for words in filter(None, dict.fromkeys(left_out(each.recording) for each in tasks)):
        remark(words)
    return _answer(run, document, logs, kept, tasks[0].models.remarks)


def _replay_one(run: ReplayRun, task: ReplayTask, output: str) -> Answer:
    from planner.cli.recordings import missed, write
    from planner.report import replay_page as report

    with Progress() as progress:
        result, fastest = task.run(progress)
        progress("the errors of other requests")
        content = report.replay_results(result, task.models)
        words = report.replay_text(result, task.models, fastest)
        misses = missed(task, result)

    shown: dict[str, Any] = {"models": task.models, "fastest": fastest, "arm": task.arm}
    shown |= {"title": PurePath(task.recording.name).name, "missed": misses}
    if fastest is not None:
        content |= {"fastest": report.fastest_results(fastest)}
    for each in result.path.remarks:
        remark(f"{result.path.name}: {each}")
    return Answer(
        content,
        words,
        lambda file: write(file, task, result),
        lambda: report.replay_page(result, **shown),
        [("recording", task.recording.name), *_chosen(run, result.path.track)],
        [("recording", task.recording.path), ("requests", output)],
        failure=f"{'; '.join(misses)}; the requests are written all the same" if misses else "",
        warnings=content["warnings"],
    )


def _chosen(run: ReplayRun, track: str) -> list[tuple[str, str]]:
    """The track, and the settings that were set."""
    from planner.cli.planning import origins_of

    chosen = {"replay.track": track, **dict(origins_of(run))}
    return [(name.removeprefix("replay."), value) for name, value in chosen.items()]


def _answer(
    run: ReplayRun,
    document: Mapping[str, Any],
    logs: Sequence[str],
    kept: Path | None = None,
    said: Sequence[str] = (),
) -> Answer:
    """The errors of the plans of many recordings, warnings, and remarks that are not said yet."""
    from planner.report.replay_page import episodes_page, episodes_text

    failure, title = "", ", ".join(dict.fromkeys(PurePath(name).name for name in logs))
    left_out = [f"{name} is left out: {reason}" for name, reason in document["left_out"].items()]
    if left_out:
        count = len(document["recordings"]) + len(left_out)
        failure = (
            f"{len(left_out)} of {count} recordings left out; the others are written, and kept in "
            f"{kept} for --resume"
        )
    return Answer(
        document,
        episodes_text(document, said),
        page=lambda: episodes_page(document, title=title),
        origins=[*(("recordings", name) for name in logs), *_chosen(run, document["track"])],
        failure=failure,
        warnings=document["warnings"] + left_out,
    )
