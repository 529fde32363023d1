"""A video file: whole, or not there."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from videos import apart, read_video

from dlokit.errors import MachineError
from dlokit.extras.export.video_file import VideoFile
from dlokit.types.arrays import UInt8Array


def picture(number: int) -> UInt8Array:
    """A bright bar that moves by 4 pixels a picture, red at the left, blue at the right."""
    pixels = np.full((48, 64, 3), 40, dtype=np.uint8)
    pixels[:, 4 * number : 4 * number + 8] = (220, 30, 30) if number < 6 else (30, 30, 220)
    return pixels


def test_a_video_has_every_picture_in_order_and_browsers_play_it(tmp_path: Path) -> None:
    with VideoFile(tmp_path / "a.mp4", 10, 64, 48) as video:
        for number in range(12):
            video.add(picture(number))
        assert not (tmp_path / "a.mp4").exists()  # it gets its name when it is complete
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    shown = read_video(tmp_path / "a.mp4")
    assert len(shown) == 12
    for number, one in enumerate(shown):
        nearest = min(range(12), key=lambda other: apart(picture(other), one))
        assert nearest == number
    file = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert file.get(cv2.CAP_PROP_FPS) == 10.0
    assert b"vp09" in (tmp_path / "a.mp4").read_bytes()


@pytest.mark.parametrize("error", [KeyboardInterrupt, MachineError])
def test_an_interrupted_video_leaves_no_file(tmp_path: Path, error: type[BaseException]) -> None:
    def interrupted() -> None:
        with VideoFile(tmp_path / "a.mp4", 10, 64, 48) as video:
            video.add(picture(0))
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    def two() -> None:
        with VideoFile(tmp_path / "a.mp4", 10, 64, 48) as video:
            video.add(picture(0)[:32])  # as a full disk, the encoder refuses it
            video.add(picture(1))

    with pytest.raises(MachineError, match="could not be written to its end"):
        two()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"a\.mp4 cannot be written"):
        VideoFile(tmp_path / "none" / "a.mp4", 10, 64, 48)
