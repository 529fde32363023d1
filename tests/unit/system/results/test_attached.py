"""Another process records a running system: last states, new messages, all calls, in a complete file."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from buses import MemoryBuses, new_bus

from dlokit.app.data.record import RecordArgs, result, run
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.timing import virtual_time
from dlokit.errors import InputError
from dlokit.recording.reader import read_recording
from dlokit.recording.summary import summarise
from dlokit.recording.writer import RecordingWriter
from dlokit.skills.model import api as model
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.processes.bus import JoinedBus, calls_published
from dlokit.system.processes.running import RunningSystem, announced, the_running_system
from dlokit.system.results.recording import record_until_ended
from dlokit.system.table import TimeBase
from dlokit.types.dlo import GoalShape
from dlokit.types.outcome import Succeeded
from dlokit.types.system import ClockTick

ROUNDS = 30


class Model(Component):
    name = "model"

    @implements(model.SETTLE)
    async def settle(self, nodes_world: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        return nodes_world


def goal(seq: int, name: str) -> GoalShape:
    return GoalShape(stamp_ns=seq, seq=seq, nodes_world=np.zeros((2, 3)), name=name)


async def tick(bus: JoinedBus) -> None:
    seq = 0
    while True:
        seq += 1
        bus.transport.publish(topics.CLOCK, ClockTick(stamp_ns=seq * 10_000_000, seq=seq))
        await asyncio.sleep(0.01)


async def recorded(system: RunningSystem, path: Path) -> None:
    """Run a small system, attach to it, let it act, and stop recording."""
    buses = MemoryBuses()
    async with buses.join(system.bus, TimeBase.MACHINE) as bus:
        host = Container(bus.transport, bus.clock)
        host.add(Model())
        async with host:
            ticking = asyncio.create_task(tick(bus))
            bus.transport.publish(topics.GOAL, goal(4, "before"))
            attached = asyncio.Event()
            recording = asyncio.create_task(record_until_ended(system, path, lambda _: attached.set(), buses.join))
            await asyncio.wait({recording, asyncio.create_task(attached.wait())}, return_when=asyncio.FIRST_COMPLETED)
            for seq in range(5, 5 + ROUNDS):
                bus.transport.publish(topics.GOAL, goal(seq, "after"))
                with calls_published(bus.transport, bus.clock):
                    settled = await bus.transport.call(model.SETTLE, np.ones((2, 3)))
                assert isinstance(settled, Succeeded)
                await asyncio.sleep(0.01)
            recording.cancel()
            await asyncio.wait({recording})
            ticking.cancel()


@pytest.fixture
def system(tmp_path: Path) -> Iterator[RunningSystem]:
    """This process, presented as a running system."""
    (tmp_path / "config.toml").write_text(to_toml(RunConfig(seed=7)))
    with announced(tmp_path, new_bus()) as note:
        note.ready()
        yield the_running_system(tmp_path)


def test_last_states_new_messages_and_calls_are_recorded_in_a_complete_file(
    system: RunningSystem, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    virtual_time.run(recorded(system, path))
    lines, code = result(path)
    assert code == 0
    assert f"including {ROUNDS} skill calls" in "".join(lines)
    summary = summarise(path)
    assert not summary.missing
    assert summary.metadata["run"]["attached"]
    assert "seed = 7" in summary.metadata["configuration"]["config.toml"]
    assert summary.calls["model.settle"].outcomes["succeeded"] == ROUNDS
    assert summary.channels["skill_calls_begun"].count == ROUNDS
    assert summary.channels["cell/clock"].count >= ROUNDS - 1
    goals = [one.message for one in read_recording(path, {"model/goal"})]
    assert [one.seq for one in goals] == [4, *range(5, 5 + ROUNDS)]  # the last state from before, and each new one once


def test_a_file_that_exists_is_not_overwritten(system: RunningSystem, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"a\.mcap exists; recordings are never overwritten"):
        run(RecordArgs(out=path, run=Path(system.folder)))
    assert path.read_text() == "mine"


def test_a_recording_that_cannot_be_written_ends_with_the_cause(system: RunningSystem, tmp_path: Path) -> None:
    async def attached() -> str:
        buses = MemoryBuses()
        async with buses.join(system.bus, TimeBase.MACHINE) as bus:
            ticking = asyncio.create_task(tick(bus))
            (tmp_path / "a.mcap").mkdir()
            ended = await record_until_ended(system, tmp_path / "a.mcap", lambda _: None, buses.join)
            ticking.cancel()
            return ended

    assert virtual_time.run(attached()) == "the recording has ended: Is a directory"
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError, match=r"folder of .*b\.mcap cannot be created: .*mine\.txt"):
        run(RecordArgs(out=tmp_path / "mine.txt" / "b.mcap", run=Path(system.folder)))


def test_a_recording_that_lacks_something_ends_with_3_and_says_what(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    assert result(path) == ([f"{path}: nothing was recorded, and there is no file"], 3)
    writer = RecordingWriter(path, {})
    writer.close()
    (_, said), code = result(path)
    assert (said, code) == ("nothing was recorded: no message came while this command ran", 3)
    writer = RecordingWriter(path, {})
    for seq in range(1, 5):
        writer.add(topics.CLOCK, seq, ClockTick(stamp_ns=seq, seq=seq))
    writer.add_metadata("lost", {"robot/state": "4"})
    writer.close()
    (_, said), code = result(path)
    assert said.startswith("4 messages were not recorded, because the disk was slow")
    assert code == 3
    path.write_bytes(path.read_bytes()[:-80])
    (_, said, _), code = result(path)
    assert said.startswith("the recording is incomplete: a.mcap")
    assert code == 3
