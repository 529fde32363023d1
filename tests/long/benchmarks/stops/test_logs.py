"""Logs of the arm's motion and its commander's attempts, also when the commander is killed."""

import asyncio
import multiprocessing
import time
from collections.abc import Callable
from typing import Any, cast

import msgspec
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.types.outcome import Cancelled, Failed, Rejected
from dlokit.types.robot import RobotMode
from parts.logs import ArmLog
from parts.stops.attempts import Attempt, AttemptLog
from parts.stops.commander import outcome_name

PATIENCE_S = 10.0
BEGUN = Attempt(skill="robot.grasp", began_s=1.0)
ENDED = Attempt(skill="robot.grasp", began_s=1.0, ended_s=2.0, ended_as="Succeeded")


def test_an_attempt_runs_from_its_first_report_to_its_second() -> None:
    async def body() -> None:
        reports, sender = multiprocessing.Pipe(duplex=False)
        log = AttemptLog()
        log.listen(reports)
        sender.send(BEGUN)
        assert await log.until(lambda: log.running == "robot.grasp", PATIENCE_S)
        sender.send(ENDED)
        assert await log.until(lambda: log.running == "", PATIENCE_S)
        assert log.between(1.0, 2.0) == [ENDED]
        assert log.between(1.5, 3.0) == []  # it began before
        assert log.between(0.0, 1.5) == []  # it ended after
        log.close()
        sender.close()

    asyncio.run(body())


def test_no_attempt_runs_after_the_commander_has_ended() -> None:
    async def body() -> None:
        reports, sender = multiprocessing.Pipe(duplex=False)
        log = AttemptLog()
        log.listen(reports)
        sender.send(BEGUN)
        sender.close()
        await asyncio.sleep(0)
        assert await log.until(lambda: log.running == "", PATIENCE_S)
        assert not await log.until(lambda: False, 0.01)

    asyncio.run(body())


def test_an_outcome_is_named_with_its_reason() -> None:
    assert outcome_name(Rejected(reason="stop_latched")) == "Rejected stop_latched"
    assert outcome_name(Failed(reason="stopped")) == "Failed stopped"
    assert outcome_name(Cancelled()) == "Cancelled"


IDLE = structs.replace(
    ARM_AT_REST,
    finger_width_m=0.02,
)


class Wire:
    """The only part of a transport that a log needs: it passes on the bytes of each state."""

    def tap(self, topic: Any, handler: Callable[[bytes], None]) -> None:
        self._handler = handler

    def publish(self, *modes: RobotMode) -> None:
        for mode in modes:
            self._handler(codec.encode(msgspec.structs.replace(IDLE, mode=mode)))


def arm_log(wire: Wire) -> ArmLog:
    return ArmLog(cast(Transport, wire))


def test_a_mode_begins_with_the_first_state_that_has_it_and_brakings_are_counted() -> None:
    async def body() -> None:
        wire = Wire()
        log, began_s = arm_log(wire), time.monotonic()
        assert log.mode is None
        assert log.newest is None
        wire.publish(RobotMode.MOVING, RobotMode.BRAKING, RobotMode.BRAKING, RobotMode.IDLE, RobotMode.BRAKING)
        assert (log.mode, log.brakings) == (RobotMode.BRAKING, 2)
        interrupted, at_s = await log.braked(began_s, PATIENCE_S)
        assert interrupted
        assert at_s is not None
        assert log.mode_at(at_s) is RobotMode.BRAKING
        assert len(log.since(began_s)) == 5
        later_s = time.monotonic()
        assert len(log.since(later_s)) == 1  # the last one before
        assert await log.until_mode(RobotMode.BRAKING, after_s=later_s, within_s=0.0) is None

    asyncio.run(body())


def test_a_motion_that_ends_before_the_arm_brakes_was_not_interrupted() -> None:
    async def body() -> None:
        wire = Wire()
        log, struck_s = arm_log(wire), time.monotonic()
        assert await log.braked(struck_s, 0.01) == (True, None)
        wire.publish(RobotMode.MOVING, RobotMode.IDLE, RobotMode.BRAKING)
        assert await log.braked(struck_s, PATIENCE_S) == (False, None)

    asyncio.run(body())


def test_a_wait_for_a_state_ends_only_with_a_new_one() -> None:
    async def body() -> None:
        wire = Wire()
        log = arm_log(wire)
        wire.publish(RobotMode.MOVING)
        assert not await log.until_state(lambda state: state.mode is RobotMode.MOVING, within_s=0.0)
        waiting = asyncio.create_task(
            log.until_state(lambda state: state.mode is RobotMode.MOVING, within_s=PATIENCE_S)
        )
        await asyncio.sleep(0)
        wire.publish(RobotMode.MOVING)
        assert await waiting

    asyncio.run(body())
