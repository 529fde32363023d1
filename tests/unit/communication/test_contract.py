"""Contracts: checks before and after a skill, exclusive use of resources, and one run per call."""

import asyncio

import pytest

from dlokit.communication import dispatch
from dlokit.communication.component import Component, holds, implements
from dlokit.communication.container import Container
from dlokit.communication.dispatch import Dispatcher
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Condition, Skill, SkillCall
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.wire import codec
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, Succeeded


def _turn(speed_rad_s: float) -> float:
    """Turn the drill."""
    ...


POWER = Condition("the power is on", "no_power")
COOL = Condition("the drill stays cool", "too_hot")
THROUGH = Condition("the hole goes through", "blind_hole")
SLOW = Condition("speed_rad_s is 0 to 100", "bad_speed", lambda speed_rad_s: 0.0 <= speed_rad_s <= 100.0)
DRILL = Skill(
    "drill", "drill", _turn, 60.0, requires=(SLOW, POWER), keeps=(COOL,), ensures=(THROUGH,), exclusive="spindle"
)
POLISH = Skill("drill", "polish", _turn, 60.0, exclusive="spindle")
LIGHT = Skill("drill", "light", _turn, 60.0, requires="somebody looks")


class Drill(Component):
    name = "drill"

    def __init__(self) -> None:
        self.powered = self.through = True
        self.degrees, self.heats_to = 20.0, 20.0
        self.turned = 0

    @implements(DRILL)
    async def drill(self, speed_rad_s: float) -> float:
        self.turned += 1
        await self.port.clock.sleep(1.0)
        self.degrees = self.heats_to
        return speed_rad_s

    @implements(POLISH)
    async def polish(self, speed_rad_s: float) -> float:
        return await self.drill(speed_rad_s)

    @implements(LIGHT)
    async def light(self, speed_rad_s: float) -> float:
        return speed_rad_s

    @holds(POWER)
    def is_powered(self, caller: str) -> str | None:
        return None if self.powered else f"{caller} has switched it off"

    @holds(COOL)
    def is_cool(self, caller: str) -> str | None:
        return None if self.degrees < 90.0 else f"{self.degrees} degrees"

    @holds(THROUGH)
    def is_through(self, caller: str) -> str | None:
        return None if self.through else "it ends in the wall"


async def host_of(drill: Drill) -> Container:
    host = Container(MemoryTransport(), LoopClock())
    host.add(drill)
    return host


def drilled(drill: Drill, speed_rad_s: float = 10.0) -> Outcome[float]:
    async def main() -> Outcome[float]:
        async with await host_of(drill) as host:
            return await host.transport.call(DRILL, speed_rad_s)

    return virtual_time.run(main())


def test_a_skill_whose_contract_holds_succeeds() -> None:
    assert isinstance(drilled(Drill()), Succeeded)


@pytest.mark.parametrize("speed_rad_s", [-1.0, 101.0, float("nan")])
def test_arguments_outside_the_contract_are_rejected_by_name_with_what_is_allowed(speed_rad_s: float) -> None:
    drill = Drill()
    outcome = drilled(drill, speed_rad_s)
    assert isinstance(outcome, Rejected)
    assert outcome.reason == "bad_speed"
    assert outcome.detail == f"required: speed_rad_s is 0 to 100; given: speed_rad_s = {speed_rad_s}"
    assert drill.turned == 0


def test_a_precondition_checked_by_the_component_rejects_before_anything_runs() -> None:
    drill = Drill()
    drill.powered = False
    outcome = drilled(drill)
    assert isinstance(outcome, Rejected)
    assert (outcome.reason, outcome.detail) == ("no_power", "memory has switched it off")
    assert drill.turned == 0


def test_an_invariant_is_checked_before_and_after() -> None:
    hot, heating = Drill(), Drill()
    hot.degrees, heating.heats_to = 95.0, 95.0
    before, after = drilled(hot), drilled(heating)
    assert isinstance(before, Rejected)
    assert isinstance(after, Failed)
    assert (before.reason, after.reason) == ("too_hot", "too_hot")
    assert (hot.turned, heating.turned) == (0, 1)


def test_a_postcondition_that_does_not_hold_makes_a_success_a_failure() -> None:
    drill = Drill()
    drill.through = False
    outcome = drilled(drill)
    assert isinstance(outcome, Failed)
    assert (outcome.reason, outcome.detail) == ("blind_hole", "it ends in the wall")


def test_skills_with_the_same_resource_run_one_at_a_time() -> None:
    async def main() -> None:
        async with await host_of(Drill()) as host:
            first = asyncio.create_task(host.transport.call(DRILL, 1.0))
            await asyncio.sleep(0.5)
            second = await host.transport.call(POLISH, 1.0)
            assert isinstance(second, Rejected)
            assert second.reason == "busy"
            assert "drill" in second.detail
            assert isinstance(await host.transport.call(LIGHT, 1.0), Succeeded)
            assert isinstance(await first, Succeeded)
            assert isinstance(await host.transport.call(POLISH, 1.0), Succeeded)

    virtual_time.run(main())


def test_a_cancelled_skill_releases_its_resource() -> None:
    async def main() -> None:
        async with await host_of(Drill()) as host:
            first = asyncio.create_task(host.transport.call(DRILL, 1.0))
            await asyncio.sleep(0.5)
            first.cancel()
            await asyncio.wait({first})
            assert isinstance(await host.transport.call(DRILL, 1.0), Succeeded)

    virtual_time.run(main())


def request(call_id: str, speed_rad_s: float = 1.0) -> SkillCall:
    return DRILL.request(call_id, "test", speed_rad_s)


async def dispatcher_of(drill: Drill) -> Dispatcher:
    host = await host_of(drill)
    return Dispatcher(drill, host.clock)


def test_a_repeated_call_is_answered_from_the_record() -> None:
    async def main() -> None:
        drill = Drill()
        dispatch = await dispatcher_of(drill)
        first = await dispatch(request("a"), lambda data: None)
        # Its arguments differ, but its id is that of the same call.
        again = await dispatch(request("a", 5.0), lambda data: None)
        assert again == first
        assert drill.turned == 1
        await dispatch(request("b"), lambda data: None)
        assert drill.turned == 2

    virtual_time.run(main())


def test_a_repeated_call_of_a_running_skill_waits_for_the_same_answer() -> None:
    async def main() -> None:
        drill = Drill()
        dispatch = await dispatcher_of(drill)
        same = await asyncio.gather(*(dispatch(request("a"), lambda data: None) for _ in range(3)))
        assert len(set(same)) == 1
        assert isinstance(codec.decode(same[0], DRILL.outcome_type), Succeeded)
        assert drill.turned == 1

    virtual_time.run(main())


def test_a_call_that_was_cancelled_is_not_run_again() -> None:
    async def main() -> None:
        drill = Drill()
        dispatch = await dispatcher_of(drill)
        call = asyncio.ensure_future(dispatch(request("a"), lambda data: None))
        await asyncio.sleep(0.5)
        call.cancel()
        await asyncio.wait({call})
        assert isinstance(codec.decode(await dispatch(request("a"), lambda data: None), DRILL.outcome_type), Cancelled)
        assert drill.turned == 1

    virtual_time.run(main())


def _say(text: str) -> str:
    """Say a text."""
    ...


SAY = Skill("parrot", "say", _say, 1.0)


class Parrot(Component):
    name = "parrot"

    def __init__(self) -> None:
        self.said = 0

    @implements(SAY)
    async def say(self, text: str) -> str:
        self.said += 1
        return text


async def answered(dispatch: Dispatcher, call_id: str, text: str) -> str:
    """What the parrot says, or the reason why it says nothing."""
    answer = await dispatch(SAY.request(call_id, "test", text), lambda data: None)
    outcome = codec.decode(answer, SAY.outcome_type)
    return outcome.result if isinstance(outcome, Succeeded) else outcome.reason


def test_the_stored_answers_are_bounded_and_a_deleted_one_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "LARGEST_TOTAL_BYTES", 150)
    monkeypatch.setattr(dispatch, "CALLS_KNOWN", 3)

    async def main() -> None:
        parrot = Dispatcher(Parrot(), LoopClock())
        await answered(parrot, "1", "a" * 60)
        await answered(parrot, "2", "b" * 60)  # the first answer is deleted, its id is not
        assert await answered(parrot, "1", "again") == "answer_forgotten"
        assert await answered(parrot, "2", "again") == "b" * 60
        await answered(parrot, "3", "c" * 60)
        await answered(parrot, "4", "d" * 60)  # four calls: the first id is deleted too
        assert await answered(parrot, "1", "again") == "again"

    virtual_time.run(main())


def test_short_answers_are_deleted_by_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "ANSWERS_KEPT", 2)

    async def main() -> None:
        parrot = Dispatcher(Parrot(), LoopClock())
        for call_id in ("1", "2", "3"):
            assert await answered(parrot, call_id, "done") == "done"
        again = [await answered(parrot, call_id, "again") for call_id in ("1", "2", "3")]
        assert again == ["answer_forgotten", "done", "done"]

    virtual_time.run(main())


def test_an_answer_too_large_to_be_stored_is_named_when_its_call_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "LARGEST_TOTAL_BYTES", 100)

    async def main() -> None:
        parrot = Dispatcher(Parrot(), LoopClock())
        await answered(parrot, "small", "done")
        assert await answered(parrot, "large", "x" * 101) == "x" * 101
        assert await answered(parrot, "large", "again") == "answer_forgotten"
        assert await answered(parrot, "small", "again") == "done"

    virtual_time.run(main())


def test_a_stored_answer_outlives_any_number_of_answers_too_large_to_be_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "LARGEST_TOTAL_BYTES", 100)
    monkeypatch.setattr(dispatch, "ANSWERS_KEPT", 1)
    monkeypatch.setattr(dispatch, "CALLS_KNOWN", 2)

    async def main() -> None:
        parrot = Dispatcher(Parrot(), LoopClock())
        await answered(parrot, "small", "done")
        for call_id in ("1", "2", "3"):
            assert await answered(parrot, call_id, "x" * 101) == "x" * 101
        assert await answered(parrot, "small", "again") == "done"
        assert await answered(parrot, "next", "done") == "done"  # takes the place of the first
        assert await answered(parrot, "next", "again") == "done"

    virtual_time.run(main())


def test_a_condition_is_listed_as_text() -> None:
    assert [condition.text for condition in DRILL.preconditions] == ["speed_rad_s is 0 to 100", "the power is on"]
    assert [condition.text for condition in LIGHT.preconditions] == ["somebody looks"]
    assert POLISH.postconditions == ()
