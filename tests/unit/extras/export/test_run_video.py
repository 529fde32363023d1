"""A video of a run for people."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_fixtures import FURNISHED
from videos import apart, read_video

from dlokit.description.installation import Installation
from dlokit.description.scene import Scene
from dlokit.errors import InputError
from dlokit.extras.export import run_video
from dlokit.extras.export.run_video import HOLD_S, VideoOptions, caption_lines, write_run_video
from dlokit.recording.channels import FILE_NAME
from dlokit.system.config import RunConfig
from dlokit.types.flow import FlowStatus, RunOutcome

pytestmark = pytest.mark.xdist_group("simulated_run")

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
SMALL = VideoOptions(fps=5, speed=4.0, width_px=240)


def greens(picture: np.ndarray) -> int:
    """Number of pixels in the colour of the goal."""
    red, green, blue = (picture[:, :, channel].astype(int) for channel in range(3))
    return int(np.count_nonzero((green > red + 40) & (green > blue + 30)))


def test_a_simulated_run_is_rendered_with_goal_and_caption_and_the_end_is_held(
    simulated_run: Path, tmp_path: Path
) -> None:
    done: list[tuple[int, int]] = []
    made = write_run_video(
        simulated_run / FILE_NAME, tmp_path / "a.mp4", SMALL, lambda count, total: done.append((count, total))
    )
    pictures = read_video(tmp_path / "a.mp4")
    assert made.pictures == "rendered again"
    assert pictures[0].shape == (made.size_px[1], made.size_px[0], 3) == (176, 240, 3)
    assert done == [(number + 1, len(pictures)) for number in range(len(pictures))]
    assert made.duration_s == pytest.approx(len(pictures) / 5)
    held = round(HOLD_S * 5)
    assert max(apart(one, pictures[-1]) for one in pictures[-held:]) < 2.0  # the codec's errors
    assert max(apart(one, pictures[-1]) for one in pictures[:-held]) > 5.0
    assert greens(pictures[-1]) > 20 > greens(pictures[0])  # the goal is set after the first look
    assert pictures[-1][162:].max() > 150  # letters


def test_speed_shortens_the_video(tmp_path: Path) -> None:
    path = REFERENCES / "farthest.mcap"
    slow, fast = (
        write_run_video(path, tmp_path / f"{speed}.mp4", VideoOptions(fps=5, speed=speed, width_px=80), lambda *_: None)
        for speed in (1.0, 4.0)
    )
    assert slow.duration_s - HOLD_S == pytest.approx(4 * (fast.duration_s - HOLD_S), abs=0.8)
    assert slow.pictures.startswith("2 recorded ones")
    assert slow.size_px == (80, 76)


def test_the_outlines_of_the_believed_fixtures_are_drawn_into_recorded_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = VideoOptions(fps=5, speed=40.0, width_px=160)
    video = {}
    for scene in (Scene(), FURNISHED):
        config = replace(RunConfig(), installation=Installation(fixtures=scene.fixtures))
        monkeypatch.setattr(run_video, "known_config", lambda path, parts, config=config: config)
        write_run_video(REFERENCES / "farthest.mcap", tmp_path / "a.mp4", options, lambda *_: None)
        video[scene.fixtures] = read_video(tmp_path / "a.mp4")[0].astype(int)
    changed = np.abs(video[()] - video[FURNISHED.fixtures]).max(axis=2) > 40
    assert 10 < np.count_nonzero(changed) < 0.1 * changed.size


def test_a_recording_without_pictures_or_truth_has_no_video(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contains no view/left"):
        write_run_video(REFERENCES / "wire.mcap", tmp_path / "a.mp4", SMALL, lambda *_: None)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_video_leaves_no_file(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_run_video(REFERENCES / "farthest.mcap", tmp_path / "a.mp4", SMALL, interrupt)
    assert list(tmp_path.iterdir()) == []


def status(**fields: object) -> FlowStatus:
    return FlowStatus(stamp_ns=0, frame="", flow="shape_dlo", **fields)  # type: ignore[arg-type]


def test_the_caption_says_time_step_action_and_error() -> None:
    assert caption_lines(status(step="find_dlo"), 1.24, 1.0) == ("1.2 s   find dlo", "the error is not known yet")
    moving = status(step="move_to_goal", actions=1, rmse_m=0.0238)
    assert caption_lines(moving, 8.0, 2.0, 0.012) == (
        "8.0 s   move to goal   2 times real time",
        "action 2   last error 23.8 mm, goal below 12.0 mm",
    )
    ended = status(step="converged", actions=2, rmse_m=0.011, outcome=RunOutcome.CONVERGED)
    assert caption_lines(ended, 17.0, 1.0) == ("17.0 s   ended: converged", "2 actions   error 11.0 mm")
