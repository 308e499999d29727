"""Messages of ROS bags and MCAP files; whatever is wrong with a file becomes one kind of error."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from planner.exceptions import InvalidFile, MissingExtra
from planner.files.logs.controller_state import CONTROLLER_STATE, LAYOUTS
from planner.files.logs.unfolding import check_unfolding

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

LATEST = 2**63
"""Times from here on [ns] are no times."""

MOST_MESSAGES = 5_000_000
"""Messages that are read from one topic: an hour at 1 kHz and more."""

LONGEST = 1_000_000
"""Longest array in a message that is believed."""

_UNEXPECTED: tuple[type[Exception], ...] = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError),
    *(NotImplementedError, OSError, RuntimeError, SyntaxError, TypeError, ValueError),
    *(StopIteration, struct.error),
)
"""What readers and decoders raise for bytes that they did not expect."""

_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


class Message(NamedTuple):
    """A message and when it came.

    Attributes:
        received: When the recorder received it [ns].
        content: Its fields.
    """

    received: int
    content: Any


@dataclass(frozen=True)
class Bag:
    """An open bag.

    Attributes:
        path: The file or folder.
        topics: Type of every topic.
    """

    path: Path
    topics: Mapping[str, str]
    _reader: Any
    _ros1: bool

    def messages(self, topic: str) -> Iterator[Message]:
        """The messages of a topic, in the order in which they came.

        Raises:
            InvalidFile: A type is not known, a message is damaged, or there are too many.
        """
        connections = [found for found in self._reader.connections if found.topic == topic]
        kind = self.topics[topic]
        with _damage_told(self.path):
            stores = _stores(self.path, connections, ros1=self._ros1)
            received = self._reader.messages(connections=connections)
            for k, (_, when, data) in enumerate(received):
                if k >= MOST_MESSAGES:
                    raise InvalidFile(
                        self.path,
                        f"topic {topic}: more than {MOST_MESSAGES} messages; split the bag",
                    )
                place = f"topic {topic}, message {k + 1}"
                if not 0 <= when < LATEST:
                    raise InvalidFile(self.path, f"{place}: received at {when} ns, expected a time")
                yield Message(when, self._decode(stores, data, kind, place))

    def _decode(self, stores: list[Typestore], data: bytes, kind: str, place: str) -> Any:
        """The message by the first store of types that explains all of its bytes."""
        from rosbags.serde import SerdeError

        faults: tuple[type[Exception], ...] = (SerdeError, *_UNEXPECTED)
        while True:
            decode = stores[0].deserialize_ros1 if self._ros1 else stores[0].deserialize_cdr
            try:
                return decode(data, kind)
            except faults as error:
                if len(stores) == 1:
                    raise InvalidFile(
                        self.path, f"{place}: no {kind} ({_words(error)}); is the bag damaged?"
                    ) from error
                del stores[0]  # the bag was recorded with another layout of this type


@contextmanager
def open_bag(path: Path | str) -> Iterator[Bag]:
    """Open a bag of ROS 1, of ROS 2 (folder or a single file of it), or an MCAP file.

    Raises:
        InvalidFile: It is none, or is damaged.
        MissingExtra: rosbags is not installed.
    """
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise MissingExtra("reading bags", "bags") from error
    place = Path(path)
    ros1 = place.suffix.lower() == ".bag"
    if not place.exists():
        raise InvalidFile(path, "no such file; check the name and the folder")
    with _damage_told(path):
        check_unfolding(path)
        reader: Any = rosbag1.Reader(place) if ros1 else rosbag2.Reader(place)
        reader.open()
    try:
        topics = {found.topic: found.msgtype for found in reader.connections}
        yield Bag(place, topics, reader, ros1)
    finally:
        with _damage_told(path):
            reader.close()


@contextmanager
def _damage_told(path: Path | str) -> Iterator[None]:
    """Turn whatever a damaged bag makes its reader raise into InvalidFile."""
    import apsw
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import TypesysError
    from ruamel.yaml.error import YAMLError

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    own: tuple[type[Exception], ...] = (rosbag1.ReaderError, rosbag2.ReaderError, TypesysError)
    below: tuple[type[Exception], ...] = (YAMLError, apsw.Error, zstd.ZstdError)
    try:
        yield
    except InvalidFile:
        raise
    except (*own, *below, *_UNEXPECTED) as error:
        raise InvalidFile(
            path, f"not a bag that can be read ({_words(error)}); is it cut short?"
        ) from error


def _stores(path: Path, connections: Sequence[Connection], *, ros1: bool) -> list[Typestore]:
    """Types to try, in this order: the bag's own, or those that are known without them."""
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    own = _own_types(path, connections)
    if own:
        store = get_typestore(Stores.EMPTY)
        store.max_sequence_length = LONGEST
        try:
            store.register(own)
        except TypesysError as error:
            raise InvalidFile(path, f"definitions of types: {_words(error)}") from error
        return [store]
    known = [get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST) for _ in LAYOUTS]
    for store, layout in zip(known, LAYOUTS, strict=True):
        store.max_sequence_length = LONGEST
        store.register(get_types_from_msg(layout, CONTROLLER_STATE))
    return known if connections[0].msgtype == CONTROLLER_STATE else known[:1]


def _own_types(path: Path, connections: Sequence[Connection]) -> Any:
    """Types that the bag itself defines.

    rosbags makes code of them, so that nothing but plain names may go in.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    types: dict[str, Any] = {}
    for connection in connections:
        form, text = connection.msgdef.format, connection.msgdef.data
        if form == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(text, connection.msgtype))
        elif form == MessageDefinitionFormat.IDL:
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                types.update(get_types_from_idl(part) if part.strip() else {})
    for name, (constants, fields) in types.items():
        inner = [part for _, kind in fields for part in _names(kind)]
        plain = all(_TYPE_NAME.fullmatch(found) for found in (name, *inner)) and all(
            _FIELD_NAME.fullmatch(found[0]) for found in (*constants, *fields)
        )
        if not plain:
            raise InvalidFile(path, f"definition of type {name!r:.60}: expected plain names")
    return types


def _names(kind: Any) -> Iterator[str]:
    """The names of types within a field's type."""
    for part in kind[1:]:
        if isinstance(part, str):
            yield part
        elif isinstance(part, tuple):
            yield from _names((None, *part))


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
