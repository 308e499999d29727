"""The logs that the page about logs names, each by a joint that is known."""

import contextlib
import json

import numpy as np

from planner import JointModel, simulate, step_test
from planner.files.exports import Layout, lerobot_dataset
from planner.files.table import write_table

JOINT = JointModel(v_max=3.0, theta_0=0.08, lag=0.02, acceleration_time=0.03)
"""The joint behind every log [rad, or shares of a range]."""

EPISODES = 8


def _answer(seed=0):
    """Requests and angles of three steps, with a little noise, shape (264,) each."""
    requests = 0.1 + np.concatenate([step_test(size) for size in (0.1, 0.4, 0.8)])
    angles = simulate(JOINT, requests, cyclic=False)
    return requests, angles + np.random.default_rng(seed).normal(0.0, 1e-3, len(angles))


def _write_csvs(folder):
    requests, angles = answer = _answer()
    time = JOINT.period * np.arange(len(requests))
    degrees, ticks = np.degrees(answer), np.round(np.array(answer) * 4096 / (2 * np.pi))
    arm = {"goal_Wrist": requests, "present_Wrist": angles}
    arm |= {"goal_Jaw": requests, "present_Jaw": angles}
    demo = {"goal_wrist_rad": requests, "present_wrist_rad": angles}
    demo |= {"goal_jaw_range": 0.5 * requests, "present_jaw_range": 0.5 * angles}
    other = {"u": degrees[0], "y": degrees[1], "power": np.ones(len(time))}
    for name, columns in {
        "run": {"t_s": time, "requested_deg": degrees[0], "actual_deg": degrees[1]},
        "other": {"clock": 1e3 * time, **other},
        "arm": {"time_s": time, **arm},
        "demo": {"t_s": time, **demo},
        "servo": {"time_s": time, "goal": ticks[0], "position": ticks[1]},
    }.items():
        write_table(folder / f"{name}.csv", [*columns], np.column_stack(list(columns.values())))
    JOINT.to_toml(folder / "arm.toml")


def _write_bam(folder):
    entries = [
        {"timestamp": k * JOINT.period, "goal_position": r, "position": a, "torque_enable": True}
        for k, (r, a) in enumerate(zip(*_answer(), strict=True))
    ]
    text = json.dumps({"motor": "sts3250", "entries": entries})
    (folder / "2024-10-26_12h23m27.json").write_text(text)


def _write_dataset(folder):
    names = ("shoulder_pan.pos", "elbow_flex.pos", "gripper.pos")
    features = {"action": names, "observation.state": names}
    layout = Layout(features=features, rate=1.0 / JOINT.period)
    with lerobot_dataset(folder / "my_dataset", layout) as add:
        for episode in range(EPISODES):
            rows = [np.repeat(100.0 * each[:, None], 3, axis=1) for each in _answer(episode)]
            add(dict(zip(features, rows, strict=True)), "")


def _write_bags(folder):
    from tests.files.logs import bags

    types = bags.store()
    kit = bags.Kit(types)
    stamps = [bags.START + round(1e9 * JOINT.period) * k for k in range(len(_answer()[0]))]
    rows = [(t, [r, r], [a, a]) for t, r, a in zip(stamps, *_answer(), strict=True)]
    states = [("/leg_controller/state", t, kit.state(t, r, a)) for t, r, a in rows]
    bags.write(folder / "my_bag", types, states)
    apart = [
        message
        for t, r, a in rows
        for message in (
            ("/leg/joint_trajectory", t, kit.trajectory(t, r)),
            ("/joint_states", t, kit.joint_state(t, a)),
        )
    ]
    bags.write(folder / "mcap", types, apart, storage="mcap")
    bags.only_file(folder / "mcap", ".mcap").rename(folder / "run.mcap")
    old = bags.store(bags.OLD, ros1=True)
    kit = bags.Kit(old)
    of_ros1 = [("/arm_controller/state", t, kit.state(t, r, a)) for t, r, a in rows]
    bags.write(folder / "run.bag", old, of_ros1, storage="ros1")


def write_logs(folder):
    """Every log of the page, in the formats whose packages are installed."""
    _write_csvs(folder)
    _write_bam(folder)
    for write in (_write_dataset, _write_bags):
        with contextlib.suppress(ModuleNotFoundError):
            write(folder)
