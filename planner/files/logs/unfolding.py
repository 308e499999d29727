"""How much the chunks of a bag unfold to, found out piece by piece before any is held whole."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from planner.exceptions import InvalidFile

MOST_CHUNK = 256 * 2**20
"""Largest chunk that is unfolded [bytes]: recorders begin a new one after a few megabytes."""

MOST_TIMES = 200
"""All chunks of a file that is not small unfold to this many times its size at most."""

PIECE = 2**20
"""What is unfolded at once [bytes]."""

MCAP, ROS1 = b"\x89MCAP0\r\n", b"#ROSBAG V"
"""What the two formats with chunks begin with."""

_CHUNK = 6  # the record's code in MCAP
_ROS1_CHUNK = b"op=\x05"

Chunk = tuple[str, bytes]
"""Name of the compression, and what is compressed."""


def check_unfolding(path: Path | str) -> None:
    """Refuse a bag with chunks that unfold to very much more than they are.

    Args:
        path: An MCAP file, a bag of ROS 1, or a folder with MCAP files; of others nothing is read.

    Raises:
        InvalidFile: A chunk, or all of them together, would take too much memory or time.
    """
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
    """To how many bytes a chunk unfolds; of more than :data:`MOST_CHUNK` the rest is not counted.

    What is cut short, or compressed in an unknown way, counts as far as it goes: its reader tells.
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
        if code == _CHUNK:
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
        if _ROS1_CHUNK in header:
            _, _, compression = header.partition(b"compression=")
            yield compression[:3].decode(errors="replace"), stream.read(min(length, MOST_CHUNK + 1))
        stream.seek(end)


def _sized(stream: BinaryIO, form: str, most: int) -> bytes:
    """What stands after its own length, ``most`` bytes of it at most."""
    head = stream.read(struct.calcsize(form))
    (length,) = struct.unpack(form, head)
    return stream.read(min(length, most))
