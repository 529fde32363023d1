"""Recorded clouds: .pcd, .ply, .npy and .csv files as points in metres.

Only x, y and z of the element ``vertex`` are read. Nothing is allocated beyond what the file holds.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.app.data.pcd_file import read_pcd
from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

LARGEST_HEADER_BYTES = 65_536
LARGEST_POINTS = 20_000_000
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}


@dataclass(frozen=True, kw_only=True)
class _Header:
    form: str
    """A key of `_ORDERS`."""
    points: int
    names: tuple[str, ...]
    """Properties of a vertex, in order."""
    types: tuple[str, ...]
    body: bytes


def read_ply(path: Path) -> Float64Array:
    """The vertices (N, 3) of a .ply file. Raises `InputError`."""
    header = _read_header(path)
    if header.form == "ascii":
        return _ascii(header, path)
    order = _ORDERS[header.form]
    formats = [order + _TYPES[kind] for kind in header.types]
    dtype = np.dtype({"names": list(header.names), "formats": formats})
    if len(header.body) < header.points * dtype.itemsize:
        raise InputError(f"{path} promises {header.points} vertices and is cut before the last; record it again")
    records = np.frombuffer(header.body, dtype=dtype, count=header.points)
    return np.column_stack([records[axis].astype(np.float64) for axis in "xyz"]).reshape(-1, 3)


def _read_header(path: Path) -> _Header:
    content = path.read_bytes()
    end = content.find(b"end_header", 0, LARGEST_HEADER_BYTES)
    if not content.startswith(b"ply") or end < 0:
        raise InputError(f"{path} is no .ply file: it has no header from 'ply' to 'end_header'; convert it again")
    body_at = content.find(b"\n", end) + 1 or len(content)
    lines = [line.split() for line in content[:end].decode("ascii", errors="replace").splitlines()]
    form, element, points = "", "", -1
    properties: list[tuple[str, str]] = []
    for words in lines:
        if len(words) >= 2 and words[0] == "format":
            form = words[1]
        elif len(words) == 3 and words[0] == "element":
            if element == "" and words[1] != "vertex":
                raise InputError(f"{path}: its first element is {words[1]}; 'vertex' must come first: convert it")
            element = words[1]
            if element == "vertex":
                points = int(words[2]) if words[2].isdigit() else -1
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise InputError(f"{path}: vertex property {' '.join(words[1:])} is unknown; allowed: plain numbers")
            properties.append((words[2], words[1]))
    names = tuple(name for name, _ in properties)
    if form not in _ORDERS:
        raise InputError(f"{path}: format {form or 'missing'} is unknown; allowed: {', '.join(_ORDERS)}")
    if not {"x", "y", "z"} <= set(names) or len(set(names)) != len(names):
        raise InputError(f"{path}: its vertices have {', '.join(names) or 'no properties'}; x, y and z are needed")
    if not 0 <= points <= LARGEST_POINTS:
        raise InputError(f"{path} promises no proper number of vertices; allowed are 0 to {LARGEST_POINTS}")
    types = tuple(kind for _, kind in properties)
    return _Header(form=form, points=points, names=names, types=types, body=content[body_at:])


def _ascii(header: _Header, path: Path) -> Float64Array:
    columns = [header.names.index(axis) for axis in "xyz"]
    lines = header.body.decode("ascii", errors="replace").splitlines()[: header.points]
    if len(lines) < header.points:
        raise InputError(f"{path} promises {header.points} vertices and holds {len(lines)}; it is cut, record it again")
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        try:
            rows.append([float(words[column]) for column in columns])
        except (ValueError, IndexError):
            raise InputError(f"{path}: vertex {number} reads {line[:60]!r}, not a number for each property") from None
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


LARGEST_FILE_BYTES = 1 << 30
FORMATS = (".pcd", ".ply", ".npy", ".csv")


def read_cloud(path: Path) -> Float64Array:
    """The points (N, 3) [m] of a cloud file, N >= 2.

    Points with a coordinate that is not finite are left out of .pcd and .ply files, where they are the
    usual mark of an unknown depth; in .npy and .csv files they are an error. Raises `InputError`.
    """
    points = _read(path)
    if path.suffix.lower() in (".pcd", ".ply"):
        points = points[np.all(np.isfinite(points), axis=1)]
    return _checked(points, path)


def read_nodes(path: Path) -> Float64Array:
    """The nodes (M, 3) [m] of a .npy or .csv file, M >= 2. Raises `InputError`."""
    if path.suffix.lower() not in (".npy", ".csv"):
        raise InputError(f"{path}: nodes come as .npy or .csv, not {path.suffix or 'without an ending'}")
    return _checked(_read(path), path)


def _read(path: Path) -> Float64Array:
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise InputError(f"{path}: a cloud is a file that ends in {', '.join(FORMATS)}; convert it to one of these")
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the path of a recorded cloud")
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path} is empty; a cloud needs at least 2 points")
    if size > LARGEST_FILE_BYTES:
        raise InputError(f"{path} has {size} bytes, allowed are {LARGEST_FILE_BYTES}; thin or cut the cloud first")
    if ending == ".pcd":
        return read_pcd(path)
    if ending == ".ply":
        return read_ply(path)
    return _read_npy(path) if ending == ".npy" else _read_csv(path)


def _read_npy(path: Path) -> Float64Array:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(f"{path} is no array: {error}; write it with numpy.save, shape (N, 3), metres") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(f"{path} holds no numbers; write an array (N, 3) of metres with numpy.save")
    return array.astype(np.float64)


def _read_csv(path: Path) -> Float64Array:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path} is no text: {error}; a .csv has x, y, z in metres on each line") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = line.replace(";", ",").split(",")
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if not line.strip() or line.lstrip().startswith("#") or not rows:
                continue  # blank, a comment, or the heading
            raise InputError(f"{path}, line {number}: {line.strip()[:60]!r} is not x, y, z in metres") from None
        if rows and len(values) != len(rows[0]):
            raise InputError(f"{path}, line {number} has {len(values)} columns, the first has {len(rows[0])}")
        rows.append(values)
    if not rows:
        raise InputError(f"{path} holds no numbers; a .csv has x, y, z in metres on each line")
    return np.array(rows, dtype=np.float64)


def _checked(points: Float64Array, path: Path) -> Float64Array:
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path} has shape {points.shape}; allowed is (N, 3): x, y, z in metres for each point")
    if len(points) < 2:
        raise InputError(f"{path} holds {len(points)} usable point(s), at least 2 are needed")
    bad = ~np.all(np.isfinite(points), axis=1)
    if np.any(bad):
        raise InputError(
            f"{path}: {np.count_nonzero(bad)} of {len(points)} points are not finite, the first is number "
            f"{int(np.argmax(bad)) + 1}; remove them"
        )
    if float(np.max(np.abs(points))) > 100.0:
        raise InputError(f"{path}: a coordinate is larger than 100 m; are these millimetres? divide them by 1000")
    return points
