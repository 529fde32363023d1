"""The recorder: its content, the file of a killed writer, and that its failure never ends a run."""

import logging
from pathlib import Path

import msgspec
import numpy as np
import pytest
from example_messages import EXAMPLES

from dlokit.communication import topics
from dlokit.communication.wire import codec
from dlokit.errors import InputError
from dlokit.recording.reader import RawRecording, read_recording
from dlokit.recording.recorder import Recorder
from dlokit.recording.summary import summarise
from dlokit.recording.writer import RecordingWriter
from dlokit.types.robot import RobotState
from dlokit.types.system import ClockTick


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
    assert summary.whole
    assert summary.metadata["run"] == {"name": "x"}


def test_a_message_that_cannot_be_decoded_is_skipped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with Recorder(tmp_path / "a.mcap", Now(), {}, waits=True) as recorder:
        recorder.put(topics.CLOCK, b"nonsense")
        recorder.put(topics.CLOCK, tick(1))
    assert "cell/clock not recorded" in caplog.text
    assert len(list(read_recording(tmp_path / "a.mcap"))) == 1


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
        assert not raw.whole


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
