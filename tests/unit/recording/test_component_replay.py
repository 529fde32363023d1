"""A component is replayed: its messages and answers equal the recorded ones, or the difference is named."""

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import pytest
from synthetic_clouds import LENGTH_M, NODES, cloud, shape, state

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topic import Topic
from dlokit.errors import SkillFailure
from dlokit.recording.call_log import CallLog
from dlokit.recording.comparison import FieldRow, compare, tolerance_of
from dlokit.recording.component_replay import RecordedCall, ReplayResult, Timeline, feed, read_timeline
from dlokit.recording.recorder import Recorder
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.api import INITIALISE
from dlokit.skills.observer.component import ObserverComponent
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.perception.api import LOOK
from dlokit.system.processes.bus import CABLES
from dlokit.types.dlo import DloBelief, LogNormal
from dlokit.types.flow import FlowStatus
from dlokit.types.message import Message
from dlokit.types.outcome import CallEnd, CallRecord, Cancelled, Succeeded

Stamped = TypeVar("Stamped", bound=Message)
STEP_NS = 100_000_000


def at(number: int, message: Stamped) -> Stamped:
    return msgspec.structs.replace(message, stamp_ns=number * STEP_NS)


def _add(amount: int, after_s: float = 0.0) -> int:
    """Add to the sum."""
    ...


ADD = Skill("model", "add", _add, timeout_s=5.0)


class Adder(Component):
    """Adds up the actions of flow messages and calls, and publishes the sum at each."""

    name = "model"
    publishes = (topics.BELIEF,)

    def __init__(self, error: int = 0) -> None:
        self._sum = 0
        self._error = error

    async def run(self) -> None:
        self._tell()

    @on(topics.FLOW)
    async def on_flow(self, status: FlowStatus) -> None:
        self._sum += status.actions
        self._tell()

    @implements(ADD)
    async def add(self, amount: int, after_s: float = 0.0) -> int:
        await self.port.clock.sleep(after_s)
        if amount < 0:
            raise SkillFailure("negative")
        self._sum += amount
        self._tell()
        return self._sum + self._error

    def _tell(self) -> None:
        one = LogNormal(value=1.0)
        self.port.publish(
            topics.BELIEF,
            DloBelief(
                stamp_ns=self.port.clock.now_ns(), length_m=one, radius_m=one, bending_stiffness_n_m2=one,
                weight_n_m=one, friction=one, elastic_m3=one, actions=self._sum + self._error,
            ),
        )  # fmt: skip


def recorded_run(path: Path) -> Timeline:
    """Messages and calls whose order matters, also at the same time."""

    async def main() -> None:
        clock = LoopClock()
        with Recorder(path, clock.now_ns, {}, waits=True) as recorder:
            bus = MemoryTransport(recorder.put, CallLog(clock.now_ns, recorder.put, unlogged=CABLES))
            host = Container(bus, clock)
            host.add(Adder())
            async with host:
                await clock.sleep(0.5)
                bus.publish(topics.FLOW, FlowStatus(stamp_ns=0, flow="f", step="s", actions=2))
                await bus.call(ADD, 3, 0.25)
                await bus.call(ADD, -1)
                late = asyncio.create_task(bus.call(ADD, 100, 2.0))
                await clock.sleep(0.1)
                late.cancel()
                await asyncio.wait({late})
                bus.publish(topics.FLOW, FlowStatus(stamp_ns=0, flow="f", step="s", actions=5))
                await bus.call(ADD, 7)

    virtual_time.run(main())
    return read_timeline(path, Adder, Adder.publishes)


def rows_of(line: Timeline, component: Component, *, live: bool = False) -> list[FieldRow]:
    return compare(line, feed(component, line, Adder.publishes), live=live, same_processor=False)


def test_a_timeline_has_inputs_calls_and_outputs_in_order(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    order = [event.skill.key if isinstance(event, RecordedCall) else event.topic.name for event in line.events]
    assert order == ["decision/flow", "model.add", "model.add", "model.add", "decision/flow", "model.add"]
    assert [dict(event.arguments)["amount"] for event in line.events if isinstance(event, RecordedCall)] == [
        3,
        -1,
        100,
        7,
    ]
    assert [one.message.stamp_ns for one in line.published if one.topic is topics.BELIEF][:3] == [0, 5e8, 7.5e8]
    assert (line.begin_ns, line.unknown) == (0, 0)


def test_a_replayed_component_publishes_and_answers_the_same_at_the_same_times(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    replayed = feed(Adder(), line, Adder.publishes)
    assert [one.log_ns for one in replayed.published] == [one.log_ns for one in line.published]
    ends = [asked.answer.outcome for asked, _ in replayed.answers]
    assert ends == [CallEnd.SUCCEEDED, CallEnd.FAILED, CallEnd.CANCELLED, CallEnd.SUCCEEDED]
    assert isinstance(replayed.answers[2][1], Cancelled)
    rows = compare(line, replayed, live=False, same_processor=False)
    assert all(row.within and row.largest == 0.0 for row in rows)
    counts = {(row.what, row.field): row.compared for row in rows}
    assert counts["model/belief", "actions"] == 5
    assert counts["model.add", "outcome"] == 4
    assert counts["model.add", "result"] == 2


def test_a_change_of_a_component_is_named_by_field_and_size(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    beyond = {(row.what, row.field): row for row in rows_of(line, Adder(error=1)) if not row.within}
    assert set(beyond) == {("model/belief", "actions"), ("model.add", "result")}
    assert beyond["model/belief", "actions"].largest == 1.0
    assert beyond["model.add", "result"].at_ns == 750_000_000  # the first of the largest


def test_missing_and_extra_messages_are_counted_and_the_others_paired_by_stamp(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    line.published.pop(2)
    (messages,) = [row for row in rows_of(line, Adder()) if row.field == "(messages)"]
    assert (messages.largest, messages.compared, messages.within) == (1.0, 4, False)
    assert all(row.within for row in rows_of(line, Adder()) if row.field != "(messages)")


def test_a_call_with_another_outcome_exceeds_any_tolerance(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    for place, event in enumerate(line.events):
        if isinstance(event, RecordedCall) and event.arguments["amount"] == -1:
            line.events[place] = replace(event, answer=msgspec.structs.replace(event.answer, reason="busy"))
    (outcome,) = [row for row in rows_of(line, Adder()) if row.field == "outcome"]
    assert outcome.largest == math.inf
    assert not outcome.within


@pytest.mark.parametrize(("skill", "differs"), [(ADD, True), (LOOK, False)])
def test_a_result_of_another_type_is_a_difference_except_of_the_skill_that_changed(
    skill: Skill[..., Any], differs: bool
) -> None:
    answer = CallRecord(stamp_ns=5, skill=skill.key, outcome=CallEnd.SUCCEEDED, result='{"of": "another type"}')
    call = RecordedCall(log_ns=0, skill=skill, arguments={}, answer=answer)
    replayed = ReplayResult(answers=[(call, Succeeded(result=None))])
    rows = compare(Timeline(events=[call]), replayed, live=False, same_processor=False)
    beyond = [(row.what, row.field, row.largest, row.at_ns) for row in rows if not row.within]
    assert beyond == ([(skill.key, "result", math.inf, 5)] if differs else [])


def test_unrecorded_messages_are_excluded_from_the_comparison(tmp_path: Path) -> None:
    line = recorded_run(tmp_path / "a.mcap")
    replayed = feed(Adder(error=1), line, Adder.publishes)
    stamps = {one.message.stamp_ns for one in line.published}
    assert compare(line, replayed, live=False, same_processor=False, left_out=stamps, uncompared={"model.add"}) == []


class LateRecorder:
    """Gets the messages of one topic only after the next one of another: it is not the process that reads them."""

    def __init__(self, recorder: Recorder, late: Topic[Any], behind: Topic[Any]) -> None:
        self._recorder, self._late, self._behind = recorder, late, behind
        self._held: Message | None = None

    def put(self, topic: Topic[Any], message: Message) -> None:
        if topic is self._late:
            self._held = message
            return
        self._recorder.put(topic, message)
        if topic is self._behind and self._held is not None:
            self._recorder.put(self._late, self._held)
            self._held = None


def followed_run(path: Path, late: Topic[Any], behind: Topic[Any]) -> Timeline:
    """A rod that stays, seen six times, and a model that is elsewhere each time: the prior decides on the targets."""
    rod = shape("S")

    async def main() -> None:
        clock = LoopClock()
        with Recorder(path, clock.now_ns, {}, waits=True) as recorder:
            bus = MemoryTransport(
                LateRecorder(recorder, late, behind).put, CallLog(clock.now_ns, recorder.put, unlogged=CABLES)
            )
            host = Container(bus, clock)
            host.add(ObserverComponent(ObserverConfig(), BelievedDlo(nodes=NODES, length_m=LENGTH_M)))
            async with host:
                bus.publish(topics.OBSERVATION, at(1, cloud(rod)))
                bus.publish(topics.STATE, at(1, state(rod)))
                await bus.call(INITIALISE)
                for number in range(2, 8):
                    await clock.sleep(0.1)
                    moved = at(number, state(rod + np.array([0.002 * number, 0.0, 0.0])))
                    bus.publish(
                        topics.STATE, msgspec.structs.replace(moved, observed_stamp_ns=moved.stamp_ns - STEP_NS)
                    )
                    bus.publish(topics.OBSERVATION, at(number, cloud(rod, seed=number)))
                await clock.sleep(0.1)
                bus.publish(behind, at(8, state(rod) if behind is topics.STATE else cloud(rod)))

    virtual_time.run(main())
    return read_timeline(path, ObserverComponent, ObserverComponent.publishes)


@pytest.mark.parametrize(
    ("late", "behind"), [(topics.STATE, topics.OBSERVATION), (topics.OBSERVATION, topics.STATE)], ids=["state", "cloud"]
)
def test_a_cloud_is_replayed_with_the_prior_that_it_had_although_the_recorder_received_state_or_cloud_late(
    late: Topic[Any], behind: Topic[Any], tmp_path: Path
) -> None:
    line = followed_run(tmp_path / "a.mcap", late, behind)
    observer = ObserverComponent(ObserverConfig(), BelievedDlo(nodes=NODES, length_m=LENGTH_M))
    rows = compare(line, feed(observer, line, ObserverComponent.publishes), live=True, same_processor=True)
    targets = {row.field: row for row in rows if row.what == "observer/targets"}
    assert targets["nodes_world"].compared == 7
    assert targets["nodes_world"].largest == targets["prior_stamp_ns"].largest == 0.0


@pytest.mark.parametrize(("same_processor", "within"), [(True, False), (False, True)])
def test_a_rounding_difference_is_allowed_only_for_another_processor(same_processor: bool, within: bool) -> None:
    field = "nodes_world"
    allowed = tolerance_of("observer/targets", field, live=False, same_processor=same_processor).largest
    assert (allowed >= 1e-8) is within
