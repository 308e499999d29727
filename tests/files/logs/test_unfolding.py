"""What chunks of bags unfold to is known before they are held; whole bags pass."""

from __future__ import annotations

import bz2
import sys

import pytest

pytest.importorskip("rosbags", reason="needs the extra bags")

import lz4.frame

from planner import InvalidFile, LogOptions, read_logs
from planner.files.logs import bag_file
from planner.files.logs.bag_file import check_unfolding, unfolded
from tests.files.logs.bags import START, Kit, only_file, store, write

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

TEXT = bytes(range(256)) * 10**4


@pytest.mark.parametrize(
    ("name", "compress"),
    [("zstd", zstd.compress), ("lz4", lz4.frame.compress), ("bz2", bz2.compress)],
)
def test_every_frame_counts_and_what_is_cut_short_as_far_as_it_goes(name, compress, monkeypatch):
    content = compress(TEXT)
    assert unfolded(name, content) == len(TEXT)
    assert unfolded(name, 3 * content) == 3 * len(TEXT)
    assert unfolded(name, content[: len(content) // 2]) <= len(TEXT)
    monkeypatch.setattr(bag_file, "MOST_CHUNK", len(TEXT))
    assert len(TEXT) < unfolded(name, 100 * content) <= 2 * len(TEXT)


def test_what_is_not_compressed_is_as_long_as_it_is():
    assert unfolded("", TEXT) == len(TEXT)
    assert unfolded("rar", TEXT) == len(TEXT)


@pytest.mark.parametrize("storage", ["mcap", "ros1"])
def test_a_whole_bag_passes_and_one_of_many_large_chunks_does_not(tmp_path, storage, monkeypatch):
    types = store(ros1=storage == "ros1")
    kit = Kit(types)
    states = [
        ("/s", START + k, kit.state(START + k, [0.1 * k, 0.2], [0.1, 0.2])) for k in range(40)
    ]
    if storage == "ros1":
        from rosbags import rosbag1

        how = (rosbag1.Writer.CompressionFormat.BZ2,)
    else:
        from rosbags import rosbag2

        how = (rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    bag = write(tmp_path / "it.bag", types, states, storage=storage, compression=how)
    file = bag if storage == "ros1" else only_file(bag, ".mcap")
    check_unfolding(bag)
    check_unfolding(file)
    assert len(read_logs(file, options=LogOptions(joint="all"))) == 2
    monkeypatch.setattr(bag_file, "MOST_CHUNK", 100)
    for path in (bag, file):
        with pytest.raises(InvalidFile, match="its chunks unfold to more than 0 MiB"):
            check_unfolding(path)
        with pytest.raises(InvalidFile, match="its chunks unfold to more than 0 MiB"):
            read_logs(path, options=LogOptions(joint="all"))
    monkeypatch.undo()
    monkeypatch.setattr(bag_file, "MOST_TIMES", 0)
    monkeypatch.setattr(bag_file, "MOST_CHUNK", 10**5)
    check_unfolding(file)
