"""Mistakes that people make in the lines of poses.csv, a row each: named by line, or counted, or read the same."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dlokit import geometry
from dlokit.errors import InputError
from dlokit.extras.calibration.commands.folder import POSES, read_pictures, write_pictures
from dlokit.extras.calibration.procedure import TakenPicture
from dlokit.types.pose import Pose

Line = list[str]
POSES_OF = [geometry.pose((0.4 + 0.01 * number, 0.1, 0.3), (0.5, 0.5, -0.5, 0.5)) for number in range(4)]
NAMES = ("000", "001", "002", "003")


def good(folder: Path) -> None:
    picture = np.zeros((6, 8, 3), dtype=np.uint8)
    write_pictures(folder, [TakenPicture(left=picture, T_world_tcp=T) for T in POSES_OF])


def lines(change: Callable[[list[Line]], list[Line]]) -> Callable[[str], str]:
    """The lines are others, as columns; the first is the header."""

    def changed(text: str) -> str:
        return "\n".join(",".join(line) for line in change([line.split(",") for line in text.splitlines()]))

    return changed


def columns(change: Callable[[Line], Line], *numbers: int) -> Callable[[str], str]:
    """Some lines of poses are others; without numbers, all of them."""
    return lines(
        lambda every: [
            every[0],
            *(change(line) if not numbers or at in numbers else line for at, line in enumerate(every[1:])),
        ]
    )


def quaternion(*values: float) -> Callable[[Line], Line]:
    return lambda line: [*line[:4], *map(repr, values)]


def scaled(factor: float) -> Callable[[Line], Line]:
    return lambda line: [*line[:4], *(repr(factor * float(value)) for value in line[4:])]


def posed(*names: str) -> tuple[str, ...]:
    return tuple(name for name in NAMES if name in names)


ROWS: list[tuple[str, Callable[[str], str], str | tuple[str, ...]]] = [
    # Values: every line is numbers.
    ("a quaternion of length 2", columns(scaled(2.0), 1), "line 3: the quaternion"),
    ("quaternions in thousandths", columns(scaled(1000.0)), "line 2: the quaternion"),
    ("a quaternion of three decimals", columns(quaternion(0.707, 0.707, 0.0, 0.0)), NAMES),
    ("axis and angle for the quaternion", columns(quaternion(0.0, 0.0, 1.0, 1.57)), "line 2: the quaternion"),
    ("roll, pitch, yaw in degrees, and a 0", columns(quaternion(180.0, 0.0, 90.0, 0.0)), "line 2: the quaternion"),
    ("both signs of the quaternion", columns(scaled(-1.0), 1, 3), NAMES),
    (
        "decimal commas",
        columns(lambda line: [line[0], *",".join(v.replace(".", ",") for v in line[1:]).split(",")]),
        "line 2",
    ),
    ("a position that is no number", columns(lambda line: [line[0], "nan", *line[2:]], 2), "line 4"),
    ("an angle that is infinite", columns(lambda line: [*line, *["0.1"] * 6, "inf"]), "line 2"),
    ("a picture twice, with two poses", lines(lambda every: [*every, ["001", *every[4][1:]]]), "'001'"),
    ("a picture twice, and one never", lines(lambda every: [*every[:3], ["001", *every[3][1:]], every[4]]), "'001'"),
    ("no header", lines(lambda every: every[1:]), "header"),
    (
        "a column of stamps before the position",
        columns(lambda line: [line[0], "1764337000", *line[1:]]),
        "line 2: the quaternion",
    ),
    # Names.
    ("a line missing", lines(lambda every: every[:4]), posed("000", "001", "002")),
    ("the header alone", lines(lambda every: every[:1]), posed()),
    ("lines of pictures that were deleted", lines(lambda every: [*every, ["009", *every[1][1:]]]), NAMES),
    ("names of another recording", columns(lambda line: ["take2_" + line[0], *line[1:]]), "'take2_000'"),
    ("spaces around names", columns(lambda line: [f" {line[0]} ", *line[1:]]), NAMES),
    # Texts.
    ("a remark", lines(lambda every: [*every[:2], ["# the board slipped here"], *every[2:]]), "line 3"),
    ("an empty line", lines(lambda every: [*every[:2], [""], *every[2:]]), NAMES),
    ("an empty line of a spreadsheet", lines(lambda every: [*every, [""] * 8]), NAMES),
    ("lines ended as Windows does", lambda text: "\N{ZERO WIDTH NO-BREAK SPACE}" + text.replace("\n", "\r\n"), NAMES),
]


@pytest.mark.parametrize(("change", "right"), [pytest.param(*row[1:], id=row[0]) for row in ROWS])
def test_a_mistake_in_a_line_is_named_or_changes_nothing(
    change: Callable[[str], str], right: str | tuple[str, ...], tmp_path: Path
):
    good(tmp_path)
    file = tmp_path / POSES
    file.write_text(change(file.read_text()), encoding="utf-8")
    if isinstance(right, str):
        with pytest.raises(InputError) as refused:
            read_pictures(tmp_path)
        assert right in str(refused.value)
        assert POSES in str(refused.value)
        return
    found = read_pictures(tmp_path)
    assert [name for name, picture in zip(NAMES, found, strict=True) if picture.T_world_tcp is not None] == list(right)
    for picture, given in zip(found, POSES_OF, strict=True):
        assert picture.T_world_tcp is None or same_place(picture.T_world_tcp, given)


def same_place(T: Pose, other: Pose) -> bool:
    return bool(np.allclose(T.position_m, other.position_m)) and abs(float(np.linalg.norm(T.wxyz)) - 1.0) < 1e-9
