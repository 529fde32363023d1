"""Each skill call is recorded at its end, whatever its outcome."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topic import Topic
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.recording.call_log import CallLog, record_of
from dlokit.recording.message_json import to_json
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun, CallEnd, CallRecord, Succeeded, Unreachable
from dlokit.types.pose import Pose


def _act(how: str, for_s: float = 0.5) -> int:
    """Act."""
    ...


def _place(pose: Pose, speed: float) -> None:
    """Place."""
    ...


ACT = Skill("model", "act", _act, timeout_s=2.0)
ELSEWHERE = Skill("nobody", "act", _act, timeout_s=2.0)
PLACE = Skill("model", "place", _place, timeout_s=2.0)
CABLE = Skill("cell", "act", _act, timeout_s=2.0)


class Actor(Component):
    name = "model"

    @implements(ACT)
    async def act(self, how: str, for_s: float = 0.5) -> int:
        await self.port.clock.sleep(for_s)
        if how == "fail":
            raise SkillFailure("slipped", "by 3 mm")
        if how == "reject":
            raise SkillRejected("busy")
        return 7


def told_of(*hows: tuple[str, float]) -> list[CallBegun | CallRecord]:
    records: list[CallBegun | CallRecord] = []

    def put(topic: Topic[Any], message: Message | Callable[[], Message]) -> None:
        made = message if isinstance(message, Message) else message()
        assert isinstance(made, CallBegun | CallRecord)
        records.append(made)

    async def main() -> None:
        clock = LoopClock()
        log = MemoryTransport(call_log=CallLog(clock.now_ns, put, unlogged=frozenset({"cell"})))
        host = Container(log, clock)
        host.add(Actor())
        async with host:
            for how, for_s in hows:
                await log.call(ACT, how, for_s)
            assert isinstance(await log.call(ELSEWHERE, "x"), Unreachable)
            assert isinstance(await log.call(CABLE, "x"), Unreachable)
            task = asyncio.create_task(log.call(ACT, "be cancelled"))
            await clock.sleep(0.1)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

    virtual_time.run(main())
    return records


def records_of(*hows: tuple[str, float]) -> list[CallRecord]:
    return [one for one in told_of(*hows) if isinstance(one, CallRecord)]


def test_the_start_of_a_call_is_recorded_with_the_number_of_its_end() -> None:
    told = told_of(("succeed", 0.5), ("fail", 0.0))
    assert [(type(one), one.skill, one.call, one.caller) for one in told[:4]] == [
        (CallBegun, "model.act", 1, "memory"),
        (CallRecord, "model.act", 1, "memory"),
        (CallBegun, "model.act", 2, "memory"),
        (CallRecord, "model.act", 2, "memory"),
    ]
    assert [one.stamp_ns for one in told[:2]] == [0, 500_000_000]


def test_every_outcome_is_recorded_with_reason_start_and_end() -> None:
    records = records_of(("succeed", 0.5), ("fail", 0.0), ("reject", 0.0), ("time out", 3.0))
    assert [(one.skill, one.outcome, one.reason, one.detail) for one in records] == [
        ("model.act", CallEnd.SUCCEEDED, "", ""),
        ("model.act", CallEnd.FAILED, "slipped", "by 3 mm"),
        ("model.act", CallEnd.REJECTED, "busy", ""),
        ("model.act", CallEnd.TIMED_OUT, "", "it had not ended after 2 s and was cancelled"),
        (
            "nobody.act",
            CallEnd.UNREACHABLE,
            "",
            "nobody does not answer; it is not running",
        ),  # calls between a driver and its device are not recorded
        ("model.act", CallEnd.CANCELLED, "", ""),
    ]
    assert [one.seq for one in records] == [1, 2, 3, 4, 5, 6]
    assert (records[0].began_ns, records[0].stamp_ns) == (0, 500_000_000)
    assert (records[0].arguments, records[0].result) == ('{"how": "succeed", "for_s": 0.5}', "7")


def test_arguments_are_recorded_as_their_message_types() -> None:
    pose = Pose(position_m=np.array([0.1, 0.2, 0.3]), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))
    arguments = PLACE.request("id-1", "caller", pose, float("inf")).arguments
    bare = CallRecord(stamp_ns=0, skill=PLACE.key, outcome=CallEnd.CANCELLED)
    record = record_of(bare, Succeeded(result=None), arguments)
    assert record.arguments == f'{{"pose": {to_json(pose).decode()}, "speed": "Infinity"}}'
