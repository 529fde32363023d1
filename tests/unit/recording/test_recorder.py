"""The recorder: its content, the file of a killed writer, and that its failure never ends a run."""

import logging
import shutil
import time
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from example_messages import EXAMPLES
from made_fixtures import FURNISHED

from dlokit.communication import topics
from dlokit.communication.wire import codec
from dlokit.errors import InputError
from dlokit.recording import foxglove
from dlokit.recording.reader import RawRecording, files_of, read_recording
from dlokit.recording.recorder import Recorder
from dlokit.recording.summary import summarise
from dlokit.recording.writer import RESERVE_BYTES, RecordingWriter
from dlokit.types.robot import RobotState
from dlokit.types.system import ClockTick, Heartbeat


class Now:
    """A clock that is set by hand."""

    ns = 0

    def __call__(self) -> int:
        return self.ns


def tick(number: int) -> ClockTick:
    return ClockTick(stamp_ns=number, seq=number)


def test_encoded_and_decoded_messages_are_recorded_with_their_time_of_arrival(tmp_path: Path) -> None:
    now = Now()
    with Recorder(tmp_path / "a.mcap", now, {"run": {"name": "x"}}, waits=True) as recorder:
        now.ns = 5
        recorder.put(topics.CLOCK, tick(1))
        now.ns = 7
        recorder.put(topics.CLOCK, codec.encode(tick(2)))
    recorder.put(topics.CLOCK, tick(3))  # a late message is not recorded

    assert [(one.log_ns, one.message.stamp_ns) for one in read_recording(tmp_path / "a.mcap")] == [(5, 1), (7, 2)]
    summary = summarise(tmp_path / "a.mcap")
    assert not summary.missing
    assert summary.metadata["run"] == {"name": "x"}


def test_the_first_message_is_noted_by_the_runs_clock_and_the_wall_clock(tmp_path: Path) -> None:
    now, before_ns = Now(), time.time_ns()
    with Recorder(tmp_path / "a.mcap", now, {}, waits=True) as recorder:
        for now.ns in (5, 7):
            recorder.put(topics.CLOCK, tick(now.ns))
    after_ns = time.time_ns()
    raw = RawRecording(path=tmp_path / "a.mcap")
    next(iter(raw))  # a file that is cut off has it as well
    assert raw.metadata["clock"]["run_ns"] == "5"
    assert before_ns <= int(raw.metadata["clock"]["real_ns"]) <= after_ns


def test_a_message_that_cannot_be_decoded_is_skipped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True) as recorder:
        recorder.put(topics.CLOCK, b"nonsense")
        recorder.put(topics.CLOCK, tick(1))
    assert "cell/clock not recorded" in caplog.text
    assert len(list(read_recording(tmp_path / "a.mcap"))) == 1


def test_a_flood_of_messages_that_cannot_be_decoded_is_one_line_of_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True) as recorder:
        for _ in range(500):
            recorder.put(topics.CLOCK, b"nonsense")
    assert len([message for message in caplog.messages if "not recorded" in message]) == 1


def test_skipped_images_are_counted_and_not_reported_as_lost(tmp_path: Path) -> None:
    now = Now()
    pair = codec.encode(EXAMPLES[topics.STEREO_IMAGES.name])
    with Recorder(tmp_path / "a.mcap", now, {}, waits=True) as recorder:
        for now.ns in range(0, 2_000_000_000, 100_000_000):  # 10 Hz for 2 s
            recorder.put(topics.STEREO_IMAGES, pair)
    summary = summarise(tmp_path / "a.mcap")
    assert summary.channels[topics.STEREO_IMAGES.name].count == 4
    assert summary.metadata["thinned"] == {topics.STEREO_IMAGES.name: "16"}
    assert summary.metadata["lost"] == {}


def test_states_of_an_arm_at_rest_are_counted_and_not_reported_as_lost(tmp_path: Path) -> None:
    now, example = Now(), EXAMPLES[topics.ROBOT_STATE.name]
    assert isinstance(example, RobotState)
    with Recorder(tmp_path / "a.mcap", now, {}, waits=True) as recorder:
        for seq in range(1, 301):  # 50 Hz for 6 s
            now.ns = seq * 20_000_000
            recorder.put(topics.ROBOT_STATE, msgspec.structs.replace(example, seq=seq, dq_rad_s=np.zeros(7)))
    summary = summarise(tmp_path / "a.mcap")
    recorded = summary.channels[topics.ROBOT_STATE.name].count
    assert recorded < 150
    assert summary.metadata["thinned"] == {topics.ROBOT_STATE.name: str(300 - recorded)}
    assert summary.metadata["lost"] == {}


def test_a_file_cut_anywhere_has_the_messages_flushed_before(tmp_path: Path) -> None:
    path = tmp_path / "whole.mcap"
    writer = RecordingWriter(path, {"run": {"name": "x"}})
    sizes: list[int] = []
    for number in range(1, 6):
        writer.add(topics.CLOCK, number, tick(number))
        writer.flush()
        sizes.append(path.stat().st_size)
    writer.close()
    data = path.read_bytes()
    for length in range(sizes[0], len(data) - 1, 7):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(data[:length])
        raw = RawRecording(path=cut)
        numbers = [record.log_time for _, record in raw]
        # The index of a chunk follows it: a cut there loses nothing.
        flushed = sum(size <= length for size in sizes)
        assert numbers[:flushed] == list(range(1, flushed + 1))
        assert raw.metadata["run"] == {"name": "x"}
        assert raw.missing


def test_a_full_disk_is_logged_once_and_the_run_continues(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING), Recorder(Path("/dev/full"), Now(), {}, waits=True) as recorder:
        for number in range(1, 5000):  # more than the queue holds
            recorder.put(topics.CLOCK, tick(number))
    (record,) = caplog.records
    assert "recording_failed: /dev/full" in record.message
    assert "No space left on device" in record.message


def test_a_disk_that_fills_up_later_ends_the_recording_and_not_the_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_space(self: RecordingWriter) -> None:
        raise OSError(28, "No space left on device")

    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True) as recorder:
        recorder.put(topics.CLOCK, tick(1))
        monkeypatch.setattr(RecordingWriter, "close", no_space)
    assert "recording_failed" in caplog.text


def test_the_reason_of_a_failure_is_handed_on(tmp_path: Path) -> None:
    reasons: list[str] = []
    with Recorder(Path("/dev/full"), Now(), {}, waits=True, failed=reasons.append) as recorder:
        recorder.put(topics.CLOCK, tick(1))
    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True, failed=reasons.append) as recorder:
        recorder.put(topics.CLOCK, tick(1))
    assert reasons == ["No space left on device"]


def test_a_recording_that_was_deleted_meanwhile_has_failed(tmp_path: Path) -> None:
    reasons: list[str] = []
    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True, failed=reasons.append) as recorder:
        recorder.put(topics.CLOCK, tick(1))
        while not (tmp_path / "a.mcap").exists():
            recorder.put(topics.CLOCK, tick(1))
        (tmp_path / "a.mcap").unlink()
    assert reasons == ["No such file or directory"]


def test_a_recording_leaves_room_for_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    writer.flush()
    monkeypatch.setattr(shutil, "disk_usage", lambda handle: SimpleNamespace(free=RESERVE_BYTES - 1))  # pyright: ignore[reportUnknownArgumentType]
    with pytest.raises(OSError, match="less than 32 MB are free"):
        writer.flush()
    writer.abandon()


def written_in_parts(path: Path, messages: int, largest_bytes: int) -> None:
    """A recording with a file for each message."""
    writer = RecordingWriter(path, {"run": {"name": "x"}}, part_bytes=1, largest_bytes=largest_bytes)
    for number in range(1, messages + 1):
        # In other files the same channel has other numbers.
        for topic in (topics.CLOCK, topics.HEARTBEAT) if number % 2 else (topics.HEARTBEAT, topics.CLOCK):
            writer.add(topic, number, tick(number) if topic is topics.CLOCK else BEAT)
        writer.flush()
    writer.close()


BEAT = Heartbeat(stamp_ns=1, seq=1, holder="x")


def test_a_large_recording_continues_in_other_files_and_is_read_as_one(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written_in_parts(path, 4, largest_bytes=1_000_000)
    assert [file.name for file in files_of(path)] == ["a.mcap", *(f"a.{number:03d}.mcap" for number in range(1, 5))]
    ticks = [one.message.stamp_ns for one in read_recording(path) if one.topic == topics.CLOCK.name]
    assert ticks == [1, 2, 3, 4]
    summary = summarise(path)
    assert not summary.missing
    assert summary.files == 5
    assert summary.channels[topics.CLOCK.name].schema == "dlokit.ClockTick"
    assert summary.channels[topics.HEARTBEAT.name].schema == "dlokit.Heartbeat"
    assert [one.log_ns for one in read_recording(tmp_path / "a.002.mcap", {topics.CLOCK.name})] == [3]  # a file alone


def test_each_file_shows_the_fixtures_once_before_its_first_message(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, {}, part_bytes=1, edges_world=FURNISHED.edges_world)
    for number in (1, 2):
        for _ in range(2):
            writer.add(topics.CLOCK, number, tick(number))
        writer.flush()
    writer.close()
    records = list(RawRecording(path=path))
    assert [channel for channel, _ in records] == 2 * ["view/scene", topics.CLOCK.name, topics.CLOCK.name]
    for number, first in enumerate((records[0], records[3]), start=1):
        (entity,) = foxglove.SceneUpdate.FromString(first[1].data).entities
        assert (entity.id, entity.timestamp.nanos) == ("fixtures", number)
        (lines,) = entity.lines
        assert lines.type == foxglove.LinePrimitive.LINE_LIST
        points = np.array([(point.x, point.y, point.z) for point in lines.points])
        np.testing.assert_array_equal(points.reshape(-1, 2, 3), FURNISHED.edges_world)


def test_a_recording_of_many_chunks_continues_in_other_files_and_an_idle_flush_ends_none(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, {}, part_chunks=2)
    for number in range(1, 6):
        writer.add(topics.CLOCK, number, tick(number))
        for _ in range(3):
            writer.flush()  # nothing waits after the first: no chunk
    writer.close()
    assert [file.name for file in files_of(path)] == ["a.mcap", "a.001.mcap", "a.002.mcap"]
    assert [one.log_ns for one in read_recording(path)] == [1, 2, 3, 4, 5]


def test_of_a_recording_that_is_too_large_the_first_file_and_the_newest_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written_in_parts(path, 5, largest_bytes=1_000_000)
    size = max(file.stat().st_size for file in files_of(path))
    for file in files_of(path):
        file.unlink()
    written_in_parts(path, 5, largest_bytes=round(2.5 * size))
    assert [file.name for file in files_of(path)] == ["a.mcap", "a.004.mcap", "a.005.mcap"]
    assert [one.log_ns for one in read_recording(path, {topics.CLOCK.name})] == [1, 5]
    assert summarise(path).metadata["deleted"] == {"files": "3"}


@pytest.mark.parametrize(
    ("content", "match"),
    [(None, "cannot be read"), (b"", "is empty"), (b"x,y,z\n1,2,3\n", "is not an MCAP file")],
)
def test_a_file_that_is_not_a_recording_is_refused(tmp_path: Path, content: bytes | None, match: str) -> None:
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=f"a.mcap {match}.*give the recording.mcap of a run's folder"):
        list(read_recording(path))
