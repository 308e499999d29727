"""Chunks of a policy through LeRobot's own pipeline, on an arm of six joints."""

from __future__ import annotations

import warnings

import heavy
import numpy as np
import pytest
from lerobot.processor.pipeline import PolicyProcessorPipeline
from lerobot_robot_planned.chunk import ArmState, PlanChunk

import planner
from lerobot_robot_planned import chunk as module

RATE, LENGTH, EXECUTED = 30.0, 50, 25
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
UNITS = ["degrees"] * 5 + ["range_0_100"]


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    now = [0.0]
    monkeypatch.setattr(module, "CLOCK", lambda: now[0])
    monkeypatch.setattr(module, "SEEN", {})
    return now


@pytest.fixture
def step(tmp_path, clock):
    file = tmp_path / "arm.toml"
    parts = []
    for k, joint in enumerate(JOINTS):
        model = planner.JointModel(
            v_max=1.3 if joint == "gripper" else 5.0,
            theta_0=0.1 if joint == "gripper" else 0.35 + 0.02 * k,
            lag=0.015 + 0.002 * k,
            acceleration_time=0.06,
            tick=0.005,
            hold=4,
        )
        model.to_toml(tmp_path / "one.toml")
        parts.append(f"[{joint}]\n" + (tmp_path / "one.toml").read_text())
    file.write_text("\n".join(parts))
    return PlanChunk(models=str(file), joints=JOINTS, units=UNITS, rate=RATE)


def paths(count: int) -> np.ndarray:
    """What the policy means to do, (count, joints)."""
    seconds = np.arange(count)[:, np.newaxis] / RATE
    rates = 0.35 + 0.05 * np.arange(6)
    return 50.0 + 22.0 * np.sin(2.0 * np.pi * rates * seconds + np.arange(6))


def play(step: PlanChunk, clock: list[float], *, chunks: int = 12, planned: bool = True):
    """Goal positions, and the chunks' actions that they stand for, (rows, joints)."""
    rng, whole = np.random.default_rng(7), paths(EXECUTED * (chunks + 2) + LENGTH)
    sent, meant = [], []
    for k in range(chunks):
        clock[0] = k * EXECUTED / RATE
        begin = k * EXECUTED
        actions = whole[begin : begin + LENGTH] + rng.normal(0.0, 3.0, 6)  # each chunk is off
        goals = step.action(heavy.as_tensor(actions[np.newaxis]))[0] if planned else actions
        sent.append(np.asarray(goals)[:EXECUTED])
        meant.append(actions[:EXECUTED])
    return np.concatenate(sent), np.concatenate(meant)


def angles(step: PlanChunk, goals: np.ndarray) -> np.ndarray:
    scale = step._scale
    models = step._stream.models
    requests = scale[:, 0] * goals + scale[:, 1]
    moved = [
        planner.simulate(model, requests[:, j], cyclic=False) for j, model in enumerate(models)
    ]
    return (np.column_stack(moved) - scale[:, 1]) / scale[:, 0]


def jumps(series: np.ndarray) -> float:
    """Mean change where a chunk begins, beyond what changes in the period before it."""
    change = np.diff(series, axis=0)
    at = np.arange(EXECUTED - 1, len(change), EXECUTED)
    return float(np.mean(np.abs(change[at] - change[at - 1])))


def test_planned_chunks_are_followed_closely_and_begin_without_jumps(step, clock):
    goals, meant = play(step, clock)
    direct, _ = play(step, clock, planned=False)
    rows = slice(EXECUTED, None)

    def error(sent: np.ndarray) -> float:
        return float(np.sqrt(np.mean((angles(step, sent) - meant)[rows] ** 2)))

    assert error(goals) < 0.3 * error(direct)
    assert jumps(goals) < 0.35 * jumps(direct)


def test_the_pipeline_takes_both_steps_and_writes_their_settings(step):
    before = PolicyProcessorPipeline([ArmState()], name="policy_preprocessor")
    after = PolicyProcessorPipeline([step], name="policy_postprocessor")
    assert after.steps[0].get_config()["joints"] == JOINTS
    assert before.steps[0].get_config() == {"arm": "arm"}


def test_a_chunk_begins_where_the_arm_was_seen(step):
    state = paths(1)[0] + 5.0
    ArmState().observation({"observation.state": heavy.as_tensor(state)})
    path = np.repeat(paths(1), LENGTH, axis=0)
    seen = np.asarray(step.action(heavy.as_tensor(path[np.newaxis]))[0])
    module.SEEN.clear()
    step.reset()
    unseen = np.asarray(step.action(heavy.as_tensor(path[np.newaxis]))[0])
    assert np.allclose(unseen, path, atol=0.2)
    assert np.all(np.abs(seen[0] - path[0]) > 0.5)


def test_single_actions_stay_as_they_are(step):
    action = heavy.as_tensor(paths(1))
    with pytest.warns(UserWarning, match="single actions are not planned"):
        assert step.action(action) is action


def test_wrong_shapes_and_settings_are_refused(step):
    with pytest.raises(ValueError, match=r"expected \(1, T, 6\)"):
        step.action(heavy.as_tensor(np.zeros((1, 50, 4))))
    with pytest.raises(ValueError, match="expected one for each of the 2 joints"):
        PlanChunk(models="arm.toml", joints=["a", "b"], units=["degrees"])


def test_nothing_is_warned_of_in_normal_use(step, clock):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        play(step, clock, chunks=3)
