"""A damaged or cut recording is read as far as it can be, and every reader says what is missing."""

import logging
from pathlib import Path

import pytest
from damaged_recordings import chunks_of, cut_after, with_a_wrong_bit
from mcap.writer import Writer

from dlokit.app.library.recording import open_run
from dlokit.communication.topics import CLOCK
from dlokit.errors import InputError
from dlokit.recording.channels import recorded_topics
from dlokit.recording.reader import MessagesByTime, RawRecording, missing_part, read_recording
from dlokit.recording.writer import RecordingWriter
from dlokit.types.system import ClockTick

CHUNKS, OF_EACH = 4, 5


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Ticks in four chunks; the first one declares their channel."""
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, {"run": {"name": "I to S"}})
    for number in range(CHUNKS * OF_EACH):
        writer.add(recorded_topics()[CLOCK.name], number, ClockTick(stamp_ns=number))
        if number % OF_EACH == OF_EACH - 1:
            writer.flush()
    writer.close()
    assert len(chunks_of(path)) == CHUNKS
    return path


def of_another_program(folder: Path) -> Path:
    path = folder / "bag.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"float64[] position\n")
        writer.add_message(writer.register_channel("/joint_states", "cdr", schema), 0, b"\0" * 40, 0)
        writer.finish()
    return path


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_a_damaged_chunk_is_skipped_and_reading_goes_on(recording: Path, tmp_path: Path, chunk: int) -> None:
    path = with_a_wrong_bit(recording, chunk, tmp_path / "bit.mcap")
    lost = range(chunk * OF_EACH, (chunk + 1) * OF_EACH)
    assert [one.log_ns for one in read_recording(path)] == [n for n in range(CHUNKS * OF_EACH) if n not in lost]
    assert missing_part(path) == "1 of the chunks of bit.mcap are damaged and skipped"


def test_a_file_that_was_cut_is_read_to_there(recording: Path, tmp_path: Path) -> None:
    path = cut_after(recording, 0.5, tmp_path / "cut.mcap")
    assert 0 < sum(1 for _ in read_recording(path)) < CHUNKS * OF_EACH
    assert missing_part(path) == f"cut.mcap ends in the middle of its records, at byte {path.stat().st_size}"


def test_the_place_beyond_which_nothing_can_be_read_is_named(recording: Path, tmp_path: Path) -> None:
    # As a file system leaves a file after a power cut.
    data = recording.read_bytes()
    zeros = tmp_path / "zeros.mcap"
    zeros.write_bytes(data[:-400] + b"\xff" * 400)
    assert "zeros.mcap cannot be read beyond byte" in missing_part(zeros)


def test_a_part_that_was_cut_is_said_though_the_next_one_is_whole(recording: Path, tmp_path: Path) -> None:
    first = cut_after(recording, 0.5, tmp_path / "long.mcap")
    recording.rename(tmp_path / "long.001.mcap")
    assert missing_part(first).startswith("long.mcap ends in the middle")


def test_every_reader_says_once_what_is_missing(
    recording: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = with_a_wrong_bit(recording, 1, tmp_path / "bit.mcap")
    with caplog.at_level(logging.WARNING):
        assert len(list(read_recording(path))) == len(list(open_run(path)))
        MessagesByTime(path, {CLOCK.name}, ())
    assert [record.getMessage() for record in caplog.records] == [f"{path} is incomplete: {open_run(path).missing}."]
    caplog.clear()
    list(read_recording(recording))
    assert not caplog.records


def test_a_file_of_another_program_is_refused_by_name(tmp_path: Path) -> None:
    path = of_another_program(tmp_path)
    for read in (missing_part, open_run, lambda path: list(read_recording(path, {CLOCK.name}))):
        with pytest.raises(
            InputError, match=r"bag\.mcap has no message of dlokit, but /joint_states; give the recording"
        ):
            read(path)


def test_a_recording_without_a_message_is_incomplete(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    RecordingWriter(path, {}).close()
    assert list(RawRecording(path=path)) == []
    assert missing_part(path) == "it contains no message"
