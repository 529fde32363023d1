"""Lockstep recordings: all topics and calls, identical for the same seed, and without the true shape."""

from dataclasses import replace
from pathlib import Path

import pytest

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topics import ARM_STATE, CLOCK, DEPTH_IMAGES, OBSERVATION, ROBOT_STATE, STEREO_IMAGES, TOPICS
from dlokit.functional.cameras.simulated import SimulatedD435Config
from dlokit.recording.channels import CALLS, FILE_NAME, SKILL_CALLS
from dlokit.recording.disk import Disk
from dlokit.recording.message_json import to_json
from dlokit.recording.reader import RawRecording, read_recording
from dlokit.recording.views import VIEWS
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.configuration.toml_config import from_toml
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import lockstep_system
from dlokit.system.replay import replay, replayable
from dlokit.system.results.recording import lockstep_recorder
from dlokit.types.outcome import CallBegun, CallRecord, Succeeded

CONFIG = RunConfig(headless=True, seed=3)


async def look_once(folder: Path, config: RunConfig) -> None:
    job = job_from_config(config)
    with lockstep_recorder(config, job.name, folder, LoopClock(), Disk()) as recorder:
        async with lockstep_system(config, job.start_nodes_world, folder, recorder) as system:
            await system.clock.sleep(0.1)  # the arm's first state
            assert isinstance(await system.transport.call(robot.HOME), Succeeded)
            assert isinstance(await system.transport.call(perception.LOOK), Succeeded)


def recorded(folder: Path, config: RunConfig) -> Path:
    folder.mkdir()
    virtual_time.run(look_once(folder, config))
    return folder / FILE_NAME


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("runs")
    return [recorded(root / name, CONFIG) for name in ("one", "two")]


def test_two_recordings_of_one_seed_have_equal_messages_at_equal_times(twice: list[Path]) -> None:
    one, two = ([(r.topic, r.log_ns, to_json(r.message)) for r in read_recording(path)] for path in twice)
    assert one == two


def test_a_run_seen_by_the_depth_camera_is_recorded_and_replayed_into_perception(tmp_path: Path) -> None:
    path = recorded(tmp_path / "depth", replace(CONFIG, camera=SimulatedD435Config()))
    channels = {channel for channel, _ in RawRecording(path=path)}
    assert channels >= {DEPTH_IMAGES.name, "view/colour", "view/depth", "view/camera"}
    assert not channels & {STEREO_IMAGES.name, "view/left", "view/right"}
    done = replay(path, "perception", recorded_config(path, replayable()["perception"]))
    assert any(row.field == "points_world" and row.compared == 1 for row in done.rows)
    assert [row.field for row in done.rows if not row.within] == []


def test_a_recording_has_all_messages_on_the_bus_and_only_clock_and_arm_of_the_cell(twice: list[Path]) -> None:
    channels = {channel for channel, _ in RawRecording(path=twice[0])}
    assert channels >= {CLOCK.name, ARM_STATE.name, ROBOT_STATE.name, STEREO_IMAGES.name, OBSERVATION.name}
    assert channels >= {SKILL_CALLS.name, "view/left", "view/cloud", "view/tool"}
    assert channels <= {topic.name for topic in (*TOPICS, *CALLS)} | set(VIEWS)
    assert {channel for channel in channels if channel.startswith("cell")} == {CLOCK.name, ARM_STATE.name}


def test_drivers_calls_of_the_cell_are_not_recorded(twice: list[Path]) -> None:
    calls = [one.message for one in read_recording(twice[0], {topic.name for topic in CALLS})]
    skills = {call.skill for call in calls if isinstance(call, CallBegun | CallRecord)}
    assert skills == {"robot.home", "perception.look"}


def test_a_recording_holds_the_configuration_and_the_versions_of_its_run(twice: list[Path]) -> None:
    raw = RawRecording(path=twice[0])
    assert list(raw)
    assert from_toml(raw.metadata["configuration"]["config.toml"], RunConfig, "the recording") == CONFIG
    assert raw.metadata["run"]["name"] == "I to S"
    assert set(raw.metadata["versions"]) >= {"dlokit", "python", "mujoco", "numpy"}


def test_the_option_no_record_records_nothing(tmp_path: Path) -> None:
    async def nothing() -> None:
        config = RunConfig(headless=True, record=False)
        with lockstep_recorder(config, "I to S", tmp_path, LoopClock(), Disk()) as recorder:
            assert recorder is None

    virtual_time.run(nothing())
    assert list(tmp_path.iterdir()) == []
