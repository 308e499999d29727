"""Bags: requested and actual angles by type of topic, the command held at each state's time."""

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2

from planner import InvalidFile, LogOptions, read_logs
from tests.files.logs.bags import (
    JOINTS,
    LAYOUTS,
    NEW,
    PERIOD,
    START,
    Kit,
    angles,
    forget_definitions,
    only_file,
    store,
    write,
)

EXACT = 1e-12  # angles and times come through unchanged but for one product of float64 [rad, s]
RECEIPT = 300_000  # how long after its stamp a message is received [ns]
STATE = "/arm_controller/controller_state"
ZSTD = rosbag2.CompressionFormat.ZSTD
EARLIER = Kit(store()).header(START + PERIOD)
JOINT_STATES = [("/s", START + k, Kit(store()).joint_state(START + k, [0, 0])) for k in range(4)]
NUMBERS = [(name, lambda kit, _: kit.numbers([0.0, 0.0])) for name in ("/more", "/x")]


def _controller_bag(path, layout=NEW, *, storage="sqlite3", compression=None):
    types = store(layout, ros1=storage == "ros1")
    kit = Kit(types)
    rows = zip(*angles(), strict=True)
    messages = [
        (STATE, START + k * PERIOD + RECEIPT, kit.state(START + k * PERIOD, *row))
        for k, row in enumerate(rows)
    ]
    return write(path, types, messages, storage=storage, compression=compression)


def _command_bag(path, command, *, late=0, extra=()):
    """Joint states every PERIOD; before each, a command (from the second on, if ``late``)."""
    kit, messages = Kit(store()), []
    requested, actual = angles()
    for k in range(len(actual)):
        stamp = START + k * PERIOD
        if k >= late:
            messages.append(("/commands", stamp - PERIOD // 2, command(kit, stamp, requested[k])))
        messages.append(("/joint_states", stamp + RECEIPT, kit.joint_state(stamp, actual[k])))
        messages.extend((name, stamp, build(kit, stamp)) for name, build in extra)
    messages.sort(key=lambda message: message[1])
    return write(path, kit.types, messages, storage="mcap")


def _assert_holds_the_angles(log, joint):
    requested, actual = (values[:, JOINTS.index(joint)] for values in angles())
    np.testing.assert_allclose(log.requests, requested, atol=EXACT)
    np.testing.assert_allclose(log.angles, actual, atol=EXACT)
    np.testing.assert_allclose(log.times, 1e-9 * PERIOD * np.arange(len(actual)), atol=EXACT)
    assert log.joint == joint
    assert log.unit == "rad"
    assert log.torque_on.all()


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("storage", ["sqlite3", "mcap", "ros1"])
def test_a_controllers_state_is_read_by_the_bags_own_definition(tmp_path, storage, layout):
    path = tmp_path / ("run.bag" if storage == "ros1" else "run")
    _controller_bag(path, layout, storage=storage)
    logs = read_logs(path, options=LogOptions(joint="all"))
    for log, joint in zip(logs, JOINTS, strict=True):
        _assert_holds_the_angles(log, joint)
    assert logs[0].notes == (
        f"actual from {STATE}, requested from {STATE}",
        "time from its header",
        "angles in rad, as is the custom of ROS (REP 103)",
    )


@pytest.mark.parametrize(("storage", "ending"), [("sqlite3", ".db3"), ("mcap", ".mcap")])
def test_a_single_file_of_a_bag_is_read_without_its_folder(tmp_path, storage, ending):
    file = only_file(_controller_bag(tmp_path / "run", storage=storage), ending)
    alone = file.rename(tmp_path / f"alone{ending}")
    _assert_holds_the_angles(*read_logs(alone, options=LogOptions(joint="knee")), "knee")


def test_a_bag_without_definitions_has_the_layout_of_humble(tmp_path):
    folder = _controller_bag(tmp_path / "run", LAYOUTS["humble"])
    forget_definitions(only_file(folder, ".db3"))
    _assert_holds_the_angles(*read_logs(folder, options=LogOptions(joint="knee")), "knee")


COMPRESSED = {
    "bz2": ("ros1", (rosbag1.Writer.CompressionFormat.BZ2,)),
    "lz4": ("ros1", (rosbag1.Writer.CompressionFormat.LZ4,)),
    "zstd messages": ("sqlite3", (rosbag2.CompressionMode.MESSAGE, ZSTD)),
    "zstd file": ("sqlite3", (rosbag2.CompressionMode.FILE, ZSTD)),
    "zstd chunks": ("mcap", (rosbag2.CompressionMode.STORAGE, ZSTD)),
}


def _compressed_bag(folder, how):
    storage, compression = COMPRESSED[how]
    path = folder / ("run.bag" if storage == "ros1" else "run")
    return _controller_bag(path, storage=storage, compression=compression)


@pytest.mark.parametrize("how", COMPRESSED)
def test_compressed_bags_are_read(tmp_path, how):
    path = _compressed_bag(tmp_path, how)
    _assert_holds_the_angles(*read_logs(path, options=LogOptions(joint="hip")), "hip")


COMMANDS = {
    "trajectory": lambda kit, stamp, row: kit.trajectory(stamp - 1000, row),
    "trajectory without stamps": lambda kit, _, row: kit.trajectory(0, row),
    "joint states": lambda kit, stamp, row: kit.joint_state(stamp - 1000, row),
    "joints in another order": lambda kit, stamp, row: kit.joint_state(
        stamp - 1000, row[::-1], JOINTS[::-1]
    ),
    "numbers": lambda kit, _, row: kit.numbers(row),
    "another controller": lambda kit, stamp, row: kit.state(stamp - 1000, row, [0.0, 0.0]),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_joint_states_are_held_against_the_commands_before_them(tmp_path, command):
    folder = _command_bag(tmp_path / "run", COMMANDS[command])
    options = LogOptions(joint="knee", topic="/joint_states", command_topic="/commands")
    _assert_holds_the_angles(*read_logs(folder, options=options), "knee")


def test_states_before_the_first_command_are_left_out_and_said_so(tmp_path):
    folder = _command_bag(tmp_path / "run", COMMANDS["trajectory"], late=7)
    (log,) = read_logs(folder, options=LogOptions(joint="hip"))
    np.testing.assert_allclose(log.requests, angles()[0][7:, 0], atol=EXACT)
    assert log.times[0] == 0.0
    assert "7 states before the first request left out" in log.notes


def test_commands_stamped_by_another_clock_count_from_their_receipt(tmp_path):
    folder = _command_bag(
        tmp_path / "run", lambda kit, stamp, row: kit.trajectory(1 + stamp - START, row)
    )
    (log,) = read_logs(folder, options=LogOptions(joint="hip"))
    _assert_holds_the_angles(log, "hip")
    words = "time of the actual angles from its header, of the requested ones from receipt"
    assert log.notes[1] == words


def test_repeated_and_disordered_states_are_put_in_order(tmp_path):
    types = store()
    kit = Kit(types)
    requested, actual = angles()
    order = [0, 1, 3, 2, 2, *range(4, len(actual))]
    messages = [
        (STATE, START + k, kit.state(START + j * PERIOD, requested[j], actual[j]))
        for k, j in enumerate(order)
    ]
    write(tmp_path / "run", types, messages)
    (log,) = read_logs(tmp_path / "run", options=LogOptions(joint="knee"))
    _assert_holds_the_angles(log, "knee")
    assert "1 repeated states left out" in log.notes


def _read(path, **options):
    return read_logs(path, options=LogOptions(**options))


def _states(topics=(STATE,), changed=None, change=None):
    """Messages of controllers' states, of which the one with this number is changed."""
    kit, messages = Kit(store()), []
    for k, row in enumerate(zip(*angles(4), strict=True)):
        state = kit.state(START + k * PERIOD, *row)
        if k == changed:
            change(state)
        messages += [(topic, START + k * PERIOD, state) for topic in topics]
    return messages


REFUSED = {
    "several commands": (
        lambda path: _command_bag(path, COMMANDS["trajectory"], extra=NUMBERS),
        {},
        {"command_topic": "/command"},
        {"topic": "/more"},
        {"command_topic": "/commands"},
        {"command_topic": "/commands", "joint": "kneee"},
        {"episodes": "0"},
        {"joint": "hip"},
    ),
    "states as their own commands": (
        lambda path: _command_bag(path, COMMANDS["trajectory"]),
        {"topic": "/joint_states", "command_topic": "/joint_states"},
    ),
    "three numbers for two joints": (
        lambda path: _command_bag(path, lambda kit, _, row: kit.numbers([*row, 0.0])),
        {"joint": "hip"},
    ),
    "one number for two joints": (
        lambda path: _command_bag(path, lambda kit, _, row: kit.number(row[0])),
        {"joint": "all"},
    ),
    "two controllers": (_states(("/left", "/right")), {"joint": "hip"}),
    "nothing of joints": ([("/speed", START, Kit(store()).number(1.0))], {}),
    "no joint on both topics": (
        [*JOINT_STATES, ("/c", START, Kit(store()).trajectory(START, [0.0], ("tail",)))],
        {"joint": "hip"},
    ),
    "no commands": (JOINT_STATES, {}),
    "commands after all states": (
        [*JOINT_STATES, ("/c", START + 9, Kit(store()).numbers([0, 0]))],
        {"joint": "hip"},
    ),
    "too few angles in a message": (
        _states((STATE,), 2, lambda state: setattr(state.feedback, "positions", np.ones(1))),
        {"joint": "hip"},
    ),
    "a joint twice in a message": (
        _states((STATE,), 2, lambda state: setattr(state, "joint_names", ["hip"] * 2)),
        {"joint": "hip"},
    ),
    "a repeated time": (
        _states((STATE,), 3, lambda state: setattr(state, "header", EARLIER)),
        {"joint": "hip"},
    ),
}
"""Bags, by function or as messages, and options with which they cannot be read."""


def test_what_a_bag_does_not_tell_or_tells_wrongly_is_said_with_its_place(tmp_path, snapshot):
    cases = {}
    for k, (name, (bag, *asked)) in enumerate(REFUSED.items()):
        place = tmp_path / f"{k}"
        place = write(place, store(), bag) if isinstance(bag, list) else bag(place)
        cases |= {f"{name}, {options}": (place, options) for options in asked}
    snapshot.refusals("bags", lambda case: _read(case[0], **case[1]), cases, BAG=tmp_path)


def test_a_state_without_a_reading_is_not_measured_with_a_note(tmp_path):
    states = _states((STATE,), 2, lambda state: state.feedback.positions.put(1, np.nan))
    path = write(tmp_path / "bag", store(), states)
    (log,) = read_logs(path, options=LogOptions(joint="knee"))
    assert log.measured.tolist() == [True, True, False, True]
    assert "state 3: the angle is missing, only the request counts" in log.notes
    (whole,) = read_logs(path, options=LogOptions(joint="hip"))
    assert len(whole.times) == 4


def test_a_bag_that_is_cut_short_is_refused(tmp_path):
    path = _controller_bag(tmp_path / "run.bag", storage="ros1")
    path.write_bytes(path.read_bytes()[:10])
    with pytest.raises(InvalidFile, match=r"not a bag that can be read \(.*\); is it cut short\?$"):
        _read(path, joint="hip")
