"""The shared memory of the Franka: whole or nothing, whatever happens to its writers."""

import fcntl
import os
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dlokit.extras.franka import channel as under_test
from dlokit.extras.franka.channel import (
    MOST_SAMPLES,
    Channel,
    ChannelError,
    HandState,
    Latch,
    Samples,
    StreamState,
    Word,
    path_of,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return path_of("127.0.0.1", tmp_path)


@pytest.fixture
def shared(path: Path) -> Iterator[Channel]:
    with Channel(path) as channel:
        yield channel


def state(number: int) -> StreamState:
    """A state of which every value says its number."""
    value = float(number)
    return StreamState(
        read_ns=number,
        robot_ms=number,
        phase=number,
        motion_id=number,
        ending=number,
        mode=number,
        errors=number,
        turns=number,
        largest_error_rad=value,
        mean_error_rad=value,
        took_s=value,
        q=(value,) * 7,
        dq=(value,) * 7,
        tau=(value,) * 7,
        wrench=(value,) * 6,
        T_base_tool=(value,) * 16,
        T_flange_tool=(value,) * 16,
        tool_kg=value,
        load_kg=value,
    )


def test_another_mapping_reads_what_one_has_written(shared: Channel, path: Path) -> None:
    with Channel(path) as other:
        assert other.read_state() is None
        assert other.read_hand() is None
        assert other.read_text() == ""
        shared.write_state(state(3))
        hand = HandState(4, 5, 1, 0, 0.01, 0.08, 0.07)
        shared.write_hand(hand)
        shared.write_text("the arm said no: wähle 1")
        shared[Word.BRAKE_ID] = 7
        assert other.read_state() == state(3)
        assert other[Word.STATE_NS] == 3
        assert other.read_hand() == hand
        assert other.read_text() == "the arm said no: wähle 1"
        assert other[Word.BRAKE_ID] == 7


def test_a_latched_stop_outlives_every_process_that_maps_it(path: Path) -> None:
    with Channel(path) as channel:
        channel[Word.LATCH] = Latch.PERSON
    with Channel(path) as later:
        assert later[Word.LATCH] == Latch.PERSON


def test_a_trajectory_arrives_bit_by_bit_and_a_damaged_one_does_not(shared: Channel, path: Path) -> None:
    random = np.random.default_rng(0)
    times, q, dq = np.arange(50) * 0.005, random.normal(size=(50, 7)), random.normal(size=(50, 7))
    shared.post(Samples(times=times.tobytes(), q=q.tobytes(), dq=dq.tobytes()), 9)
    with Channel(path) as other:
        assert other[Word.FOLLOW_ID] == 9
        posted = other.posted()
        assert posted is not None
        np.testing.assert_array_equal(np.frombuffer(posted.times), times)
        np.testing.assert_array_equal(np.frombuffer(posted.q).reshape(-1, 7), q)
        np.testing.assert_array_equal(np.frombuffer(posted.dq).reshape(-1, 7), dq)
        other[Word.FOLLOW_SUM] += 1
        assert other.posted() is None
        other[Word.FOLLOW_SAMPLES] = MOST_SAMPLES + 1
        assert other.posted() is None


def test_the_longest_trajectory_fits_and_a_longer_one_is_refused(shared: Channel) -> None:
    def post(count: int) -> None:
        shared.post(Samples(times=bytes(8 * count), q=bytes(56 * count), dq=bytes(56 * count)), 1)

    post(MOST_SAMPLES)
    assert shared.posted() is not None
    with pytest.raises(ChannelError, match="at most 48000 fit"):
        post(MOST_SAMPLES + 1)


def test_a_reader_beside_a_writer_sees_whole_states_only(shared: Channel, path: Path) -> None:
    over = threading.Event()

    def write() -> None:
        number = 1
        while not over.is_set():
            shared.write_state(state(number))
            number += 1

    writer = threading.Thread(target=write)
    writer.start()
    with Channel(path) as other:
        seen = 0
        try:
            while seen < 2000:
                found = other.read_state()
                if found is not None:
                    assert found == state(found.read_ns)
                    seen += 1
        finally:
            over.set()
            writer.join()


def test_a_writer_that_died_in_the_middle_of_a_state_blocks_no_reader_and_a_new_one_writes_on(shared: Channel) -> None:
    shared.write_state(state(1))
    at = under_test._STATE_AT  # pyright: ignore[reportPrivateUsage]
    raw = shared._map  # pyright: ignore[reportPrivateUsage]
    (sequence,) = struct.unpack_from("q", raw, at)
    struct.pack_into("q", raw, at, sequence + 1)
    raw[at + 40 : at + 48] = b"\xff" * 8
    assert shared.read_state() is None
    shared.write_state(state(2))
    assert shared.read_state() == state(2)


def test_a_damaged_state_is_none(shared: Channel) -> None:
    shared.write_state(state(1))
    raw = shared._map  # pyright: ignore[reportPrivateUsage]
    at = under_test._STATE_AT + 40  # pyright: ignore[reportPrivateUsage]
    raw[at] ^= 1
    assert shared.read_state() is None


def test_a_file_of_another_version_or_a_link_is_refused(path: Path, tmp_path: Path) -> None:
    with Channel(path) as channel:
        channel[Word.MAGIC] = 12
    with pytest.raises(ChannelError, match="another version of dlokit"):
        Channel(path)
    link = tmp_path / "link"
    link.symlink_to(path)
    with pytest.raises(ChannelError, match="cannot be used"):
        Channel(link)


def test_one_arm_has_one_file_that_only_its_user_may_read(shared: Channel, path: Path, tmp_path: Path) -> None:
    assert path_of("arm.lab/../x", tmp_path).parent == tmp_path
    assert path.stat().st_mode & 0o077 == 0
    fcntl.flock(shared.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with Channel(path) as other, pytest.raises(BlockingIOError):
        fcntl.flock(other.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert not os.get_inheritable(shared.file)
