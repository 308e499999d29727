"""The figures and results of the virtual robot are those of its experiment."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.model.joint import JointModel
from planner.report.figure import THIN
from planner.report.paper.figures import HIDDEN, ROLES
from planner.report.paper.results import dropped_words, executed_table, virtual_results
from planner.report.paper.virtual_figures import PATHS, virtual_figures


@pytest.fixture(scope="module")
def outcome(virtually_reproduced):
    return virtually_reproduced.answer


@pytest.fixture(scope="module")
def figures(outcome):
    return {figure.name: figure for figure in virtual_figures(outcome)}


def values(curve):
    """The values of a curve without its gaps and without the sample that closes each cycle."""
    parts = np.split(curve.y, np.flatnonzero(np.isnan(curve.y)))
    return np.array([part[np.isfinite(part)][:-1] for part in parts])


def test_every_cycle_of_every_joint_is_drawn_under_its_method(outcome, figures):
    panels = figures["joints_by_method"].panels
    for j, (panel, joint) in enumerate(zip(panels[:3], outcome.planned.joints, strict=True)):
        assert panel.title == joint.name
        curves = {curve.name: curve for curve in panel.curves}
        assert values(curves["desired"]) == pytest.approx(np.degrees([joint.desired]))
        for method, role in ROLES.items():
            if method != "shift":
                curve = curves[role.label]
                angles = np.degrees(outcome.runs[method].angles[:, :, j])
                assert values(curve) == pytest.approx(angles)
                assert (curve.hidden, curve.role.width) == (method == "optimal", THIN)
    for name, method, predicted in (
        ("joints_direct", "direct", "direct"),
        ("foot_optimised_trajectories", "foot_optimal", "foot_optimal"),
    ):
        for j, (panel, joint) in enumerate(
            zip(figures[name].panels, outcome.planned.joints, strict=True)
        ):
            mean, actual = (each for each in panel.curves if each.name.startswith("actual"))
            assert values(mean) == pytest.approx(values(actual).mean(axis=0, keepdims=True))
            told = next(each for each in panel.curves if each.name == "predicted")
            assert values(actual) == pytest.approx(np.degrees(outcome.runs[method].angles[..., j]))
            assert values(told) == pytest.approx(np.degrees([getattr(joint, predicted)]))


def test_the_foot_is_drawn_as_far_off_as_it_was(outcome, figures):
    desired = outcome.planned.walk.desired_foot
    panel = figures["joints_by_method"].panels[-1]
    for (method, role), curve in zip(ROLES.items(), panel.curves[1::2], strict=True):
        distances = 100.0 * np.linalg.norm(outcome.foot_paths[method] - desired, axis=2)
        assert (curve.name, curve.hidden) == (role.label, method in HIDDEN)
        assert values(curve) == pytest.approx(distances)
    paths = {curve.name: curve for curve in figures["foot_paths"].panels[0].curves}
    for method, role in PATHS.items():
        assert values(paths[role.label]) == pytest.approx(
            100.0 * outcome.foot_paths[method][..., 2]
        )
    motions = {motion.role.label: motion for motion in figures["foot_paths"].movie.motions[1:]}
    for method, role in ROLES.items():
        np.testing.assert_array_equal(motions[role.label].points, outcome.legs[method][0])


def test_results_are_those_of_the_experiment(outcome):
    results = virtual_results(outcome)
    planned = outcome.planned
    pairs = [
        (results["table2"][joint][pair], over, outcome.sensed_table2[joint][pair],
         planned.table2[joint][pair])
        for joint, overs in outcome.table2.items()
        for pair, over in overs.items()
    ]  # fmt: skip
    pairs += [
        (results["foot"][method], over, outcome.sensed_foot_table[method],
         planned.foot_table[method])
        for method, over in outcome.foot_table.items()
    ]  # fmt: skip
    for entry, over, sensed, predicted in pairs:
        for told, of in ((entry, over), (entry["sensed"], sensed)):
            assert (told["L2"], told["Linf"]) == (of.mean.rms, of.mean.max)
            assert told["std"] == {"L2": of.deviation.rms, "Linf": of.deviation.max}
        assert entry["predicted"] == {"L2": predicted.rms, "Linf": predicted.max}
    table = executed_table(results)
    foot = dict(zip(results["foot"], (row.cells for row in table.rows), strict=True))
    assert [column.title for column in table.columns] == [*results["table2"], "foot"]
    plans = {
        "direct": "Des,Dir",
        "closed_form_plain": "Des,Plain",
        "closed_form": "Des,MB",
        "optimal": "Des,Opt",
        "foot_optimal": "Des,Foot",
    }
    for method, pair in plans.items():
        *joints, whole = foot[method]
        entries = [joint[pair] for joint in results["table2"].values()]
        for cell, entry in zip((*joints, whole), (*entries, results["foot"][method]), strict=True):
            assert cell[:2] == (f"{entry['predicted']['L2']:.2f}", f"{entry['L2']:.2f}")
    assert foot["shift"][0] == ("–", "–", "–")
    dropped = {"robot": {"dropped_cycles": {"direct": 2, "shift": 1, "optimal": 3}}}
    assert dropped_words(dropped) == "1 to 3"
    paper = {"v_max_deg_per_tick": 2.5, "theta_0_deg": 7.0, "lag_ticks": 4, "acceleration_ticks": 6}
    for joint, found in zip(planned.joints, outcome.identifications, strict=True):
        told, period = results["identified"][joint.name], found.model.period
        assert told["rms_deg"] == math.degrees(found.rms)
        assert told["held_out_rms_deg"] == math.degrees(found.held_out_rms)
        assert told["unseen_walk_rms_deg"] == math.degrees(outcome.unseen_rms[joint.name])
        ours = {name: row["value"] for name, row in told["table1"].items()}
        assert ours == pytest.approx(
            {
                "v_max_deg_per_tick": math.degrees(found.model.v_max) * period,
                "theta_0_deg": math.degrees(found.model.theta_0),
                "lag_ticks": found.model.lag / period,
                "acceleration_ticks": found.model.acceleration_time / period,
                "offset_deg": math.degrees(found.model.offset),
            }
        )
        ends = [told["table1"]["lag_ticks"][end] for end in ("lower", "upper")]
        assert ends == pytest.approx([end / period for end in found.intervals["lag"]])
        for name, row in told["table1"].items():
            assert row["paper"] == pytest.approx(paper.get(name), abs=0.1)
    learning = results["learning"]
    assert [each["L2"] for each in learning["trials"]] == [
        each.mean.rms for each in outcome.learnt_foot
    ]
    assert learning["noise"] == 100.0 * outcome.learning.floor[1]
    robot = results["robot"]
    assert robot["dropped_cycles"] == {name: run.dropped for name, run in outcome.runs.items()}
    assert robot["top_speed_deg_per_tick"] == pytest.approx(
        math.degrees(outcome.constants.top_speed * JointModel.ers210a().period)
    )
    assert results["seconds"]["total"] == sum(outcome.seconds.values())
