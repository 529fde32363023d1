"""Which pictures of a board `dlokit calibrate pictures` saves, and what it says; tests/live has GenICam cameras."""

import asyncio
import io
from pathlib import Path
from types import TracebackType

import msgspec
import numpy as np
import pytest
from rich.console import Console

from dlokit.app.commands import execute
from dlokit.description.board import CharucoBoard
from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError, HardwareError, InputError
from dlokit.extras.calibration.commands.folder import camera_of_folder, read_pictures, write_pictures
from dlokit.extras.calibration.commands.pictures import PicturesArgs, Taking, take_pictures, uncalibrated
from dlokit.extras.calibration.procedure import TakenPicture
from dlokit.extras.cameras.genicam import GenicamConfig
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.recorded import RecordedCamera
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import StereoImages

BOARD = CharucoBoard()
SEEN = BOARD.picture(40)  # 280 by 200 px
BLANK = np.full((600, 800, 3), 128, dtype=np.uint8)


def shown(x_px: int, y_px: int) -> UInt8Array:
    """A picture (600, 800, 3) with the board's corner there."""
    picture = BLANK.copy()
    picture[y_px : y_px + SEEN.shape[0], x_px : x_px + SEEN.shape[1]] = SEEN[..., None]
    return picture


def pair(left: UInt8Array, right: UInt8Array) -> StereoImages:
    return StereoImages(stamp_ns=1, left=left, right=right, calibration=default_calibration())


class Scene:
    def __init__(self, folder: Path, count: int = 50) -> None:
        self.said = io.StringIO()
        self.taking = Taking(BOARD, folder, count, Console(file=self.said, width=300))

    def take(self, x_px: int, y_px: int, *, right: bool = True) -> bool:
        return self.taking.take(pair(shown(x_px, y_px), shown(x_px, y_px) if right else BLANK))


def test_a_board_is_saved_when_it_rests_and_again_when_it_was_moved_and_rests(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    places = [(20, 20), (20, 20), (20, 20), (60, 20), (100, 20), (100, 20)]
    assert [scene.take(*place) for place in places] == [False, True, False, False, False, True]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "left_000.png",
        "left_001.png",
        "right_000.png",
        "right_001.png",
    ]
    saved = read_pictures(tmp_path)[1]
    assert np.array_equal(saved.left, shown(100, 20))
    assert saved.right is not None


def test_a_board_that_one_camera_does_not_show_is_not_saved(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    assert not any(scene.take(20, 20, right=False) for _ in range(3))
    assert "the board is not in both pictures" in scene.said.getvalue()
    assert list(tmp_path.iterdir()) == []


def test_it_says_which_parts_of_the_picture_have_no_corner_yet(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    for place in ((10, 10), (500, 10), (10, 390), (500, 390)):
        scene.take(*place)
        scene.take(*place)
    scene.taking.say_end()
    end = scene.said.getvalue().splitlines()[-2]
    assert "no corner yet" in end
    assert "middle centre" in end
    assert "top left" not in end
    assert "bottom right" not in end
    scene.take(260, 200)
    scene.take(260, 200)
    scene.taking.say_end()
    assert "middle centre" not in scene.said.getvalue().splitlines()[-2]


class Shown:
    """A camera that is lost once, and then shows the board at rest in one place after the other."""

    calibration = msgspec.structs.replace(default_calibration(800, 600), serial="7F2A")

    def __init__(self) -> None:
        self._captured = 0

    async def capture(self, timeout_s: float) -> StereoImages:
        self._captured += 1
        if self._captured == 1:
            raise HardwareError("its cable is out")
        picture = shown(20 + 40 * (self._captured // 2), 20)
        return pair(picture, picture)

    def __enter__(self) -> "Shown":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass


def test_a_lost_camera_is_named_and_waited_for_and_enough_pictures_end_it(tmp_path: Path) -> None:
    scene = Scene(tmp_path, count=3)
    asyncio.run(scene.taking.follow(Shown(), again_s=0.0))
    assert scene.taking.saved == 3
    assert "the camera is lost: its cable is out" in scene.said.getvalue()


def test_the_folder_says_of_which_camera_its_pictures_are(tmp_path: Path) -> None:
    assert take_pictures(PicturesArgs(count=10, out=tmp_path / "board"), Shown(), again_s=0.0) == 0
    saved = read_pictures(tmp_path / "board")
    assert len(saved) == 10
    given = camera_of_folder(tmp_path / "board", saved[0].left, serial="", date="")
    assert given.serial == "7F2A"


def test_cameras_without_names_the_cell_and_too_few_pictures_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"camera\.left"):
        uncalibrated(GenicamConfig())
    with pytest.raises(InputError, match="--count is 9; it must be 10 or greater"):
        PicturesArgs(count=9)
    with pytest.raises(InputError, match="sees the simulated cell"):
        execute(["calibrate", "pictures", "--camera", "simulated"])


def test_the_end_of_a_recording_names_the_pictures_that_were_left_out(tmp_path: Path) -> None:
    recorded, out = tmp_path / "recorded", tmp_path / "out"
    for folder in (recorded, out):
        folder.mkdir()
    write_pictures(recorded, [TakenPicture(left=BLANK, right=BLANK) for _ in range(2)])
    write_calibration(recorded / "calibration.toml", default_calibration(800, 600))
    (recorded / "right_001.png").write_bytes(b"torn")
    scene = Scene(out)
    asyncio.run(scene.taking.follow(RecordedCamera(recorded), 0.0))
    assert "1 that cannot be used (right_001.png)" in scene.said.getvalue()


def test_fewer_pictures_than_asked_for_end_with_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded = tmp_path / "recorded"
    recorded.mkdir()
    write_pictures(recorded, [TakenPicture(left=BLANK, right=BLANK)])
    write_calibration(recorded / "calibration.toml", default_calibration(800, 600))
    arguments = ["--camera", "recorded", "--camera.path", str(recorded), "--out", str(tmp_path / "out")]
    assert execute(["calibrate", "pictures", *arguments]) == 3
    assert "0 of 50 pictures in" in capsys.readouterr().out


def test_a_picture_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"left_000\.png cannot be written"):
        write_pictures(tmp_path / "gone", [TakenPicture(left=BLANK, right=None)])
