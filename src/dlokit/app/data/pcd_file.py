"""Point Cloud Library files (.pcd, version 0.7): ascii, binary and binary_compressed.

Existing packages for this small format depend on a compiler or a data frame library. Only x, y and
z are read. Memory use is bounded by the size of the file and by what its header plausibly declares.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

LARGEST_HEADER_BYTES = 16_384
LARGEST_POINTS = 20_000_000
_KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


@dataclass(frozen=True, kw_only=True)
class _Header:
    names: tuple[str, ...]
    """Column names of a point, one per count of a field; x, y, z are among them."""
    dtype: np.dtype[np.void]
    """One point in the binary format."""
    points: int
    data: str
    body: bytes


def read_pcd(path: Path) -> Float64Array:
    """The points (N, 3) of a .pcd file, including those of unknown depth (NaN). Raises `InputError`."""
    header = _read_header(path)
    if header.data == "ascii":
        return _ascii(header, path)
    if header.data == "binary":
        return _columns(_records(header.body, header, path))
    return _columns(_compressed(header, path))


def _read_header(path: Path) -> _Header:
    content = path.read_bytes()
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = content.find(b"\n", at, LARGEST_HEADER_BYTES)
        if end < 0:
            raise InputError(f"{path} is not a .pcd file: its header has no DATA line; record or convert it again")
        words = content[at:end].decode("ascii", errors="replace").split()
        at = end + 1
        if words and not words[0].startswith("#") and words[0] in _KEYS:
            entries[words[0]] = words[1:]
    try:
        fields, kinds = entries["FIELDS"], entries["TYPE"]
        sizes = [int(size) for size in entries["SIZE"]]
        counts = [int(count) for count in entries.get("COUNT", ["1"] * len(fields))]
        width, height = int(entries["WIDTH"][0]), int(entries.get("HEIGHT", ["1"])[0])
        points = int(entries["POINTS"][0]) if "POINTS" in entries else width * height
        data = entries["DATA"][0]
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"{path} is not a .pcd file: its header has no valid {error}; convert it again") from error
    if not {"x", "y", "z"} <= set(fields) or not len(fields) == len(kinds) == len(sizes) == len(counts):
        raise InputError(f"{path}: its fields are {' '.join(fields)}; x, y and z are needed, each with SIZE and TYPE")
    if not 0 <= points <= LARGEST_POINTS:
        raise InputError(f"{path} declares {points} points; the limit is {LARGEST_POINTS}")
    if points != width * height:
        raise InputError(f"{path} declares POINTS {points}, but WIDTH x HEIGHT is {width * height}; convert it again")
    if data not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"{path}: DATA {data} is unknown; it must be ascii, binary or binary_compressed")
    names, formats = _layout(fields, kinds, sizes, counts, path)
    dtype = np.dtype({"names": list(names), "formats": formats})
    return _Header(names=names, dtype=dtype, points=points, data=data, body=content[at:])


def _layout(
    fields: list[str], kinds: list[str], sizes: list[int], counts: list[int], path: Path
) -> tuple[tuple[str, ...], list[str]]:
    """Names and NumPy formats of the columns of a point."""
    names: list[str] = []
    formats: list[str] = []
    for index, (field, kind, size, count) in enumerate(zip(fields, kinds, sizes, counts, strict=True)):
        if kind not in "FIU" or size not in (1, 2, 4, 8) or (kind == "F" and size < 4) or not 1 <= count <= 4096:
            raise InputError(f"{path}: field {field} of TYPE {kind}, SIZE {size}, COUNT {count} is unknown")
        for part in range(count):
            coordinate = field in ("x", "y", "z") and part == 0 and field not in names
            names.append(field if coordinate else f"{field}.{index}.{part}")  # padding fields share a name
            formats.append(f"<{kind.lower()}{size}")
    return tuple(names), formats


def _ascii(header: _Header, path: Path) -> Float64Array:
    columns = [header.names.index(axis) for axis in "xyz"]
    rows: list[list[float]] = []
    for line in header.body.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        try:
            rows.append([float(words[column]) for column in columns])
        except (ValueError, IndexError):
            raise InputError(f"{path}: point {len(rows) + 1} is {line[:60]!r}, not a number for each field") from None
    if len(rows) != header.points:
        raise InputError(
            f"{path} declares {header.points} points and has {len(rows)}; it is truncated or damaged, record it again"
        )
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _records(data: bytes, header: _Header, path: Path) -> NDArray[np.void]:
    wanted = header.points * header.dtype.itemsize
    if len(data) < wanted:
        raise InputError(f"{path} needs {wanted} bytes of points and has {len(data)}; it is truncated, record it again")
    return np.frombuffer(data, dtype=header.dtype, count=header.points)


def _compressed(header: _Header, path: Path) -> NDArray[np.void]:
    """binary_compressed: two sizes, then the values of the first field, of the second, and so on, in LZF."""
    if len(header.body) < 8:
        raise InputError(f"{path} ends after its header; record it again")
    packed, full = (int(size) for size in np.frombuffer(header.body, dtype="<u4", count=2))
    wanted = header.points * header.dtype.itemsize
    if full != wanted or packed > len(header.body) - 8:
        raise InputError(
            f"{path}: {packed} packed bytes for {full} unpacked ones do not match its {header.points} points; "
            f"it is truncated or corrupt, record it again"
        )
    data = _lzf(header.body[8 : 8 + packed], full, path)
    records = np.empty(header.points, dtype=header.dtype)
    at = 0
    for name in header.names:
        column = np.frombuffer(data, dtype=header.dtype[name], count=header.points, offset=at)
        records[name] = column
        at += column.nbytes
    return records


def _lzf(packed: bytes, size: int, path: Path) -> bytes:
    """Decompress LZF to exactly `size` bytes: literal runs, and references to previous output."""
    out = bytearray()
    at = 0
    try:
        while at < len(packed) and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                raise IndexError
            for index in range(start, start + length + 2):  # may read the bytes just written
                out.append(out[index])
    except IndexError:
        raise InputError(f"{path}: its compressed points are corrupt; record it again") from None
    if len(out) != size:
        raise InputError(f"{path} unpacks to {len(out)} bytes instead of {size}; it is corrupt, record it again")
    return bytes(out)


def _columns(records: NDArray[np.void]) -> Float64Array:
    return np.column_stack([records[axis].astype(np.float64) for axis in "xyz"]).reshape(-1, 3)
