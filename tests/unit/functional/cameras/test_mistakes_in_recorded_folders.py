"""Mistakes that people make with a folder of recorded pictures, a row each, and what is right to do with them."""

import asyncio
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from dlokit.errors import InputError, NoMorePictures
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.recorded import RecordedCamera
from dlokit.geometry import pose
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, DepthImage

CAMERA = CameraCalibration(
    width_px=8,
    height_px=6,
    fx_px=10.0,
    fy_px=10.0,
    cx_px=3.5,
    cy_px=2.5,
    baseline_m=0.1,
    T_world_camera=pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),
)
LOOKS = (1, 2, 3, 4)
STEP = 10  # grey value of look 1; that of look 2 is twice this, and so on


def grey(number: int) -> UInt8Array:
    return np.full((6, 8, 3), STEP * number, dtype=np.uint8)


def depth() -> np.ndarray:
    return np.full((6, 8), 912, dtype=np.uint16)


def good(folder: Path) -> None:
    """Four looks of a depth camera; the grey value tells which is which."""
    write_calibration(folder / "calibration.toml", CAMERA)
    for number in LOOKS:
        cv2.imwrite(str(folder / f"colour_{number:04}.png"), grey(number))
        cv2.imwrite(str(folder / f"depth_{number:04}.png"), depth())


@dataclass(frozen=True)
class Refused:
    """An `InputError` before the first picture, whose message has these words."""

    words: str


@dataclass(frozen=True)
class Played:
    """The looks that are played, in this order."""

    numbers: tuple[int, ...] = LOOKS
    named: str = ""
    """What the message at the end says of those that are not."""


Right = Refused | Played


def played(folder: Path) -> Played:
    """The looks of a folder, told by their grey values, and the message at the end."""
    camera = RecordedCamera(folder)
    numbers: list[int] = []
    stamps: list[int] = []

    async def main() -> str:
        while True:
            try:
                pictures = await camera.capture(1.0)
            except NoMorePictures as end:
                return str(end)
            if isinstance(pictures, DepthImage):
                np.testing.assert_allclose(pictures.depth_m, 0.912)
            numbers.append(round(float(pictures.reference.mean()) / STEP))
            stamps.append(pictures.stamp_ns)

    end = asyncio.run(main())
    assert stamps == sorted(set(stamps))
    return Played(tuple(numbers), end)


def renamed(names: tuple[str, ...]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        for number, name in zip(LOOKS, names, strict=True):
            for kind in ("colour", "depth"):
                (folder / f"{kind}_{number:04}.png").rename(folder / f"{kind}_{name}.png")

    return change


def replaced(file: str, picture: np.ndarray, extension: str = ".png") -> Callable[[Path], None]:
    """The file has another picture; `file` may be a pattern."""

    def change(folder: Path) -> None:
        for path in folder.glob(file):
            path.write_bytes(cv2.imencode(extension, picture)[1].tobytes())

    return change


def changed_bytes(file: str, change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def changed(folder: Path) -> None:
        path = folder / file
        path.write_bytes(change(path.read_bytes()))

    return changed


def calibrated(**values: object) -> Callable[[Path], None]:
    """The calibration has other values, as text."""

    def change(folder: Path) -> None:
        file = folder / "calibration.toml"
        lines = [line for line in file.read_text().splitlines() if line.split(" =")[0] not in values]
        file.write_text("\n".join([*(f"{key} = {value}" for key, value in values.items()), *lines]))

    return change


def stereo(folder: Path) -> None:
    """The same looks as pairs, of a single camera's calibration."""
    for number in LOOKS:
        (folder / f"colour_{number:04}.png").rename(folder / f"left_{number:04}.png")
        (folder / f"depth_{number:04}.png").unlink()
        cv2.imwrite(str(folder / f"right_{number:04}.png"), grey(number))
    write_calibration(folder / "calibration.toml", CAMERA)
    file = folder / "calibration.toml"
    file.write_text("\n".join(line for line in file.read_text().splitlines() if "baseline_m" not in line))


def folder_in_place_of_a_picture(folder: Path) -> None:
    (folder / "colour_0003.png").unlink()
    (folder / "colour_0003.png").mkdir()


def link_to_a_picture_that_is_gone(folder: Path) -> None:
    (folder / "colour_0003.png").unlink()
    (folder / "colour_0003.png").symlink_to(folder / "gone.png")


def flipped(data: bytes) -> bytes:
    middle = data.index(b"IDAT") + 6
    return data[:middle] + bytes([data[middle] ^ 0xFF]) + data[middle + 1 :]


ROWS: list[tuple[str, Callable[[Path], None], Right]] = [
    # Names.
    ("leading zeros to three digits alone", renamed(("998", "999", "1000", "1001")), Played()),
    (
        "stamps of unequal length",
        renamed(("99999999", "100000000", "1764337000123456789", "2e0")),
        Played((4, 1, 2, 3)),
    ),
    ("a number before the number", renamed(("cam2_take9", "cam2_take10", "cam2_take11", "cam10_take1")), Played()),
    ("times of day", renamed(("2026-11-28_9-59", "2026-11-28_10-1", "2026-11-28_10-12", "2026-12-1_8-00")), Played()),
    ("a digit that is no decimal one", renamed(("1", "2", "2\N{SUPERSCRIPT TWO}", "3")), Played()),
    ("a folder named like a pattern", lambda folder: None, Played()),
    (
        "a depth picture without its colour picture",
        lambda folder: (folder / "colour_0002.png").unlink(),
        Refused("depth_0002.png"),
    ),
    # Values: the files are read, and say something else.
    (
        "a picture turned by a quarter",
        replaced("colour_0002.png", np.zeros((8, 6, 3), np.uint8)),
        Played((1, 3, 4), "colour_0002.png"),
    ),
    ("all pictures turned by a quarter", replaced("colour_*.png", np.zeros((8, 6, 3), np.uint8)), Refused("6 by 8 px")),
    (
        "the first picture of another camera",
        replaced("colour_0001.png", np.zeros((12, 16, 3), np.uint8)),
        Played((2, 3, 4), "colour_0001.png"),
    ),
    ("pictures at half the size of the calibration", calibrated(width_px=16, height_px=12), Refused("8 by 6 px")),
    ("one depth as a coloured picture", replaced("depth_0004.png", grey(7)), Played((1, 2, 3), "depth_0004.png")),
    (
        "one depth with an alpha channel",
        replaced("depth_0003.png", np.zeros((6, 8, 4), np.uint16)),
        Played((1, 2, 4), "depth_0003.png"),
    ),
    (
        "depths as fractions of metres",
        replaced("depth_*.png", np.full((6, 8), 0.912, np.float32), ".tiff"),
        Refused("16 bits"),
    ),
    ("depths rounded to metres", replaced("depth_*.png", np.ones((6, 8), np.uint16)), Refused("millimetres")),
    (
        "depths in whole centimetres below the near limit",
        replaced("depth_*.png", np.full((6, 8), 9, np.uint16)),
        Refused("millimetres"),
    ),
    ("stereo pictures, and the calibration of a single camera", stereo, Played()),
    ("a picture twice", replaced("colour_0003.png", grey(2)), Played((1, 2, 2, 4))),
    ("JPEG with the name of PNG", replaced("colour_0003.png", grey(3), ".jpg"), Played()),
    ("grey without channels", replaced("colour_0003.png", grey(3)[..., 0]), Played()),
    # Damage that is not a torn file.
    ("a byte that differs", changed_bytes("depth_0002.png", flipped), Played((1, 3, 4), "depth_0002.png")),
    (
        "the end of the file lost",
        changed_bytes("colour_0004.png", lambda data: data[:-12]),
        Played((1, 2, 3), "colour_0004.png"),
    ),
    ("a folder with the name of a picture", folder_in_place_of_a_picture, Played((1, 2, 4), "colour_0003.png")),
    ("a link to a picture that is gone", link_to_a_picture_that_is_gone, Played((1, 2, 4), "colour_0003.png")),
]


@pytest.mark.parametrize(("change", "right"), [pytest.param(*row[1:], id=row[0]) for row in ROWS])
def test_a_mistake_in_a_folder_is_named_or_changes_nothing(
    change: Callable[[Path], None], right: Right, tmp_path: Path
):
    folder = tmp_path / "take[1]"
    folder.mkdir()
    good(folder)
    change(folder)
    if isinstance(right, Refused):
        with pytest.raises(InputError) as refused:
            played(folder)
        assert right.words in str(refused.value)
        assert folder.name in str(refused.value)
        return
    found = played(folder)
    assert found.numbers == right.numbers
    assert right.named in found.named
    shutil.rmtree(folder)
