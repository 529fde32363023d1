"""Mistakes in clouds: a row a mistake. What can be understood is read the same, and the rest is refused by name.

Files go the way of `dlokit track`, arrays that of `Tracker.update`. None ends in a traceback, and none is tracked with
points that are not the DLO's.
"""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dlokit.app.data.cloud_files import read_cloud
from dlokit.app.data.cloud_track import TrackSettings, filter_cloud
from dlokit.app.library.tracker import Tracker
from dlokit.errors import InputError
from dlokit.skills.observer.config import ObserverConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation

SAME = None
"""The points are those of the good cloud."""
SETTINGS = TrackSettings(observer=ObserverConfig().strategy)
COUNT = 300
NODES = np.column_stack([np.linspace(0.3, 0.5, 11), 0.05 * np.sin(np.linspace(0.0, 3.0, 11)), np.full(11, 0.004)])
LINE = np.column_stack([np.interp(np.linspace(0, 10, COUNT), np.arange(11), NODES[:, axis]) for axis in range(3)])
GOOD = np.round(LINE + np.random.default_rng(0).normal(0.0, 0.001, LINE.shape), 6)
EXACT_M = 5e-4  # of float16 half a metre from the origin; a mistake is larger by orders
WHOLE = np.round(GOOD * 100.0)  # centimetres, or a small DLO in millimetres: below the limit of 100


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def csv(columns: np.ndarray, heading: str = "", cut: str = ",", cell: str = "{:.6f}") -> bytes:
    rows = [cut.join(cell.format(value) for value in row) for row in columns]
    return "\n".join([heading, *rows] if heading else rows).encode()


def ply(fields: str, columns: np.ndarray) -> bytes:
    properties = "".join(f"property float {name}\n" for name in fields.split())
    heading = f"ply\nformat ascii 1.0\nelement vertex {len(columns)}\n{properties}end_header\n"
    return heading.encode() + csv(columns, cut=" ") + b"\n"


def pcd(columns: np.ndarray, data: str = "ascii", kind: str = "F", points: int = COUNT, width: int = COUNT) -> bytes:
    heading = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE {kind} {kind} {kind}\nCOUNT 1 1 1\nWIDTH {width}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
    return heading.encode() + (csv(columns, cut=" ") if data == "ascii" else columns.astype("<i4").tobytes())


def records(points: Float64Array) -> np.ndarray:
    """As packages for point clouds give them: named columns, in any order."""
    made = np.zeros(len(points), dtype=[("intensity", "f4"), ("z", "f4"), ("x", "f4"), ("y", "f4")])
    made["x"], made["y"], made["z"] = points.T
    made["intensity"] = 200.0
    return made


def promised() -> bytes:
    """The header of an array of a million million points."""
    return npy(GOOD).replace(b"(300, 3), }" + b" " * 10, b"(1000000000000, 3), }")


COLOURS = np.tile([200.0, 120.0, 10.0], (COUNT, 1))
BEFORE = np.column_stack([COLOURS, GOOD])
BROKEN_FIRST = csv(GOOD, "x,y,z").replace(b"z\n", b"z\n0.3,,0.004\n", 1)
HOLES = np.vstack([GOOD, np.zeros((40, 3))])

FILES: list[tuple[str, bytes, str | None]] = [
    # Values that still parse.
    ("centimetres.npy", npy(GOOD * 100.0), "metres"),
    ("rows_for_columns.npy", npy(GOOD.T), "transpose"),
    ("half_precision.npy", npy(GOOD.astype(np.float16)), SAME),
    ("whole_numbers.npy", npy(WHOLE.astype(np.int16)), "whole numbers"),
    ("whole_numbers.pcd", pcd(WHOLE, "binary", "I"), "whole numbers"),
    ("all_zeros.npy", npy(np.zeros_like(GOOD)), "same place"),
    ("one_place.csv", csv(np.tile(GOOD[:1], (COUNT, 1))), "same place"),
    ("backwards.csv", csv(GOOD[:, ::-1], "z,y,x"), SAME),
    ("colours_first.csv", csv(BEFORE, "r,g,b,x,y,z"), SAME),
    ("colours_first.ply", ply("red green blue x y z", BEFORE), SAME),
    ("backwards.ply", ply("z y x", GOOD[:, ::-1]), SAME),
    ("unit_in_the_heading.csv", csv(GOOD * 100.0, "x_cm,y_cm,z_cm"), "x_cm"),
    ("nothing_seen.ply", ply("x y z", GOOD * np.nan), "0 usable"),
    ("zeros_for_unknown.pcd", pcd(HOLES, points=340, width=340), SAME),
    ("fewer_than_its_width.pcd", pcd(GOOD, points=2), "POINTS"),
    ("more_than_it_declares.pcd", pcd(GOOD, points=200, width=200), "declares 200"),
    # The form.
    ("blanks.csv", csv(GOOD, cut=" "), SAME),
    ("decimal_commas.csv", csv(GOOD, "x;y;z", ";").replace(b".", b","), SAME),
    ("quotes.csv", csv(GOOD, '"x","y","z"', cell='"{:.6f}"'), SAME),
    ("spreadsheet.csv", csv(GOOD).decode().encode("utf-16"), "not text"),
    ("hole_in_the_first_row.csv", BROKEN_FIRST, "line 2"),
    ("hole_without_a_heading.csv", BROKEN_FIRST.removeprefix(b"x,y,z\n"), "line 1"),
    ("heading_in_a_comment.csv", csv(GOOD[:, ::-1], "# z y x"), SAME),
    ("fourth_column.csv", csv(BEFORE[:, 2:]), r"\(300, 4\)"),
    ("named_columns.npy", npy(records(GOOD)), SAME),
    ("complex.npy", npy(GOOD.astype(np.complex64)), "no numbers"),
    ("two_clouds.npy", npy(np.stack([GOOD, GOOD])), r"\(2, 300, 3\).*one by one"),
    ("archive.npz", npy(GOOD), r"\.npy"),
    ("million_million.npy", promised(), "not an array"),
]


@pytest.mark.parametrize(("name", "content", "right"), FILES, ids=[row[0] for row in FILES])
def test_a_mistake_in_a_file_is_understood_or_named(
    name: str, content: bytes, right: str | None, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    if right is SAME:
        points = read_cloud(tmp_path / name)
        np.testing.assert_allclose(points, GOOD, atol=EXACT_M)
        return
    with pytest.raises(InputError, match=right) as error:
        filter_cloud(read_cloud(tmp_path / name), SETTINGS, str(tmp_path / name))
    assert name in str(error.value)


class Keeping:
    """An observer that keeps the nodes, and the cloud that it was given."""

    points = np.zeros((0, 3), dtype=np.float32)

    def estimate(self, seen: Observation, prior: DloState) -> Float64Array:
        self.points = seen.points_world
        return prior.nodes_world


def seen(points: object, camera_matrix: object = None, **others: object) -> np.ndarray:
    """The points that the observer gets of a cloud."""
    mine = Keeping()
    tracker = Tracker(observer=mine, initial_nodes_world=NODES, camera_matrix=camera_matrix, voxel_m=0)  # pyright: ignore[reportArgumentType]
    tracker.update(points, **others)  # pyright: ignore[reportArgumentType]
    return mine.points


K = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
UP = np.diag([1.0, -1.0, -1.0, 1.0])  # a camera at the origin of the world that looks down
DEPTH = np.full((480, 640), 0.8)
SPOILED = np.vstack([GOOD, [[0.4, np.inf, 0.0], [np.nan, 0.0, 0.0]]])

ARRAYS: list[tuple[str, Callable[[], np.ndarray], str | None]] = [
    # Values that are numbers.
    ("complex", lambda: seen(GOOD.astype(np.complex128)), "points"),
    ("yes and no", lambda: seen(GOOD > 0.0), "points"),
    ("whole numbers", lambda: seen(WHOLE.astype(np.int16)), "points.*whole numbers"),
    ("infinity", lambda: seen(SPOILED), SAME),
    ("a fifth of a kilometre away", lambda: seen(GOOD + np.array([0.0, 200.0, 0.0])), "points"),
    ("focal length below 0", lambda: seen(GOOD, K * [[-1.0], [1.0], [1.0]]), "camera_matrix"),
    ("camera matrix times 2", lambda: seen(GOOD, K * 2.0), "camera matrix"),
    ("depth in millimetres, as floats", lambda: seen(GOOD, K, depth=DEPTH * 1000.0), "depth"),
    ("depth that is all unknown", lambda: seen(GOOD, K, depth=DEPTH * np.nan), SAME),
    ("camera's pose that is squashed", lambda: seen(GOOD, T_world_camera=UP * 0.5), "T_world_camera"),
    ("stamp of a date", lambda: seen(GOOD, stamp_ns=np.datetime64("2026-01-01")), "stamp_ns"),
    ("stamp that is true", lambda: seen(GOOD, stamp_ns=True), "stamp_ns"),
    # The form.
    ("four coordinates", lambda: seen(np.column_stack([GOOD, np.ones(COUNT)])), r"points.*\(300, 4\)"),
    ("named columns without z", lambda: seen(records(GOOD)[["x", "y"]]), "points.*x, y"),
    ("a word", lambda: seen("cloud.npy"), "points"),
]


@pytest.mark.parametrize(("name", "make", "right"), ARRAYS, ids=[row[0] for row in ARRAYS])
def test_a_mistake_in_an_array_is_understood_or_named(
    name: str, make: Callable[[], np.ndarray], right: str | None
) -> None:
    if right is SAME:
        np.testing.assert_allclose(make(), GOOD, atol=EXACT_M)
        return
    with pytest.raises(InputError, match=right):
        make()
