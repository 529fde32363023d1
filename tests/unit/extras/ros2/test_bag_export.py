"""`dlokit export --to rosbag2`: a bag has what a live run publishes, read back by `rosbags` field by field."""

import importlib
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damaged_recordings import chunks_of, with_a_wrong_bit
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.errors import EXIT_OTHERWISE, InputError, MachineError
from dlokit.extras.ros2.bags import bag_export
from dlokit.extras.ros2.definitions import definitions_of
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.outgoing import PUBLISHED, Published, absolute
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import RawRecording, read_recording
from dlokit.recording.writer import RecordingWriter
from dlokit.system.config import Ros2Config, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.types.system import ClockTick

REFERENCES = Path(__file__).parents[3] / "replay" / "references"
RUN = REFERENCES / "farthest.mcap"
OTHER = REFERENCES / "wire.mcap"  # without pictures
ROS = definitions_of("jazzy")


@dataclass(frozen=True)
class Bag:
    """A bag by the topics of the table: QoS, times [ns] and decoded messages."""

    qos: dict[str, Any]
    messages: dict[str, list[tuple[int, Any]]]

    def of(self, row: Published) -> list[Any]:
        return [message for _, message in self.messages[absolute(row.topic)]]


def read(path: Path) -> Bag:
    found: dict[str, list[tuple[int, Any]]] = {}
    with Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            message = ROS.decode(connection.msgtype, bytes(data))
            found.setdefault(connection.topic, []).append((time_ns, message))
        offers = {one.topic: one.ext for one in reader.connections}
        qos = {topic: of.offered_qos_profiles for topic, of in offers.items() if isinstance(of, ConnectionExtRosbag2)}
        assert {one.topic: ROS.hash_of(one.msgtype) for one in reader.connections} == {
            one.topic: one.digest for one in reader.connections
        }
    return Bag(qos, found)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Bag:
    out = tmp_path_factory.mktemp("bags") / "out"
    assert execute(["export", str(RUN), "--to", "rosbag2", "--out", str(out)]) == 0
    return read(out / "farthest")


def recorded(topic: str) -> list[Any]:
    return [one.message for one in read_recording(RUN, {topic})]


def xyz(values: list[Any]) -> Any:
    return [[value.x, value.y, value.z] for value in values]


def stamp_of(header: Any) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def test_each_state_is_a_cloud_of_its_nodes_in_float32_with_its_stamp(bag: Bag) -> None:
    states, clouds = recorded("model/state"), bag.of(outgoing.DLO)
    assert len(clouds) == len(bag.of(outgoing.POSES)) == len(states)
    for state, cloud, poses in zip(states, clouds, bag.of(outgoing.POSES), strict=True):
        found = cloud.data.view("<f4").reshape(len(state.nodes_world), 6)
        np.testing.assert_array_equal(found[:, :3], state.nodes_world.astype(np.float32))
        np.testing.assert_array_equal(xyz([pose.position for pose in poses.poses]), state.nodes_world)
        assert stamp_of(cloud.header) == stamp_of(poses.header) == state.stamp_ns


def test_the_other_topics_have_a_message_for_each_recorded_one(bag: Bag) -> None:
    assert len(bag.of(outgoing.JOINTS)) == len(recorded("robot/state"))
    assert len(bag.of(outgoing.LEFT)) == len(bag.of(outgoing.RIGHT_INFO)) == len(recorded("perception/images"))
    (goal,), (path,) = recorded("model/goal"), bag.of(outgoing.GOAL)
    np.testing.assert_array_equal(xyz([one.pose.position for one in path.poses]), goal.nodes_world)
    for look, cloud in zip(recorded("perception/cloud"), bag.of(outgoing.CLOUD), strict=True):
        np.testing.assert_array_equal(cloud.data.view("<f4").reshape(-1, 3), look.points_world)
    for state, joints in zip(recorded("robot/state"), bag.of(outgoing.JOINTS), strict=True):
        np.testing.assert_array_equal(joints.position, state.q_rad)


def test_a_picture_is_the_recorded_one_and_its_calibration_beside_it(bag: Bag) -> None:
    for taken, left, info in zip(
        recorded("perception/images"), bag.of(outgoing.LEFT), bag.of(outgoing.LEFT_INFO), strict=True
    ):
        np.testing.assert_array_equal(left.data.reshape(taken.left.shape), taken.left)
        assert (info.k[0], info.k[2], info.width) == (
            taken.calibration.fx_px,
            taken.calibration.cx_px,
            taken.calibration.width_px,
        )
        assert stamp_of(left.header) == stamp_of(info.header) == taken.stamp_ns


def test_the_frames_are_there_from_the_start_and_the_camera_from_its_first_picture(bag: Bag) -> None:
    frames = [
        {one.child_frame_id: one.header.frame_id for one in static.transforms} for static in bag.of(outgoing.TF_STATIC)
    ]
    assert frames[0] == {"dlokit_world": "base_link"}
    assert frames[-1] == {"dlokit_world": "base_link", "dlokit_camera": "dlokit_world"}
    first_ns = min(time_ns for found in bag.messages.values() for time_ns, _ in found)
    assert bag.messages["/tf_static"][0][0] == first_ns


def test_the_bag_offers_each_topic_as_a_live_run(bag: Bag) -> None:
    rows = {absolute(row.topic): row for row in PUBLISHED}
    for topic, (qos,) in bag.qos.items():
        lasting = qos.durability is QosDurability.TRANSIENT_LOCAL
        assert (lasting, qos.depth) == (rows[topic].transient_local, rows[topic].depth)
        assert qos.reliability is QosReliability.RELIABLE


def test_the_last_status_has_the_end_of_the_run_and_diagnostics_come_each_second(bag: Bag) -> None:
    last = recorded("decision/flow")[-1]
    values = {one.key: one.value for one in bag.of(outgoing.STATUS)[-1].values}
    assert values["outcome"] == last.outcome.value
    assert float(values["rmse_m"]) == pytest.approx(last.rmse_m, abs=1e-6)
    assert values["action"] == str(last.actions)
    times_ns = [time_ns for time_ns, _ in bag.messages["/diagnostics"]]
    assert set(np.diff(times_ns)) == {1_000_000_000}
    assert times_ns[-1] > recorded("robot/state")[-1].stamp_ns - 1_000_000_000


def test_the_markers_of_the_action_are_deleted_at_the_end(bag: Bag) -> None:
    arrays = [{(one.ns, one.id): one.action for one in array.markers} for array in bag.of(outgoing.MARKERS)]
    assert ("grasp", 0) not in arrays[0]
    assert any(array.get(("grasp", 0)) == 0 for array in arrays)
    assert arrays[-1]["grasp", 0] == 2
    assert arrays[-1]["state", 0] == arrays[-1]["goal", 0] == 0


def copied(path: Path, config: RunConfig, clock: dict[str, str]) -> Path:
    """A recording of the reference's shapes with other metadata, as a run of this version writes them."""
    metadata = {"configuration": {"config.toml": to_toml(config)}, "clock": clock}
    writer = RecordingWriter(path, metadata)
    for one in read_recording(RUN, {topics.STATE.name}):
        writer.add(topics.STATE, one.log_ns, one.message)
    writer.close()
    return path


def test_times_are_those_of_the_wall_clock_and_the_frame_is_the_runs_own(tmp_path: Path) -> None:
    began_ns, config = 1_764_336_000_000_000_000, replace(RunConfig(), ros2=Ros2Config(frame="fr3_link0"))
    (tmp_path / "my-run").mkdir()
    copied(tmp_path / "my-run" / FILE_NAME, config, {"run_ns": "250", "real_ns": str(began_ns)})
    assert execute(["export", str(tmp_path / "my-run"), "--to", "rosbag2", "--out", str(tmp_path / "out")]) == 0
    found = read(tmp_path / "out" / "my-run")
    for state, (time_ns, cloud) in zip(
        read_recording(RUN, {"model/state"}), found.messages["/dlokit/dlo"], strict=True
    ):
        assert time_ns == state.log_ns + began_ns - 250
        assert stamp_of(cloud.header) == state.message.stamp_ns + began_ns - 250
    assert found.of(outgoing.TF_STATIC)[0].transforms[0].header.frame_id == "fr3_link0"


def test_the_same_recording_makes_the_same_bag(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        assert execute(["export", str(OTHER), "--to", "rosbag2", "--out", str(folder)]) == 0
    one, two = (folder / "wire" for folder in folders)
    assert [file.name for file in sorted(one.iterdir())] == ["metadata.yaml", "wire.mcap"]
    for file in one.iterdir():
        assert file.read_bytes() == (two / file.name).read_bytes()


def test_each_run_has_a_bag_of_its_own_name_which_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert execute(["export", str(RUN), str(OTHER), "--to", "rosbag2", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    for path in (RUN, OTHER):
        count = Counter(topic for topic, found in read(out / path.stem).messages.items() for _ in found).total()
        assert f"{out / path.stem}: {count} messages of {path}, stamped from 1970" in printed


def test_the_progress_goes_from_nothing_to_all_messages(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    bag_export.write([OTHER], tmp_path, lambda path, done, total: seen.append((done, total)))
    done = [one for one, _ in seen]
    assert done == sorted(done)
    assert {total for _, total in seen} == {seen[0][1]}
    assert done[0] == 0
    assert 0.5 * seen[0][1] < done[-1] < seen[0][1]


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interrupted_export_leaves_whole_bags_only(tmp_path: Path, error: type[BaseException]) -> None:
    def fail(path: Path, done: int, total: int) -> None:
        if path == RUN and done:
            raise error

    with pytest.raises(error):
        bag_export.write([OTHER, RUN], tmp_path, fail)
    assert [bag.name for bag in tmp_path.iterdir()] == ["wire"]
    assert read(tmp_path / "wire").of(outgoing.DLO)


def test_a_damaged_recording_is_exported_as_far_as_it_can_be_read(tmp_path: Path) -> None:
    path = with_a_wrong_bit(RUN, len(chunks_of(RUN)) // 2, tmp_path / FILE_NAME)
    assert execute(["export", str(path), "--to", "rosbag2", "--out", str(tmp_path / "out")]) == EXIT_OTHERWISE
    assert read(tmp_path / "out" / tmp_path.name).of(outgoing.JOINTS)


def without_settings(folder: Path) -> Path:
    RecordingWriter(folder / "bare.mcap", {}).close()
    return folder / "bare.mcap"


def of_nothing(folder: Path) -> Path:
    path, raw = folder / "nothing.mcap", RawRecording(path=RUN)
    next(iter(raw))
    writer = RecordingWriter(path, raw.metadata)
    writer.add(topics.CLOCK, 0, ClockTick(stamp_ns=0))
    writer.close()
    return path


def of_the_same_name(folder: Path) -> Path:
    (folder / "elsewhere").mkdir()
    return Path(shutil.copy(RUN, folder / "elsewhere" / RUN.name))


@pytest.mark.parametrize(
    ("other", "match"),
    [
        (without_settings, "has nothing that is published in ROS 2"),
        (of_nothing, "has nothing that is published in ROS 2"),
        (of_the_same_name, "two runs would be written to the bag farthest"),
    ],
)
def test_what_cannot_be_exported_is_refused_before_anything_is_written(
    tmp_path: Path, other: Callable[[Path], Path], match: str
) -> None:
    with pytest.raises(InputError, match=match):
        execute(["export", str(RUN), str(other(tmp_path)), "--to", "rosbag2", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_a_bag_needs_a_folder() -> None:
    with pytest.raises(InputError, match="--to rosbag2 needs a folder: give --out"):
        execute(["export", str(RUN), "--to", "rosbag2"])


def test_without_rosbags_the_error_names_the_package_to_install_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = importlib.import_module

    def without(name: str) -> Any:
        if name.startswith("rosbags"):
            raise ModuleNotFoundError(name)
        return load(name)

    monkeypatch.setattr(importlib, "import_module", without)
    with pytest.raises(MachineError, match=r"pip install .*\[ros2\]"):
        execute(["export", str(RUN), "--to", "rosbag2", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
