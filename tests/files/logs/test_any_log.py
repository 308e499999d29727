"""Whatever bytes a log holds, it is read or refused with one line; nothing else ever happens."""

from __future__ import annotations

import json
import re
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import InvalidInput, LogOptions, read_logs
from tests.files.logs.bags import START, Kit, only_file, store, write
from tests.files.logs.datasets import v21

CSV_PIECES = st.sampled_from(
    [
        *("t_s", "time_ns", "clock", "req_deg", "act_deg", "goal [rad]", "pos (rad)", "torque_on"),
        *("req_a", "act_a", "0", "1", "-2.5", "1e3", "1e999", "nan", "1_0", "٣", "true"),
        *("1732104192123456789", "1732104192123456790"),
        *",,,,,\n\n\n;;\t\r\0 \"'\ufeff",
    ]
)
JSON_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(), inner)),
    max_leaves=8,
)
ENTRIES = st.fixed_dictionaries(
    {"timestamp": JSON_VALUES, "goal_position": JSON_VALUES, "position": JSON_VALUES},
    optional={"torque_enable": JSON_VALUES},
)
CHANGES = st.lists(st.tuples(st.integers(min_value=0), st.integers(0, 255)), max_size=6)
"""Places and bytes that are put there."""


def _read(path, content, **options):
    path.write_bytes(content)
    try:
        logs = read_logs(path, options=LogOptions(**options))
    except InvalidInput as error:
        message = str(error)
        assert "\n" not in message
        assert message.startswith(str(path)), message
        return
    for log in logs:
        assert np.isfinite(log.requests).all()
        assert (np.diff(log.times) > 0).all()


def _damaged(content, changes, cut):
    damaged = bytearray(content)
    for place, byte in changes:
        damaged[place % len(damaged)] = byte
    return bytes(damaged[: len(damaged) - cut % len(damaged)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("any")


@settings(max_examples=100)
@given(
    content=st.one_of(
        st.binary(max_size=200), st.lists(CSV_PIECES, max_size=60).map("".join).map(str.encode)
    ),
    unit=st.sampled_from([None, "rad", "range"]),
)
def test_any_bytes_are_a_csv_log_or_bad_input(folder, content, unit):
    _read(folder / "log.csv", content, unit=unit, joint="all")


@settings(max_examples=80)
@given(
    content=st.one_of(
        st.binary(max_size=200),
        JSON_VALUES.map(json.dumps).map(str.encode),
        st.lists(st.one_of(ENTRIES, JSON_VALUES), max_size=5)
        .map(lambda entries: json.dumps({"entries": entries}))
        .map(str.encode),
    )
)
def test_any_bytes_are_a_bam_log_or_bad_input(folder, content):
    _read(folder / "log.json", content)


@pytest.fixture(scope="module")
def dataset(folder):
    return v21(folder / "set")


@settings(max_examples=40)
@given(changes=CHANGES, cut=st.sampled_from([0, 0, 0, 1, 100, 10**6 + 7]))
def test_a_damaged_parquet_file_is_read_or_refused(dataset, changes, cut):
    file = dataset / "data" / "chunk-000" / "episode_000000.parquet"
    whole = (dataset / "data" / "chunk-000" / "episode_000001.parquet").read_bytes()
    _read(file, _damaged(whole, changes, cut), joint="all", unit="deg")


@settings(max_examples=40)
@given(described=JSON_VALUES, names=JSON_VALUES)
def test_any_description_of_a_dataset_is_read_or_refused(dataset, described, names):
    file = dataset / "meta" / "info.json"
    whole = file.read_bytes()
    features = {"action": {"names": names}, "observation.state": {"names": names}}
    try:
        for content in (described, {"codebase_version": "v3.0", "features": features}):
            file.write_text(json.dumps(content))
            with suppress(InvalidInput):
                read_logs(dataset, options=LogOptions(joint="all", unit="deg", episodes="1"))
    finally:
        file.write_bytes(whole)


@pytest.fixture(scope="module", params=["db3", "mcap", "bag"])
def bag(request, folder):
    """Bytes of a short bag, and a file of its kind to damage."""
    types = store(ros1=request.param == "bag")
    kit = Kit(types)
    messages = [
        ("/s", START + k, kit.state(START + k, [0.1 * k, 0.2], [0.1, 0.2])) for k in range(4)
    ]
    if request.param == "bag":
        whole = write(folder / "whole.bag", types, messages, storage="ros1")
    else:
        storage = "sqlite3" if request.param == "db3" else "mcap"
        run = write(folder / request.param, types, messages, storage=storage)
        whole = only_file(run, f".{request.param}")
    return whole.read_bytes(), folder / f"damaged.{request.param}"


@settings(max_examples=40)
@given(changes=CHANGES, cut=st.sampled_from([0, 0, 0, 1, 100, 10**6 + 7]))
def test_a_damaged_bag_is_read_or_refused(bag, changes, cut):
    whole, file = bag
    _read(file, _damaged(whole, changes, cut), joint="all")


@settings(max_examples=40)
@given(content=st.binary(max_size=100))
def test_any_bytes_are_a_bag_or_bad_input(bag, content):
    _, file = bag
    _read(file, content, joint="all")


def test_any_bytes_are_the_description_of_a_bag_or_bad_input(folder):
    types = store()
    messages = [("/s", START, Kit(types).state(START, [0.0, 0.0], [0.0, 0.0]))]
    run = write(folder / "described", types, messages)
    whole = (run / "metadata.yaml").read_bytes()
    for end in range(0, len(whole), 97):
        for damaged in (whole[:end], whole[:end] + b"\x00[" + whole[end:]):
            (run / "metadata.yaml").write_bytes(damaged)
            with pytest.raises(InvalidInput) as caught:
                read_logs(run, options=LogOptions(joint="all"))
            assert "\n" not in str(caught.value)
    no_list = re.sub(rb"(?m)^  files:.*\n(  ?-.*\n|    .*\n)*", b"  files: a\n", whole)
    assert no_list != whole
    (run / "metadata.yaml").write_bytes(no_list)
    with pytest.raises(InvalidInput, match="not a bag that can be read"):
        read_logs(run, options=LogOptions(joint="all"))
