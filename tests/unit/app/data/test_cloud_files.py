"""Recorded clouds: each format is read as written, and errors are named."""

import struct
from pathlib import Path

import numpy as np
import pytest

from dlokit.app.data.cloud_files import read_cloud, read_nodes, read_pcd
from dlokit.errors import InputError

POINTS = np.array([[0.1, -0.2, 0.004], [0.25, 0.5, 0.125], [1.5, 2.0, -3.0]])
EXACT = 1e-6  # float32 in the file, six digits in text


def pcd_header(data: str, points: int = 3, fields: str = "x y z rgb") -> bytes:
    count = len(fields.split())
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {'4 ' * count}\nTYPE {'F ' * count}\n"
        f"COUNT {'1 ' * count}\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


def with_colour() -> np.ndarray:
    return np.column_stack([POINTS, [7.0, 8.0, 9.0]]).astype("<f4")


def literal_lzf(data: bytes) -> bytes:
    """LZF without compression: literal runs of up to 32 bytes."""
    runs = [data[at : at + 32] for at in range(0, len(data), 32)]
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def compressed(packed: bytes, full: int, points: int = 3) -> bytes:
    return pcd_header("binary_compressed", points) + struct.pack("<II", len(packed), full) + packed


def ply(form: str, body: bytes, properties: str = "float x|float y|float z|uchar red") -> bytes:
    lines = "".join(f"property {entry}\n" for entry in properties.split("|"))
    return f"ply\nformat {form} 1.0\ncomment made up\nelement vertex 3\n{lines}end_header\n".encode() + body


def ply_records(order: str) -> bytes:
    dtype = np.dtype([("xyz", order + "f4", 3), ("red", "u1")])
    records = np.zeros(3, dtype=dtype)
    records["xyz"] = POINTS
    return records.tobytes()


def text() -> bytes:
    return "\n".join(" ".join(f"{value:.6f}" for value in (*point, 1)) for point in POINTS).encode()


FILES = {
    "ascii.pcd": pcd_header("ascii") + text(),
    "binary.pcd": pcd_header("binary") + with_colour().tobytes(),
    "compressed.pcd": compressed(literal_lzf(with_colour().T.tobytes()), 48),
    "ascii.ply": ply("ascii", text().replace(b"1.000000\n", b"1\n")),
    "little.ply": ply("binary_little_endian", ply_records("<")),
    "big.ply": ply("binary_big_endian", ply_records(">")),
    "commas.csv": b"x,y,z\n" + b"\n".join(b"%.6f,%.6f,%.6f" % tuple(point) for point in POINTS),
    "semicolons.CSV": b"# metres\n" + b"\n".join(b"%.6f; %.6f; %.6f" % tuple(point) for point in POINTS),
}


@pytest.mark.parametrize("name", FILES)
def test_points_are_read_as_written(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    np.testing.assert_allclose(read_cloud(path), POINTS, atol=EXACT)


def test_an_array_is_read_as_saved(tmp_path: Path) -> None:
    np.save(tmp_path / "cloud.npy", POINTS)
    np.testing.assert_array_equal(read_cloud(tmp_path / "cloud.npy"), POINTS)
    np.testing.assert_array_equal(read_nodes(tmp_path / "cloud.npy"), POINTS)


def test_back_references_of_compressed_clouds_are_followed(tmp_path: Path) -> None:
    # Sixteen times the same float: four bytes as they are, then 60 bytes from 4 bytes back (0xE0: long run).
    value = struct.pack("<f", 0.25)
    packed = bytes([3]) + value + bytes([0xE0, 60 - 2 - 7, 3])
    (tmp_path / "same.pcd").write_bytes(compressed(packed, 64, points=4))
    np.testing.assert_array_equal(read_pcd(tmp_path / "same.pcd"), np.full((4, 3), 0.25))


def test_points_of_unknown_depth_are_left_out_of_pcd_files(tmp_path: Path) -> None:
    points = with_colour()
    points[1, 2] = np.nan
    (tmp_path / "holes.pcd").write_bytes(pcd_header("binary") + points.tobytes())
    np.testing.assert_allclose(read_cloud(tmp_path / "holes.pcd"), POINTS[[0, 2]], atol=EXACT)


BAD = {
    "empty.csv": (b"", "empty"),
    "word.csv": (b"1,2,3\n1,two,3\n", "line 2"),
    "ragged.csv": (b"1,2,3\n1,2\n", "columns"),
    "flat.csv": (b"1,2\n3,4\n", r"\(N, 3\)"),
    "one.csv": (b"1,2,3\n", "at least 2"),
    "nan.csv": (b"0,0,0\n0,nan,0\n", "not finite"),
    "millimetres.csv": (b"0,0,0\n520,10,4\n", "1000"),
    "heading.csv": (b"x,y,z\n", "no numbers"),
    "cut.pcd": (pcd_header("binary") + b"1234", "truncated"),
    "few.pcd": (pcd_header("ascii") + b"1 2 3 4\n", "truncated"),
    "headless.pcd": (b"FIELDS x y z\n", "DATA"),
    "huge.pcd": (pcd_header("binary", 10**12), "the limit is"),
    "no_z.pcd": (pcd_header("ascii", fields="x y") + b"1 2\n", "x, y and z"),
    "odd.pcd": (pcd_header("zipped"), "zipped"),
    "lying.pcd": (compressed(literal_lzf(b"0" * 40), 48), "unpacks"),
    "garbled.pcd": (compressed(bytes([0x20, 200]), 48), "corrupt"),
    "bomb.pcd": (compressed(b"12", 2**31), "match"),
    "not.ply": (b"solid", "not a .ply"),
    "cut.ply": (ply("binary_little_endian", b"123"), "truncated"),
    "list.ply": (ply("ascii", text(), "float x|float y|list uchar int z"), "x, y and z"),
    "huge.ply": (
        ply("binary_little_endian", ply_records("<")).replace(b"vertex 3", b"vertex 1000000000000"),
        "truncated",
    ),
    "huge_text.ply": (ply("ascii", text()).replace(b"vertex 3", b"vertex 1000000000000"), "contains 3"),
    "header.ply": (b"ply\nformat ascii 1.0\n", "not a .ply"),
    "short.ply": (ply("ascii", b"1 2 3 4"), "contains 1"),
    "text.npy": (b"hello", "not an array"),
    "cloud.las": (b"LASF", ".pcd"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_named_with_the_reason(name: str, tmp_path: Path) -> None:
    content, reason = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=reason) as told:
        read_cloud(tmp_path / name)
    assert name in str(told.value)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="not an array"):
        read_cloud(tmp_path / "objects.npy")


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.pcd", tmp_path / "folder.pcd"):
        (tmp_path / "folder.pcd").mkdir(exist_ok=True)
        with pytest.raises(InputError, match="does not exist"):
            read_cloud(path)


def test_a_file_of_initial_nodes_is_not_a_cloud(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.npy or \.csv"):
        read_nodes(tmp_path / "nodes.pcd")
