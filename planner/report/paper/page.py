"""The pages of the paper's experiment, on its own model and on the virtual robot."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from planner.report.figure import Figure
from planner.report.page import (
    Card,
    Listing,
    Page,
    Section,
    file_links,
    parameters_of,
    rendered,
)
from planner.report.paper.figures import FEATURED
from planner.report.paper.results import (
    Results,
    bounds_table,
    dropped_words,
    executed_table,
    foot_table,
    signed_percent,
    table_1,
    table_2,
)
from planner.report.paper.virtual_figures import VIRTUAL_FEATURED
from planner.report.table import Column, Row, Table, percent, signed

ABOUT = Markup("Stronger &amp; Stone, <cite>A Model-Based Approach to Robot Joint Control</cite>")


def paper_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the paper's model."""
    foot, bound = results["foot"], results["foot_bound"]
    gaps = [each["gap"] for each in results["bounds"].values()]
    cards = [
        _foot_card(foot),
        Card(percent(results["baseline_deviation"], 1), "",
             "mean deviation of the ten baseline figures from the paper’s"),
        Card(percent(bound["gap"]), "",
             f"gap of the foot-optimised requests over the lower bound within the limits, "
             f"{bound['L2']:.3f} cm"),
        Card(f"{percent(min(gaps))} – {percent(max(gaps))}", "",
             "gap of every joint’s optimised requests over its lower bound"),
    ]  # fmt: skip
    featured = [figure for figure in figures if figure.name in FEATURED]
    parameters = results["parameters"]
    parameter_rows = [
        *((words, f"{parameters['model'][name]:.6g}")
          for name, words in parameters_of([parameters["model"]]).items()),
        ("samples in a step of the walk", parameters["samples"]),
        ("of these clamped into the leg’s reach", parameters["clamped_samples"]),
        ("lines of each approximation", parameters["segments"]),
        ("rule that inverts a line", parameters["rule"]),
    ]  # fmt: skip
    return Page(
        heading="The paper’s experiment, again",
        command="",
        about=ABOUT,
        verdict=rendered("paper.verdict", results=results, foot=foot),
        note=rendered("paper.note", results=results),
        cards=cards,
        sections=[
            Section("Moment by moment", "paper.moments", featured=featured),
            Section(
                "Table 2: joint angles", "paper.table_2", results=results, table=table_2(results)
            ),
            Section(
                "The foot", "paper.foot", results=results, foot=foot, table=foot_table(results)
            ),
            Section("How good could any requests be?", "paper.bounds", table=bounds_table(results)),
            Section("Figures", pictures=[each for each in figures if each not in featured]),
        ],
        listings=[file_links(files), Listing("Parameters", parameter_rows), *_ends(results)],
        footer=f"{results['made_by']}. Published figures: {results['source']}.",
        downloads=True,
    ).html()


def virtual_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the virtual robot."""
    foot, joints = results["foot"], results["identified"]
    fidelity = [each["Pwl,Plain"]["L2"] for each in results["table2"].values()]
    rms = [each["rms_deg"] for each in joints.values()]
    cards = [
        Card(f"{min(rms):.2f} – {max(rms):.2f}°", "",
             "rms between the step tests and the identified models, by joint"),
        Card(f"{min(fidelity):.1f} – {max(fidelity):.1f}°", "",
             "L₂(Pwl, MB), the paper’s measure of its model’s fidelity; there 2.6 – 2.7°"),
        Card(signed_percent(foot["foot_optimal"]["loss"]), "",
             "foot error of the foot-optimised plan, executed against planned"),
        _foot_card(foot),
    ]  # fmt: skip
    featured = [figure for figure in figures if figure.name in VIRTUAL_FEATURED]
    learning = [figure for figure in figures if figure.name == "learning"]
    rest = [figure for figure in figures if figure not in (*featured, *learning)]
    warnings = {name: joint["warnings"] for name, joint in joints.items() if joint["warnings"]}
    return Page(
        heading="The paper’s experiment on a virtual robot",
        command="",
        about=ABOUT,
        verdict=rendered("virtual.verdict", results=results, foot=foot),
        note=results["note"],
        cards=cards,
        sections=[
            Section("Moment by moment", "paper.moments", featured=featured),
            Section(
                "Table 1: the joints, identified",
                "virtual.table_1",
                results=results,
                table=table_1(results),
                warnings=warnings,
            ),
            Section(
                "Table 2: joint angles",
                "virtual.table_2",
                results=results,
                dropped=dropped_words(results),
                table=table_2(results),
            ),
            Section("The foot", "virtual.foot", results=results, table=foot_table(results)),
            Section(
                "What the plans predicted and the robot did",
                "virtual.executed",
                table=executed_table(results),
            ),
            Section(
                "Learning from executed cycles",
                "virtual.learning",
                results=results,
                learning=learning,
            ),
            Section("Figures", pictures=rest),
            Section(
                "What the robot is made of",
                "virtual.robot",
                results=results,
                table=constants_table(results["robot"]["constants"]),
            ),
        ],
        listings=[file_links(files), *_ends(results)],
        footer=f"{results['made_by']}. Published figures: {results['source']}.",
        downloads=True,
    ).html()  # fmt: skip


def constants_table(constants: Results) -> Table:
    """The constants of the robot, with their sources."""
    rows = []
    for name, constant in constants.items():
        unit = constant["unit"].replace("^2", "²") if constant["unit"] != "1" else ""
        value = signed(f"{constant['value']:.4g} {unit}".strip())
        rows.append(Row(name.replace("_", " "), (value, constant["source"])))
    columns = (Column("value"), Column("source", words=True))
    return Table("constant", columns, tuple(rows), label="Constants")


def _foot_card(foot: Results) -> Card:
    return Card(
        f"{foot['direct']['L2']:.2f} → {foot['foot_optimal']['L2']:.2f}",
        "cm",
        "foot error, direct to foot-optimised (L₂); closed form, as in the paper: "
        f"{foot['closed_form_plain']['L2']:.2f} cm",
    )


def _ends(results: Results) -> list[Listing]:
    seconds = [(part.replace("_", " "), f"{each:.2f}") for part, each in results["seconds"].items()]
    return [Listing("Seconds", seconds), Listing("Versions", list(results["versions"].items()))]
