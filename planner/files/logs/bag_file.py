"""Messages of ROS bags and MCAP files, read by rosbags; a damaged or hostile file is one error.

rosbags' own readers are used, one topic at a time. Its ``AnyReader`` is not: it refuses a bag for
an unreadable definition of a type on any topic, or one with another hash, and it supports only one
layout of a type that a bag does not define.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from planner.exceptions import InvalidFile, PlannerError, importing

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

LATEST = 2**63  # stamps from here on [ns] are invalid
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
MOST_TIMES = 1000
"""Chunks of a bag that is not small unfold to this many times its size at most, counted once for
each topic that is read. Names that repeat in every message unfold to some 50 times."""

MOST_CHUNK = 256 * 2**20
"""Largest chunk that is unfolded [bytes]: recorders begin a new one after a few megabytes. rosbags
has no limit: 33 kB of MCAP take 2 GiB of memory, 5 kB of a bag of ROS 1 take 1 GiB."""


LAYOUTS = tuple(
    "\n".join(
        [
            "std_msgs/Header header",
            "string[] joint_names",
            *(f"trajectory_msgs/JointTrajectoryPoint {name}" for name in points.split()),
            *(["string[] multi_dof_joint_names"] if multi_dof else []),
            *(
                f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}"
                for name in (points.split() if multi_dof else ())
            ),
        ]
    )
    for points, multi_dof in (
        ("desired actual error", False),
        ("reference feedback error output desired actual", True),
        ("reference feedback error output", True),
    )
)
"""Layouts of a controller's state: up to Galactic, in Humble, and since Iron.

A bag without definitions of its types, as ROS 2 wrote them before Iron, does not say which one it
holds. Only the right one explains all the bytes of a message.
"""


@dataclass(frozen=True)
class Bag:
    """An open bag, and the type of every topic."""

    path: Path
    topics: Mapping[str, str]
    _reader: Any
    _ros1: bool

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """The messages of a topic, in order of receipt: the time of it [ns], and the fields."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        kind, stores = self.topics[topic], _stores(connections)
        for k, (_, when, data) in enumerate(self._reader.messages(connections=connections)):
            place = f"topic {topic}, message {k + 1}"
            if not 0 <= when < LATEST:
                raise InvalidFile(self.path, f"{place}: received at {when} ns, expected a time")
            content = None
            while content is None:
                decode = stores[0].deserialize_ros1 if self._ros1 else stores[0].deserialize_cdr
                try:
                    content = decode(data, kind)
                except Exception as error:
                    if len(stores) == 1:
                        raise InvalidFile(
                            self.path, f"{place}: no {kind} ({_words(error)}); is the bag damaged?"
                        ) from error
                    del stores[0]  # the bag was recorded with another layout of this type
            yield when, content


@contextmanager
def open_bag(path: Path | str) -> Iterator[Bag]:
    """Open a bag of ROS 1, of ROS 2 (folder or a single file of it), or an MCAP file.

    Errors of rosbags, SQLite, YAML or a decoder for a damaged bag become one error.
    """
    with importing("reading bags", "bags"):
        from rosbags import rosbag1, rosbag2
    place = Path(path)
    ros1 = place.suffix.lower() == ".bag"
    if not place.exists():
        raise InvalidFile(path, "no such file; check the name and the folder")
    try:
        of_format: Any = (rosbag1 if ros1 else rosbag2).Reader
        with _limited(path), of_format(place) as reader:
            topics = {connection.topic: connection.msgtype for connection in reader.connections}
            yield Bag(place, topics, reader, ros1)
    except PlannerError:
        raise
    except Exception as error:
        raise InvalidFile(
            path, f"not a bag that can be read ({_words(error)}); is it cut short?"
        ) from error


def _stores(connections: Sequence[Connection]) -> list[Typestore]:
    """Stores of types to try, in this order: the bag's own types, or the default ones."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    own: dict[str, Any] = {}
    for connection in connections:
        form, text = connection.msgdef.format, connection.msgdef.data
        if form == MessageDefinitionFormat.MSG:
            own.update(get_types_from_msg(text, connection.msgtype))
        elif form == MessageDefinitionFormat.IDL:
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                own.update(get_types_from_idl(part) if part.strip() else {})
    if own:
        stores = [get_typestore(Stores.EMPTY)]
        stores[0].register(own)
    else:
        stores = [get_typestore(Stores.LATEST) for _ in LAYOUTS]  # ROS 1 always has its own
        for store, layout in zip(stores, LAYOUTS, strict=True):
            store.register(get_types_from_msg(layout, CONTROLLER_STATE))
        if connections[0].msgtype != CONTROLLER_STATE:
            del stores[1:]
    for store in stores:
        # an array of 2^32 empty messages takes no bytes, and rosbags more than 15 s
        store.max_sequence_length = 1_000_000
    return stores


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


@contextmanager
def _limited(path: Path | str) -> Iterator[None]:
    """Let rosbags refuse what unfolds to too much while this bag is open.

    Each chunk or compressed message unfolds to :data:`MOST_CHUNK` at most, all together, and files
    that are compressed as a whole, to four times that or :data:`MOST_TIMES` the size of the bag.
    rosbags finds its decompressors in tables of its modules, which this changes inside the block
    only.
    """
    import bz2

    import lz4.frame  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as ros1_reader
    from rosbags.rosbag2 import reader as ros2_reader
    from rosbags.rosbag2 import storage_mcap

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    files = [Path(path), *Path(path).glob("*")]
    most = max(
        4 * MOST_CHUNK, MOST_TIMES * sum(each.stat().st_size for each in files if each.is_file())
    )
    total = 0

    def count(unfolded: bytes) -> bytes:
        nonlocal total
        total += len(unfolded)
        if total > most:
            raise InvalidFile(
                path, f"unfolds to more than {most >> 20} MiB; split the bag if it is one"
            )
        return unfolded

    def opened(stream: Any, _: str) -> Any:
        """A compressed file, unfolded a piece at a time."""
        file = zstd.open(stream)
        return closing(SimpleNamespace(read=lambda size: count(file.read(size)), close=file.close))

    def limited(begin: Callable[[], Any], what: str = "a chunk") -> Callable[..., bytes]:
        def unfold(content: bytes, *_: int) -> bytes:
            whole = b""
            while content:  # one frame after another
                frame = begin()
                whole += frame.decompress(content, MOST_CHUNK + 1 - len(whole))
                if len(whole) > MOST_CHUNK:
                    raise InvalidFile(
                        path, f"{what} unfolds to more than {MOST_CHUNK >> 20} MiB; is it a bag?"
                    )
                if not frame.eof:
                    raise ValueError(f"{what} ends too soon")
                content = frame.unused_data
            return count(whole)

        return unfold

    lz4_frames = limited(lz4.frame.LZ4FrameDecompressor)
    messages = limited(zstd.ZstdDecompressor, "a message")
    tables: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
        (ros1_reader.decompressors, {"lz4": lz4_frames, "bz2": limited(bz2.BZ2Decompressor)}),
        (storage_mcap.DECOMPRESSORS, {"lz4": lz4_frames, "zstd": limited(zstd.ZstdDecompressor)}),
        (vars(ros2_reader), {"zstd": SimpleNamespace(open=opened, decompress=messages)}),
    )
    with ExitStack() as before:
        for table, entries in tables:
            before.callback(table.update, {key: table[key] for key in entries})
            table.update(entries)
        yield
