"""A bus that is disturbed: late in order, or altered now and then; and not before it is told to be."""

import random
import threading
from pathlib import Path

from dlokit.bench.faults import disturbance
from dlokit.bench.faults.disturbance import FILE_NAME, Kind, Line, disturb, kind_in

PAYLOAD = bytes(100)


def altered(folder: Path, kind: Kind, messages: int) -> list[bytes]:
    disturb(folder, kind)
    line = Line(folder / FILE_NAME, random.Random(0))
    return [data for _ in range(messages) if (data := bytes(line.altered(PAYLOAD))) != PAYLOAD]


def test_a_bus_that_nobody_disturbs_carries_everything_at_once_as_it_is(tmp_path: Path) -> None:
    line = Line(tmp_path / FILE_NAME, random.Random(0))
    sent: list[int] = []
    line.send(lambda: sent.append(1))
    assert sent == [1]
    assert kind_in(tmp_path / FILE_NAME) is Kind.NONE
    assert not altered(tmp_path, Kind.NONE, 1000)


def test_one_message_of_a_hundred_has_one_byte_altered(tmp_path: Path) -> None:
    found = altered(tmp_path, Kind.ALTERED, 10_000)
    assert 60 <= len(found) <= 140  # four standard deviations about 100
    assert all(sum(byte != 0 for byte in data) == 1 for data in found)


def test_late_messages_keep_their_order_also_when_the_bus_is_well_again(tmp_path: Path) -> None:
    disturb(tmp_path, Kind.LATE)
    line = Line(tmp_path / FILE_NAME, random.Random(0))
    arrived, last = list[int](), threading.Event()
    line.send(lambda: arrived.append(1))
    assert arrived == []
    disturb(tmp_path, Kind.NONE)
    threading.Event().wait(2 * disturbance.LOOK_EVERY_S)  # until the line has looked again
    line.send(lambda: (arrived.append(2), last.set()))
    assert last.wait(60.0)
    assert arrived == [1, 2]
