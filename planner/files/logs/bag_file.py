"""Messages of ROS bags and MCAP files, read by rosbags; a damaged or hostile file is one error.

rosbags' own readers are used, one topic at a time. Its ``AnyReader`` is not: it refuses a bag for
an unreadable definition of a type on any topic, or one with another hash, and it supports only one
layout of a type that a bag does not define.
"""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from planner.exceptions import InvalidFile, importing

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

LATEST = 2**63
"""Stamps from here on [ns] are invalid."""

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"

LONGEST = 1_000_000
"""Longest array in a message that is read: one of 2^32 empty messages takes no bytes, and rosbags
more than 15 s."""

MOST_CHUNK = 256 * 2**20
"""Largest chunk that is unfolded [bytes]: recorders begin a new one after a few megabytes. rosbags
has no limit: 33 kB of MCAP take 2 GiB of memory, 5 kB of a bag of ROS 1 take 1 GiB."""

MOST_TIMES = 200
"""All chunks of a file that is not small unfold to this many times its size at most."""

PIECE = 2**20
"""Size of a piece that is unfolded at once [bytes]."""

MCAP, ROS1 = b"\x89MCAP0\r\n", b"#ROSBAG V"
"""First bytes of the two formats with chunks."""


def _layout(points: str, multi_dof_points: str = "") -> str:
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"trajectory_msgs/JointTrajectoryPoint {name}" for name in points.split()]
    if multi_dof_points:
        lines.append("string[] multi_dof_joint_names")
    lines += [
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}"
        for name in multi_dof_points.split()
    ]
    return "\n".join(lines)


LAYOUTS = (
    _layout("desired actual error"),
    _layout(*("reference feedback error output desired actual",) * 2),
    _layout(*("reference feedback error output",) * 2),
)
"""Layouts of a controller's state: up to Galactic, in Humble, and since Iron.

A bag without definitions of its types, as ROS 2 wrote them before Iron, does not say which one it
holds. Only the right one explains all the bytes of a message.
"""


Chunk = tuple[str, bytes]
"""Name of the compression, and the compressed bytes."""


@dataclass(frozen=True)
class Bag:
    """An open bag, and the type of every topic."""

    path: Path
    topics: Mapping[str, str]
    _reader: Any
    _ros1: bool

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """The messages of a topic, in order of receipt: the time of it [ns], and the fields."""
        connections = [
            connection for connection in self._reader.connections if connection.topic == topic
        ]
        kind = self.topics[topic]
        with _damage_reported(self.path):
            stores = _stores(connections)
            messages = self._reader.messages(connections=connections)
            for k, (_, when, data) in enumerate(messages):
                place = f"topic {topic}, message {k + 1}"
                if not 0 <= when < LATEST:
                    raise InvalidFile(self.path, f"{place}: received at {when} ns, expected a time")
                yield when, self._decode(stores, data, kind, place)

    def _decode(self, stores: list[Typestore], data: bytes, kind: str, place: str) -> Any:
        """The message by the first store of types that explains all of its bytes."""
        while True:
            decode = stores[0].deserialize_ros1 if self._ros1 else stores[0].deserialize_cdr
            try:
                return decode(data, kind)
            except Exception as error:
                if len(stores) == 1:
                    raise InvalidFile(
                        self.path, f"{place}: no {kind} ({_words(error)}); is the bag damaged?"
                    ) from error
                del stores[0]  # the bag was recorded with another layout of this type


@contextmanager
def open_bag(path: Path | str) -> Iterator[Bag]:
    """Open a bag of ROS 1, of ROS 2 (folder or a single file of it), or an MCAP file."""
    with importing("reading bags", "bags"):
        from rosbags import rosbag1, rosbag2
    place = Path(path)
    ros1 = place.suffix.lower() == ".bag"
    if not place.exists():
        raise InvalidFile(path, "no such file; check the name and the folder")
    with _damage_reported(path):
        check_unfolding(path)
        reader: Any = rosbag1.Reader(place) if ros1 else rosbag2.Reader(place)
        reader.open()
    try:
        topics = {connection.topic: connection.msgtype for connection in reader.connections}
        yield Bag(place, topics, reader, ros1)
    finally:
        with _damage_reported(path):
            reader.close()


@contextmanager
def _damage_reported(path: Path | str) -> Iterator[None]:
    """Turn errors of rosbags, SQLite, YAML or a decoder for a damaged bag into one error."""
    try:
        yield
    except InvalidFile:
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
        store.max_sequence_length = LONGEST
    return stores


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def check_unfolding(path: Path | str) -> None:
    """Refuse MCAP or a bag of ROS 1 with chunks that unfold to many times their size."""
    place = Path(path)
    for file in sorted(place.glob("*.mcap")) if place.is_dir() else [place]:
        if file.suffix.lower() == ".mcap":
            _check(path, file, _mcap_chunks)
        elif file.suffix.lower() == ".bag":
            _check(path, file, _ros1_chunks)


def _check(path: Path | str, file: Path, chunks: Callable[[BinaryIO], Iterator[Chunk]]) -> None:
    most = max(MOST_CHUNK, MOST_TIMES * file.stat().st_size)
    total = 0
    with file.open("rb") as stream:
        for compression, content in chunks(stream):
            size = unfolded(compression, content)
            total += size
            if size > MOST_CHUNK or total > most:
                limit = (MOST_CHUNK if size > MOST_CHUNK else most) >> 20
                raise InvalidFile(
                    path, f"its chunks unfold to more than {limit} MiB; split the bag if it is one"
                )


def unfolded(compression: str, content: bytes) -> int:
    """Unfolded size of a chunk [bytes]; counting ends soon after :data:`MOST_CHUNK`.

    A chunk that is cut short counts as far as it goes, one of unknown compression as it is; rosbags
    refuses both.
    """
    begin = _unfolders().get(compression)
    if begin is None or len(content) > MOST_CHUNK:
        return len(content)
    total = 0
    while content and total <= MOST_CHUNK:  # one frame after another
        unfolder = begin()
        total += len(unfolder.decompress(content, PIECE))
        while not (unfolder.eof or unfolder.needs_input) and total <= MOST_CHUNK:
            total += len(unfolder.decompress(b"", PIECE))
        content = unfolder.unused_data if unfolder.eof else b""
    return total


def _unfolders() -> dict[str, Callable[[], Any]]:
    import bz2

    import lz4.frame  # type: ignore[import-untyped]

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return {
        "zstd": zstd.ZstdDecompressor,
        "lz4": lz4.frame.LZ4FrameDecompressor,
        "bz2": bz2.BZ2Decompressor,
    }


def _mcap_chunks(stream: BinaryIO) -> Iterator[Chunk]:
    """Chunks of an MCAP file: code, length, times, size, checksum, compression, content."""
    if stream.read(len(MCAP)) != MCAP:
        return
    while len(head := stream.read(9)) == 9:
        code, length = struct.unpack("<BQ", head)
        end = stream.tell() + length
        if code == 6:  # a chunk
            stream.seek(28, 1)
            compression = _sized(stream, "<I", 64).decode(errors="replace")
            yield compression, _sized(stream, "<Q", MOST_CHUNK + 1)
        stream.seek(end)


def _ros1_chunks(stream: BinaryIO) -> Iterator[Chunk]:
    """Chunks of a bag of ROS 1: records of a header of fields, and of data."""
    magic = stream.read(64)
    if not magic.startswith(ROS1) or b"\n" not in magic:
        raise ValueError("File magic is invalid.")  # its reader would look for the end of the line
    stream.seek(magic.index(b"\n") + 1)
    while len(head := stream.read(4)) == 4:
        header = stream.read(min(struct.unpack("<I", head)[0], PIECE))
        (length,) = struct.unpack("<I", stream.read(4).ljust(4, b"\0"))
        end = stream.tell() + length
        if b"op=\x05" in header:  # a chunk
            _, _, compression = header.partition(b"compression=")
            yield compression[:3].decode(errors="replace"), stream.read(min(length, MOST_CHUNK + 1))
        stream.seek(end)


def _sized(stream: BinaryIO, form: str, most: int) -> bytes:
    """The bytes after their own length, ``most`` of them at most."""
    head = stream.read(struct.calcsize(form))
    (length,) = struct.unpack(form, head)
    return stream.read(min(length, most))
