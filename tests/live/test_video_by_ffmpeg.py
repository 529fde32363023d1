"""Videos that the program `ffmpeg` encodes: whole, as near to the pictures as OpenCV's, or not there."""

import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from videos import apart, read_video

from dlokit.errors import MachineError
from dlokit.extras.export.video_file import VideoFile, ffmpeg_program
from dlokit.types.arrays import UInt8Array

FFMPEG = ffmpeg_program()
pytestmark = pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg with VP9; on Debian: apt install ffmpeg")


def picture(number: int) -> UInt8Array:
    """A smooth background with a bright bar that moves by 2 pixels a picture."""
    pixels = np.empty((96, 128, 3), dtype=np.uint8)
    pixels[:] = np.linspace(30, 120, 128, dtype=np.uint8)[None, :, None]
    pixels[20:60, 2 * number : 2 * number + 16] = (220, 60, 30)
    return pixels


def written(path: Path, ffmpeg: str | None) -> list[UInt8Array]:
    with VideoFile(path, 10, 128, 96, ffmpeg=ffmpeg) as video:
        for number in range(45):
            video.add(picture(number))
        assert not path.exists()  # it gets its name when it is complete
    assert list(path.parent.iterdir()) == [path]
    return read_video(path)


def test_a_video_has_every_picture_as_near_as_opencv_and_browsers_play_it(tmp_path: Path) -> None:
    errors: list[float] = []
    for ffmpeg in (None, FFMPEG):
        path = tmp_path / str(ffmpeg is None) / "a.mp4"
        path.parent.mkdir()
        shown = written(path, ffmpeg)
        assert len(shown) == 45
        errors.append(max(apart(picture(number), one) for number, one in enumerate(shown)))
    assert errors[1] < errors[0] + 1.0
    assert b"vp09" in path.read_bytes()
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FPS) == 10.0


@pytest.mark.parametrize("error", [KeyboardInterrupt, MachineError])
def test_an_interrupted_video_leaves_no_file(tmp_path: Path, error: type[BaseException]) -> None:
    def interrupted() -> None:
        with VideoFile(tmp_path / "a.mp4", 10, 128, 96, ffmpeg=FFMPEG) as video:
            video.add(picture(0))
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_an_encoder_that_ends_early_is_an_error(tmp_path: Path) -> None:
    script = tmp_path / "ffmpeg"
    script.write_text("#!/bin/sh\nexit 1\n")
    script.chmod(0o755)

    def all_of_it() -> None:
        with VideoFile(tmp_path / "a.mp4", 10, 128, 96, ffmpeg=str(script)) as video:
            for number in range(20):
                video.add(picture(number))

    with pytest.raises(MachineError, match="could not be written to its end"):
        all_of_it()
    assert list(tmp_path.iterdir()) == [script]


def test_a_program_without_vp9_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "ffmpeg"
    script.write_text("#!/bin/sh\necho ' V..... mpeg4'\n")
    script.chmod(0o755)
    assert subprocess.run([script], check=False).returncode == 0
    monkeypatch.setenv("PATH", str(tmp_path))
    assert ffmpeg_program() is None
