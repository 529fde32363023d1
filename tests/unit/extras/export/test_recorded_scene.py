"""The scene of a recorded run: its pictures are those of the time that is asked for."""

import shutil
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from videos import apart

from dlokit.app.commands import execute
from dlokit.errors import InputError
from dlokit.extras.export import recorded_scene
from dlokit.extras.export.recorded_scene import PARTS, RecordedScene
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import RawRecording, picture_file, read_recording
from dlokit.recording.views import from_jpeg
from dlokit.system.configuration.recorded import recorded_config
from dlokit.types.image import StereoImages
from dlokit.types.robot import RobotState

pytestmark = pytest.mark.xdist_group("simulated_run")

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
NOISE = 2.7
"""Mean difference that the noise of the pixels (sigma 1.5 in each of three colours) and JPEG make [grey levels]."""
MOVES = 0.3
"""Pictures 0.1 s apart that differ by this much more than by noise show a motion [grey levels]."""
WITHIN_MS = 50


def test_a_picture_is_that_of_its_time_within_50_ms(simulated_run: Path) -> None:
    path = simulated_run / FILE_NAME
    taken = {
        record.publish_time: from_jpeg(picture_file(record.data).data)
        for channel, record in RawRecording(path=path)
        if channel == "view/left"
    }
    moving = 0
    with closing(RecordedScene(path)) as scene:
        for stamp_ns, picture in taken.items():
            offs: dict[int, float] = {}
            for off_ms in (-100, -WITHIN_MS, 0, WITHIN_MS, 100):
                pictures = scene.pictures(stamp_ns + off_ms * 1_000_000)
                assert isinstance(pictures, StereoImages)
                offs[off_ms] = apart(pictures.left, picture)
            assert offs[0] < NOISE
            if min(offs[-100], offs[100]) > offs[0] + MOVES:
                moving += 1
                # The nearest is at 0: an error of 25 ms would make another the nearest.
                assert min(offs, key=lambda off_ms: offs[off_ms]) == 0
    assert moving >= 3


def test_a_view_for_people_shows_the_table_from_the_side(simulated_run: Path) -> None:
    with closing(RecordedScene(simulated_run / FILE_NAME, view_size_px=(160, 90))) as scene:
        assert scene.viewpoint is not None
        pictures = [scene.view(time_ns) for time_ns in (0, 5_000_000_000)]
    assert pictures[0].shape == (90, 160, 3)
    assert apart(*pictures) > MOVES  # the arm has moved


def test_in_a_dry_run_the_arm_of_the_cell_stays_where_it_was(tmp_path: Path) -> None:
    run = (
        "--dry-run",
        "--headless",
        "--no-check-camera",
        "--start",
        "random",
        "--goal",
        "I",
        "--seed",
        "1001",
        "--planner",
        "farthest",
    )
    assert execute(["shape", *run, "--out", str(tmp_path / "run")]) == 0
    path = tmp_path / "run" / FILE_NAME
    states = [one.message for one in read_recording(path, {"robot/state"}) if isinstance(one.message, RobotState)]
    far = max(states, key=lambda state: float(np.abs(state.q_rad - states[0].q_rad).max()))
    assert np.abs(far.q_rad - states[0].q_rad).max() > 0.2  # it moves in software
    with closing(RecordedScene(path, view_size_px=(160, 106))) as scene:
        pictures = [scene.view(state.stamp_ns) for state in (states[0], far)]
    assert apart(*pictures) < 0.1


def test_a_camera_that_saw_no_cell_has_no_scene(simulated_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = replace(recorded_config(simulated_run / FILE_NAME, PARTS), camera=RecordedCameraConfig())
    monkeypatch.setattr(recorded_scene, "recorded_config", lambda *_: config)
    with pytest.raises(InputError, match=r"its camera \(recorded\) saw no simulated cell"):
        RecordedScene(simulated_run / FILE_NAME)


def test_without_the_truth_there_is_no_scene() -> None:
    with pytest.raises(InputError, match=r"holds no truth\.npz"):
        RecordedScene(REFERENCES / "farthest.mcap")


def test_the_truth_of_another_run_is_refused(simulated_run: Path, tmp_path: Path) -> None:
    shutil.copy(simulated_run / FILE_NAME, tmp_path)
    with np.load(simulated_run / "truth.npz") as truth:
        later_ns = truth["stamps_ns"] + 3_600_000_000_000
        np.savez(tmp_path / "truth.npz", stamps_ns=later_ns, nodes_world=truth["nodes_world"])
    with pytest.raises(InputError, match="is of another time"):
        RecordedScene(tmp_path / FILE_NAME)
