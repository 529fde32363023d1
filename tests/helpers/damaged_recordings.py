"""Recordings as they come from a disk with errors or an incomplete copy."""

from pathlib import Path

from mcap.records import Chunk
from mcap.stream_reader import StreamReader


def chunks_of(path: Path) -> list[Chunk]:
    """The chunks of a file, in order."""
    with path.open("rb") as stream:
        return [record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)]


def with_a_wrong_bit(path: Path, chunk: int, copy: Path) -> Path:
    """A copy in which one bit in the middle of a chunk is wrong."""
    data, content = bytearray(path.read_bytes()), chunks_of(path)[chunk].data
    data[data.index(content) + len(content) // 2] ^= 1
    copy.write_bytes(data)
    return copy


def cut_after(path: Path, fraction: float, copy: Path) -> Path:
    """A copy of the first part of a file."""
    data = path.read_bytes()
    copy.write_bytes(data[: int(fraction * len(data))])
    return copy
